# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_summary: what the computers registered in, a line for each out."""

import types

from ansible.playbook.task import Task
from ansible_collections.rosfleet.multimaster.plugins.action import fleet_summary


def act(monkeypatch, hostvars, check_mode=False, **options):
    """Run the action on computers with these results; return what it shows, and its result."""
    shown = []
    monkeypatch.setattr(fleet_summary.Display, "display", lambda self, text, **_more: shown.append(text))
    task = Task()
    task.action, task.async_val, task.check_mode = "rosfleet.multimaster.fleet_summary", 0, check_mode
    task.args = options
    connection = types.SimpleNamespace(_shell=types.SimpleNamespace(tmpdir=None))
    module = fleet_summary.ActionModule(task, connection, None, None, None, None)
    return shown, module.run(task_vars={"hostvars": hostvars, "ansible_play_hosts_all": [*hostvars]})


CHANGED = {"changed": True, "concerns": {"routes": [{"changed": True}]}}


def test_the_lines_are_printed_and_returned(monkeypatch):
    hostvars = {"kobuki": {"opened": CHANGED}, "dabo": {}}
    shown, result = act(monkeypatch, hostvars, check_mode=True, results=["opened", "brought"])
    assert shown == ["\nSUMMARY: 1 of 2 computers would change.\n  kobuki: routes"]
    assert result["computers"] == ["kobuki: routes"] and not result["changed"]


def test_warnings_stand_below_the_summary(monkeypatch):
    hostvars = {"kobuki": {"plan": {"warnings": ["kobuki: no sshd\x1b[2J; expected one."]}}, "dabo": {"plan": {}}}
    shown, result = act(monkeypatch, hostvars, results=["brought"], warnings=["plan"])
    assert shown[0] == "\nSUMMARY: 0 of 2 computers changed."
    assert shown[1].splitlines()[1].startswith("  - kobuki: no sshd") and "\x1b" not in shown[1]
    assert len(result["warned"]) == 2 and "warnings" not in result


def test_a_teardown_says_of_each_computer_how_it_is(monkeypatch):
    left = {
        "kobuki": {"closed": CHANGED, "left": {"owned": []}},
        "dabo": {"closed": CHANGED, "left": {"owned": ["routes"]}},
    }
    options = {"results": ["closed"], "before": "found", "after": "left"}
    shown, _result = act(monkeypatch, left, **options)
    assert shown[0].splitlines()[1:4] == [
        "TEARDOWN: 1 of 2 computers is as before.",
        "  kobuki: as before.",
        "  dabo: left: routes; run this again.",
    ]
    assert act(monkeypatch, left, check_mode=True, **options)[0][0].startswith("\nSUMMARY: 2 of 2 computers would")
