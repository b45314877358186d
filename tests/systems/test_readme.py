# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Every command of the README, run as it stands there, in its order."""

import fcntl
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path("/tmp/rosfleet")  # as the README has it, so two checkouts take turns
# Run by whoever runs the tests: CI runs `make test`; the demonstrations are suites of it or of `make test-long`; tests/long runs a rehearsal.
ELSEWHERE = {
    "git clone https://github.com/rosfleet/multimaster && cd multimaster",  # this checkout
    "python3 -m venv ~/rosfleet && . ~/rosfleet/bin/activate && pip install 'ansible-core<2.20'",  # .work/venv
    "make demo",
    "make demo LAYOUT=multi_computer",
    "make test",
    "make rehearse INVENTORY=/tmp/rosfleet/fleet",
}


def commands():
    """The lines after a prompt in the README's blocks."""
    blocks = re.findall(r"^ *```console\n(.*?)^ *```", (ROOT / "README.md").read_text(), re.DOTALL | re.MULTILINE)
    return [line.strip()[2:] for block in blocks for line in block.splitlines() if line.strip().startswith("$ ")]


@pytest.fixture
def folder():
    """The folder of the README's commands, for this test alone."""
    with FOLDER.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        shutil.rmtree(FOLDER, ignore_errors=True)
        yield FOLDER
        shutil.rmtree(FOLDER, ignore_errors=True)


def test_every_command_of_the_readme_works(lab, tmp_path, folder):
    found = commands()
    assert ELSEWHERE < set(found)
    environment = {
        **{name: value for name, value in os.environ.items() if not name.startswith("ANSIBLE_")},
        "HOME": str(tmp_path),
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        # The installed collection, not the checkout.
        "ANSIBLE_CONFIG": str(tmp_path / "ansible.cfg"),
        "ANSIBLE_COLLECTIONS_PATH": str(tmp_path / ".ansible/collections"),
        "LC_ALL": "C.UTF-8",
    }
    environment.pop("PYTHONPATH", None)
    for command in found:
        if command in ELSEWHERE:
            continue
        done = subprocess.run(
            ["bash", "-c", command],
            cwd=ROOT,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
        if command.startswith("cp "):
            shutil.copy(lab.connection, folder / "fleet" / "zz_lab.yml")  # the way to the containers
