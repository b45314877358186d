# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Assertions of roles whose sentence is there only if they fail: each version of ansible-core takes them where they hold, too."""

import json
import os
import pathlib
import subprocess
import sys

import pytest
import yaml

ROOT = pathlib.Path(__file__).resolve().parents[3]
KEYS = ROOT / "roles" / "tunnel" / "tasks" / "keys.yml"


def find_assertion(path):
    return next(task for task in yaml.safe_load(path.read_text("utf-8")) if "ansible.builtin.assert" in task)


@pytest.mark.slow
def test_a_key_that_is_not_believed_costs_its_computer_alone(tmp_path):
    """The task itself, with ansible-core: it takes bob, says why, and leaves ana alone."""
    play = [
        {
            "hosts": "all",
            "gather_facts": False,
            "vars": {"tunnel_gathered": {"refused": {"bob": "the key of bob is no key"}}},
            "tasks": [find_assertion(KEYS)],
        }
    ]
    (tmp_path / "play.yml").write_text(json.dumps(play))
    done = subprocess.run(
        [pathlib.Path(sys.executable).with_name("ansible-playbook"), "-i", "ana,bob,", "-c", "local", "play.yml"],
        cwd=tmp_path,
        env={**os.environ, "ANSIBLE_NOCOLOR": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    results = {line.split()[0]: "failed=1" in line for line in done.stdout.splitlines() if "failed=" in line}
    assert results == {"ana": False, "bob": True}, done.stdout + done.stderr
    assert "the key of bob is no key" in done.stdout
