# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The two runs of a computer's concerns, and what is made of their answers."""

import pytest
from acting import act
from ansible.errors import AnsibleConnectionFailure
from ansible.playbook.task import Task
from ansible_collections.rosfleet.multimaster.plugins.action import multimaster_computer
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import environment
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io import confirmation
from kept_connection import Kept

SYSCTL = {"settings": [], "confirm_within": 60}
ROUTES = {"routes": [], "confirm_within": "30"}
FILES = [{"bundle": "x", "files": []}]


def answer(diff=(), **concerns):
    """The result of the module."""
    every = [one for results in concerns.values() for one in results]
    return {
        "changed": any(one["changed"] for one in every),
        "unconfirmed": any(one.get("unconfirmed") for one in every),
        "diff": list(diff),
        "concerns": concerns,
        "msg": " ".join(one["msg"] for one in every),
    }


DONE = [{"changed": True, "unconfirmed": False, "msg": "Done."}]
RIGHT = [{"changed": False, "unconfirmed": False, "msg": "Right."}]
WAITS = [{"changed": True, "unconfirmed": True, "msg": "Waits."}]


@pytest.fixture
def play(monkeypatch):
    monkeypatch.setattr(confirmation, "PAUSE", 0.01)

    def play(*answers, transport="ssh", check=False, **args):
        task = Task()
        task.action, task.async_val, task.check_mode = "rosfleet.multimaster.multimaster_computer", 0, check
        task.args = {"sysctl": SYSCTL, "routes": ROUTES, "managed_files": FILES, "hosts_entries": None, **args}
        runs, answers, connection = [], iter(answers), Kept(transport)

        def execute(module_args, task_vars):
            runs.append({**module_args})
            module_args["_ansible_check_mode"] = False  # as Ansible does
            given = next(answers)
            if isinstance(given, Exception):
                raise given
            return given

        action = multimaster_computer.ActionModule(task, connection, None, None, None, None)
        action._execute_module = execute
        return act(action, {}), runs, connection

    return play


def test_the_second_run_confirms_and_does_the_rest(play):
    result, runs, connection = play(
        answer([1], sysctl=WAITS, routes=RIGHT), answer([1, 2], sysctl=DONE, managed_files=DONE)
    )
    assert [set(run) for run in runs] == [{"sysctl", "routes", "managed_files"}, {"sysctl", "managed_files"}]
    word = runs[0]["sysctl"]["confirmation"]
    assert word and runs[0]["routes"] == {**ROUTES, "confirmation": word}
    assert runs[1]["sysctl"] == {**SYSCTL, "confirm_within": 0, "confirmation": word}
    assert connection.resets == 1
    assert list(result["concerns"]) == ["sysctl", "routes", "managed_files"]
    assert result["concerns"]["sysctl"] == [{**WAITS[0], "unconfirmed": False, "confirmed": True}]
    assert (result["changed"], result["diff"], result["msg"]) == (True, [1, 2], "Waits. Right. Done.")


def test_a_reader_without_a_feed_reads_all(play):
    result, runs, connection = play(answer(sysctl=RIGHT, routes=RIGHT, managed_files=RIGHT))
    assert [set(run) for run in runs] == [{"sysctl", "routes", "managed_files"}]
    assert (connection.resets, result["changed"]) == (0, False)


def test_a_router_needs_no_more_than_its_confirmation(play):
    for waits, number in ((WAITS, 2), (RIGHT, 1)):
        result, runs, _connection = play(answer(sysctl=RIGHT, routes=waits), answer(routes=DONE), managed_files=None)
        assert len(runs) == number and list(result["concerns"]) == ["sysctl", "routes"]


@pytest.mark.parametrize("how", [{"check": True}, {"transport": "local"}, {"sysctl": {"settings": []}, "routes": None}])
def test_one_run_where_nothing_can_be_cut(play, how):
    _result, runs, connection = play(answer(sysctl=DONE), **how)
    (run,) = runs
    assert "managed_files" in run and connection.resets == 0
    assert run["sysctl"] == {"settings": [], "confirm_within": 0, "confirmation": ""}


def test_one_concern_without_a_switch_gets_no_word(play):
    _result, runs, _connection = play(
        answer(sysctl=DONE, routes=WAITS), answer(routes=DONE, managed_files=DONE), sysctl={"settings": []}
    )
    assert runs[0]["sysctl"] == {"settings": [], "confirm_within": 0, "confirmation": ""}
    assert set(runs[1]) == {"routes", "managed_files"}


def test_a_failed_trial_is_the_end(play):
    failed = {"failed": True, "msg": "No.", "concerns": {"sysctl": WAITS}}
    result, runs, connection = play(failed)
    assert (result, len(runs), connection.resets) == (failed, 1, 0)


def test_a_lost_answer_may_be_that_of_any_change(play):
    lost = AnsibleConnectionFailure("Failed to connect to the host via ssh: Broken pipe")
    result, runs, connection = play(lost, answer(sysctl=DONE, routes=DONE, managed_files=DONE))
    assert set(runs[1]) == {"sysctl", "routes", "managed_files"} and connection.resets == 1
    assert result["concerns"]["sysctl"] == DONE


