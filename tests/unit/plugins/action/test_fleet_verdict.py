# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_verdict: a run that fails, by ansible-playbook itself, ends in our words, and not as a mistake in a playbook."""

import pathlib
import subprocess
import sys

import pytest
import yaml

from tests.unit.playbooks.played_robots import set_ansible

WORDS = "FAILED: 2 of 116 checks failed; the list has 1 finding, 1 warning."

pytestmark = pytest.mark.whole


def played(tmp_path, **options):
    """Run a play with the action; return its exit status and its lines."""
    task = {"name": "Give the result", "rosfleet.multimaster.fleet_verdict": options}
    play = {"hosts": "localhost", "gather_facts": False, "connection": "local", "tasks": [task]}
    (tmp_path / "play.yml").write_text(yaml.safe_dump([play]))
    done = subprocess.run(
        [pathlib.Path(sys.executable).with_name("ansible-playbook"), "-i", "localhost,", tmp_path / "play.yml"],
        cwd=tmp_path,
        env=set_ansible(tmp_path),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
        check=False,
    )
    return done.returncode, done.stdout


def test_the_last_words_of_a_failure_are_ours(tmp_path):
    status, output = played(tmp_path, passed=False, fail_msg=["", WORDS, "The findings above say why."])
    assert status == 2, output
    said = f'fatal: [localhost]: FAILED! => {{"changed": false, "msg": "{WORDS} The findings above say why."}}'
    assert output.split("TASK [Give the result]")[1].splitlines()[1:2] == [said], output
    assert not [word for word in ("[ERROR]", "Origin", "play.yml", "evaluated_to", "Traceback") if word in output]


def test_a_run_that_passes_says_its_sentence(tmp_path):
    status, output = played(tmp_path, passed=True, fail_msg=[WORDS], success_msg="Nothing was lost.")
    assert status == 0 and '"msg": "Nothing was lost."' in output and WORDS not in output, output
