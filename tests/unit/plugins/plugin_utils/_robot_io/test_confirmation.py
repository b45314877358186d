# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The controller's side of the dead-man's switch: what it makes of the answers and silences of a machine."""

import signal
import time

import pytest
from ansible.errors import AnsibleAuthenticationFailure, AnsibleConnectionFailure
from ansible.playbook.task import Task
from ansible.plugins.connection import ConnectionBase
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io import confirmation
from kept_connection import Kept
from mentioned import mentions

UNCONFIRMED = {"changed": True, "unconfirmed": True, "diff": [1], "settings": ["first"]}
CONFIRMED = {"changed": True, "unconfirmed": False, "diff": [], "settings": ["second"]}
SAME = {"changed": False, "unconfirmed": True, "same_connection": True}
TAKEN_BACK = {"failed": True, "changed": False, "unconfirmed": False, "rolled_back": True, "msg": "Taken back."}
LOST = AnsibleConnectionFailure("Failed to connect to the host via ssh: Broken pipe")
REFUSED = AnsibleConnectionFailure(
    "Failed to connect to the host via ssh: ssh: connect to host x port 22: No route to host"
)


class Keepless(Kept):
    """As a connection into a container: there is nothing to leave."""

    reset = ConnectionBase.reset


@pytest.fixture
def play(monkeypatch):
    """Run the action against a machine that answers so; returns the result, the runs' options and the connection."""
    monkeypatch.setattr(confirmation, "PAUSE", 0.01)
    monkeypatch.setattr(confirmation.ConnectionBase, "reset", lambda self: pytest.fail("this one warns"))
    Keepless.reset = confirmation.ConnectionBase.reset

    def play(*answers, kind=Kept, transport="ssh", check=False, tmpdir=None, confirm_within=0.2, grace=20.0, **args):
        monkeypatch.setattr(confirmation, "GRACE", grace)  # short where the test is about its end
        task = Task()
        task.action, task.async_val = "rosfleet.multimaster.sysctl", 0
        task.args = {"settings": [], "confirm_within": confirm_within, **args}
        task.check_mode = check
        connection = kind(transport)
        connection._shell.tmpdir = tmpdir
        runs, answers = [], iter(answers)

        def execute(module_args, task_vars):
            runs.append(module_args)
            answer = next(answers)
            if isinstance(answer, float):
                time.sleep(answer)
                answer = next(answers)
            if isinstance(answer, Exception):
                raise answer
            return dict(answer)

        action = confirmation.GuardedAction(task, connection, None, None, None, None)
        action._execute_module = execute
        monkeypatch.setattr(confirmation, "seconds_of", lambda value: value or 0)  # fractions, for a quick test
        return action.run(task_vars={}), runs, connection

    return play


def test_what_does_not_change_takes_one_run(play):
    result, runs, connection = play({"changed": False, "unconfirmed": False})
    assert (len(runs), connection.resets, result["changed"]) == (1, 0, False)
    assert runs[0]["confirm_within"] == 0.2 and runs[0]["confirmation"]


def test_a_change_is_confirmed_over_a_new_connection(play):
    result, runs, connection = play(UNCONFIRMED, CONFIRMED)
    assert (len(runs), connection.resets) == (2, 1)
    assert [run["confirm_within"] for run in runs] == [0.2, 0]
    assert runs[0]["confirmation"] == runs[1]["confirmation"]
    assert result == {
        "changed": True,
        "unconfirmed": False,
        "confirmed": True,
        "diff": [1],
        "settings": ["first"],
    }  # what the change was


def test_every_task_has_a_word_of_its_own_whatever_the_play_says(play):
    words = {play(UNCONFIRMED, CONFIRMED, confirmation="mine")[1][0]["confirmation"] for number in range(3)}
    assert len(words) == 3 and "mine" not in words


def test_a_connection_that_is_kept_is_left_again(play):
    result, runs, connection = play(UNCONFIRMED, SAME, SAME, CONFIRMED)
    assert (len(runs), connection.resets, result["unconfirmed"]) == (4, 3, False)


