# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Who does the second run of the module: the process that the first one has kept, or the module as usual."""

import json
import types

import pytest
from ansible.playbook.task import Task
from ansible_collections.rosfleet.multimaster.plugins.action import multimaster_verify
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.left_behind import path_of

MODULE = {"changed": False, "msg": "the module"}
KEPT = {"changed": False, "msg": "the kept process"}


@pytest.fixture
def play():
    def play(said, pipelining=True, **args):
        task = Task()
        task.action, task.async_val, task.check_mode = "rosfleet.multimaster.multimaster_verify", 0, False
        task.args = args
        connection = types.SimpleNamespace(
            transport="ssh",
            _shell=types.SimpleNamespace(tmpdir=None),
            is_pipelining_enabled=lambda wrap_async: pipelining,
        )
        action = multimaster_verify.ActionModule(task, connection, None, None, None, None)
        asked = []

        def execute(command, in_data):
            asked.append((command, json.loads(in_data)))
            return said

        action._low_level_execute_command = execute
        action._execute_module = lambda module_args, task_vars, wrap_async: {**MODULE, "args": module_args}
        return action.run(task_vars={}), asked

    return play


def output(text, status=0):
    return {"rc": status, "stdout": text, "stderr": ""}


def test_the_kept_process_is_asked_with_the_options_of_the_task(play):
    result, [(command, request)] = play(output("a banner\n" + json.dumps(KEPT)), run="r1", name="a", tried=None)
    assert result == {**KEPT, "kept": True}
    assert command.endswith(path_of("kept", "r1"))
    modes = {"_ansible_check_mode": False}
    assert request == {"run": {"run": "r1", "name": "a", **modes}}


@pytest.mark.parametrize(
    "said",
    [output("", 3), output("", 127), output(""), output("Killed", 137), output("[1]"), output(json.dumps(KEPT), 3)],
)
def test_where_it_is_gone_the_module_starts_as_usual(play, said):
    result, asked = play(said, state="collected", run="r1", tried=None)
    assert result == {**MODULE, "args": {"state": "collected", "run": "r1"}} and asked


def test_the_first_run_keeps_a_process_where_it_can_be_asked(play):
    for pipelining, keep in ((True, {"keep": True}), (False, {})):
        result, asked = play(output(""), state="started", run="r1", pipelining=pipelining)
        assert result == {**MODULE, "args": {"state": "started", "run": "r1", **keep}} and not asked


@pytest.mark.parametrize("how", [{"state": "started"}, {"state": "streamed"}, {"pipelining": False}, {"odd": {1, 2}}])
def test_other_runs_are_runs_of_the_module(play, how):
    result, asked = play(output(json.dumps(KEPT)), run="r1", **how)
    assert result["msg"] == "the module" and not asked