@pytest.mark.parametrize("number", [0, 1, 2, 3])
def test_a_concern_has_as_many_results_as_the_robot_says(play, number):
    """They are data of a robot, and of a list of bundles there are several."""
    several = [*RIGHT * (number - 1), *WAITS][:number]
    first = answer(sysctl=WAITS, routes=several)
    result, _runs, _connection = play(first, answer(sysctl=DONE, routes=DONE, managed_files=DONE))
    confirmed = {**WAITS[0], "unconfirmed": False, "confirmed": True}
    waits = [confirmed if one["unconfirmed"] else one for one in several]
    assert result["concerns"]["routes"] == (waits if confirmed in waits else DONE)
    assert result["concerns"]["sysctl"] == [confirmed]


@pytest.mark.parametrize("concerns", [None, {}, {"sysctl": None}, {"sysctl": [None]}, {"sysctl": [{}]}])
def test_an_answer_that_lacks_values_ends_in_no_traceback(play, concerns):
    waiting = {"unconfirmed": True, "concerns": concerns}
    result, runs, _connection = play(waiting, answer(sysctl=DONE, managed_files=DONE))
    assert (len(runs), result["changed"]) == (2, True)
    failed = {"failed": True, "msg": "No.", "concerns": concerns}
    assert play(answer(sysctl=WAITS), failed)[0]["msg"] == "No."


def test_what_was_taken_back_is_no_change(play):
    back = {"failed": True, "msg": "Taken back.", "changed": False, "rolled_back": True}
    result, _runs, _connection = play(answer([1], sysctl=WAITS, routes=WAITS), back)
    assert (result["failed"], result["changed"], result["msg"]) == (True, False, "Taken back.")


def test_a_failure_after_the_confirmation_leaves_the_change(play):
    failed = {
        "failed": True,
        "msg": "No.",
        "changed": False,
        "concerns": {"sysctl": DONE, "managed_files": [{"failed": True, "msg": "No."}]},
    }
    result, _runs, _connection = play(answer(sysctl=WAITS, routes=RIGHT), failed)
    assert (result["failed"], result["changed"], result["msg"]) == (True, True, "No.")
    assert result["concerns"]["sysctl"][0]["confirmed"] and result["concerns"]["managed_files"][0]["failed"]


VARIABLES = {"ROS_MASTER_URI": "http://a:11311"}
LOGIN = environment.values(environment.merge({}, VARIABLES))
PROFILE = "/etc/profile.d/rosfleet-multimaster.sh"
SHELLS = {"variables": VARIABLES, "files": [PROFILE], "before": {"login": {}}, "notes": ["No ssh."]}


def shells(found):
    return {**answer(managed_files=DONE), "shells": found}


@pytest.mark.parametrize(
    ("found", "wrong"),
    [
        ({"login": LOGIN, "ssh": None, "desktop": None}, ""),
        ({"login": {}}, "ROS_MASTER_URI is not set in a new login shell"),
        ({"login": None, "ssh": None, "desktop": None}, ""),
    ],
)
def test_what_shells_see_is_compared_with_the_plan(play, found, wrong):
    result, runs, _connection = play(shells(found), sysctl=None, routes=None, shells=SHELLS)
    assert runs[0]["shells"] == {**SHELLS, "before": {}, "notes": []}, "the module only reads"
    assert bool(result.get("failed")) is bool(wrong) and wrong in result["msg"]
    assert result["warnings"] == ["No ssh."] and result["changed"] is True


def test_shells_with_names_alone_need_no_folders(play):
    names = {**SHELLS, "before": {"login": VARIABLES}}
    assert play(answer(managed_files=RIGHT), sysctl=None, routes=None, shells=names)[0]["failed"]
    names["reach"] = "names"
    assert "failed" not in play(answer(managed_files=RIGHT), sysctl=None, routes=None, shells=names)[0]


def test_shells_see_the_same_when_nothing_was_written(play):
    result, _runs, _connection = play(answer(managed_files=RIGHT), sysctl=None, routes=None, shells=SHELLS)
    assert result["failed"]
    seen = {**SHELLS, "before": {"login": LOGIN}}
    assert "failed" not in play(answer(managed_files=RIGHT), sysctl=None, routes=None, shells=seen)[0]
    checked = play(answer(managed_files=RIGHT), sysctl=None, routes=None, shells=SHELLS, check=True)[0]
    assert "failed" not in checked and checked["warnings"] == ["No ssh."]


def test_what_a_template_makes_of_nothing_is_not_asked_for(play):
    """An empty text before ansible-core 2.19, which no module takes as a dict."""
    _result, [run], _connection = play(answer(managed_files=RIGHT), sysctl="", routes="", hosts_entries="", shells="")
    assert set(run) == {"managed_files"}
