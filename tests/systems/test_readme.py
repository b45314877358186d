# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Every command of the README, run as it stands there, in its order; and its transcript, line by line."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
# Run by whoever runs the tests: CI runs `make test`; the demonstrations are suites of it or of `make test-long`.
ELSEWHERE = {
    "python3 -m venv ~/rosfleet && . ~/rosfleet/bin/activate && pip install 'ansible-core<2.20'",  # .work/venv
    "make demo",
    "make test",
}
REPOSITORY = "https://github.com/rosfleet/multimaster.git"
PERSON = re.compile(r"operator@(\w+):~\$ (.+)")


def commands():
    """The lines after a prompt in the README's blocks."""
    blocks = re.findall(r"^ *```console\n(.*?)^ *```", README, re.DOTALL | re.MULTILINE)
    return [line.strip()[2:] for block in blocks for line in block.splitlines() if line.strip().startswith("$ ")]


def transcript():
    """The lines of the README's transcript."""
    (block,) = re.findall(r"^```text\n(.*?)^```", README, re.DOTALL | re.MULTILINE)
    return block.splitlines()


@pytest.fixture
def repository(tmp_path):
    """A repository with the files of this checkout, committed or not."""
    folder = tmp_path / "repository"
    folder.mkdir()
    listed = f"git -C {ROOT} ls-files -z -co --exclude-standard | tar -c -C {ROOT} --null -T - --ignore-failed-read"
    git = "git -c user.name=test -c user.email=test@localhost"
    for command in (f"{listed} | tar -x", "git init -q", "git add -A", f"{git} commit -q -m test"):
        subprocess.run(["bash", "-c", command], cwd=folder, check=True, stderr=subprocess.DEVNULL)
    return f"file://{folder}"


def without_figures(line):
    """A line of the verification, whatever its number of checks."""
    return re.sub(r"none of \d+ checks", "none of the checks", line)


def follow(lab, printed):
    """Follow the transcript: each of its lines is printed by a command of the README or by a robot."""
    seen = {without_figures(line) for line in printed}
    for line in transcript():
        if person := PERSON.fullmatch(line):
            host, command = person.groups()
            if " pub " in command:
                lab.start(host, "readme", command)
            else:
                seen.update(lab.run(host, command).splitlines())
        elif line.startswith("$ "):
            assert line[2:] in commands()
        else:
            assert line == "..." or without_figures(line) in seen, line
    lab.stop("kobuki1computer", "readme")


def test_every_command_of_the_readme_works(untouched, tmp_path, repository):
    status, output = untouched.play("playbooks/teardown.yml")  # what other files of this lab have set up
    assert status == 0, output
    found, printed = commands(), []
    assert set(found) > ELSEWHERE
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
            ["bash", "-c", command.replace(REPOSITORY, repository)],
            cwd=tmp_path,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
        printed += done.stdout.splitlines()
        if command.startswith("cp "):
            shutil.copy(untouched.connection, tmp_path / "fleet" / "zz_lab.yml")  # the way to the containers
        if command.endswith("multimaster.verify"):
            follow(untouched, printed)