def test_a_connection_that_is_never_left(play):
    result, runs, connection = play(UNCONFIRMED, *[SAME] * 1000, grace=0.3)
    assert result["failed"] and mentions(result["msg"], "connection", "before")
    result, runs, connection = play(UNCONFIRMED, SAME, TAKEN_BACK)
    assert result == TAKEN_BACK


def test_a_container_needs_no_new_connection(play):
    result, runs, connection = play(UNCONFIRMED, CONFIRMED, kind=Keepless)
    assert (len(runs), result["unconfirmed"]) == (2, False)


def test_cut_off_until_the_way_back(play):
    result, runs, connection = play(UNCONFIRMED, REFUSED, REFUSED, LOST, TAKEN_BACK)
    assert result == TAKEN_BACK
    assert connection.resets == 4


def test_the_first_answer_is_lost(play):
    assert play(LOST, REFUSED, TAKEN_BACK)[0] == TAKEN_BACK
    result, runs, connection = play(LOST, CONFIRMED)
    assert result == CONFIRMED  # a connection that broke by chance


def test_the_machine_never_comes_back(play):
    started = time.monotonic()
    result, runs, connection = play(UNCONFIRMED, *[REFUSED] * 1000, grace=0.3)
    assert result["failed"] and 0.5 <= time.monotonic() - started < 5
    assert mentions(result["msg"], "0.2", "22")


def test_a_machine_that_is_not_there_is_unreachable(play):
    """It is given as long as a gateway before it may need to come back."""
    started = time.monotonic()
    with pytest.raises(AnsibleConnectionFailure) as raised:
        play(*[REFUSED] * 1000, grace=0.3)
    assert raised.value is REFUSED and 0.5 <= time.monotonic() - started < 5
    result, runs, connection = play(REFUSED, REFUSED, UNCONFIRMED, CONFIRMED)
    assert result["unconfirmed"] is False
    assert [run["confirm_within"] for run in runs] == [0.2, 0.2, 0.2, 0]


def test_who_may_not_enter_is_told_at_once(play):
    with pytest.raises(AnsibleAuthenticationFailure):
        play(AnsibleAuthenticationFailure("no"))


def test_a_machine_that_was_reached_before_in_the_task(play):
    """Without pipelining there are several connections per run: the last one of them may be the one that fails."""
    assert play(REFUSED, TAKEN_BACK, tmpdir="/tmp/x")[0] == TAKEN_BACK


def test_ssh_that_hangs_is_given_up(play):
    """Nothing arrives any more, so TCP would wait for hours."""
    started = time.monotonic()
    result, runs, connection = play(60.0, UNCONFIRMED, TAKEN_BACK, grace=0.3)
    assert time.monotonic() - started < 5
    assert len(runs) >= 2 and connection.resets >= 1
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_a_module_that_fails_is_no_case_for_waiting(play):
    failed = {"failed": True, "unconfirmed": False, "rolled_back": False, "msg": "A conflict."}
    result, runs, connection = play(failed)
    assert (result, len(runs)) == (failed, 1)
    crashed = {"failed": True, "msg": "MODULE FAILURE", "module_stdout": "", "rc": 137}
    assert mentions(play(crashed)[0]["msg"], "MODULE", "FAILURE", "0.2")
    assert play({"failed": True, "msg": "Unsupported parameters"})[0]["msg"] == "Unsupported parameters"


@pytest.mark.parametrize(
    "options", [{"check": True}, {"transport": "local"}, {"confirm_within": 0}, {"check": True, "confirmation": "x"}]
)
def test_no_switch_where_none_is_needed(play, options):
    result, runs, connection = play({"changed": True, "unconfirmed": False}, **options)
    assert [run["confirm_within"] for run in runs] == [0]
    assert "confirmation" not in runs[0]


@pytest.mark.parametrize(("value", "seconds"), [("30", 30), (30, 30), (None, 0), ("", 0), ("soon", 0), (-5, 0), (0, 0)])
def test_seconds(value, seconds):
    assert confirmation.seconds_of(value) == seconds
