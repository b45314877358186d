# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_finding: a finding in, the result of a task out; what is wrong fails."""

import types

import pytest
from acting import act
from ansible.playbook.task import Task
from ansible_collections.rosfleet.multimaster.plugins.action import fleet_finding

FINDING = {
    "sentence": "a link is down",
    "remedy": "plug it in",
    "decide": "ip link",
    "verdict": "failed",
    "place": "tibi-nav",
    "seen": [1, 2],
}


def told(finding):
    task = Task()
    task.action, task.async_val, task.check_mode = "rosfleet.multimaster.fleet_finding", 0, False
    task.args = {"finding": finding}
    connection = types.SimpleNamespace(_shell=types.SimpleNamespace(tmpdir=None))
    return act(fleet_finding.ActionModule(task, connection, None, None, None, None), {})


@pytest.mark.parametrize(("verdict", "failed"), [("failed", True), ("warning", False), ("unknown", False)])
def test_a_finding_fails_where_checks_failed(verdict, failed):
    result = told({**FINDING, "verdict": verdict})
    assert (
        result["failed"] is failed and result["msg"] == "a link is down; plug it in" and result["place"] == "tibi-nav"
    )
    assert result["decide"] == "ip link" and "seen" not in result


@pytest.mark.parametrize("finding", [None, {}, [1], {"sentence": "x"}])
def test_what_is_none_is_refused(finding):
    assert "expected an entry of findings" in told(finding)["msg"] and told(finding)["failed"]
