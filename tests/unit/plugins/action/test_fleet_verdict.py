# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_verdict: a run that fails, by ansible-playbook itself, ends in our words, and not as a mistake in a playbook."""

import pytest

from tests.unit.playbooks.played_robots import run_tasks

WORDS = "FAILED: 2 of 116 checks failed; the list has 1 finding, 1 warning."

pytestmark = pytest.mark.whole


def played(tmp_path, **options):
    """Run a play with the action; return its exit status and its lines."""
    task = {"name": "Give the result", "rosfleet.multimaster.fleet_verdict": options}
    return run_tasks(tmp_path, task)


def test_the_last_words_of_a_failure_are_ours(tmp_path):
    status, output = played(tmp_path, passed=False, fail_msg=["", WORDS, "The findings above say why."])
    assert status == 2, output
    said = f'fatal: [localhost]: FAILED! => {{"changed": false, "msg": "{WORDS} The findings above say why."}}'
    assert output.split("TASK [Give the result]")[1].splitlines()[1:2] == [said], output
    assert not [word for word in ("[ERROR]", "Origin", "play.yml", "evaluated_to", "Traceback") if word in output]


def test_a_run_that_passes_says_its_sentence(tmp_path):
    status, output = played(tmp_path, passed=True, fail_msg=[WORDS], success_msg="Nothing was lost.")
    assert status == 0 and '"msg": "Nothing was lost."' in output and WORDS not in output, output
