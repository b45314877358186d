# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_summary: what the computers registered in, a line for each out."""

import types

from ansible.playbook.task import Task
from ansible_collections.rosfleet.multimaster.plugins.action import fleet_summary


def test_the_lines_are_printed_and_returned(monkeypatch):
    shown = []
    monkeypatch.setattr(fleet_summary.Display, "display", lambda self, text, **_more: shown.append(text))
    task = Task()
    task.action, task.async_val, task.check_mode = "rosfleet.multimaster.fleet_summary", 0, True
    task.args = {"results": ["opened", "brought"]}
    connection = types.SimpleNamespace(_shell=types.SimpleNamespace(tmpdir=None))
    module = fleet_summary.ActionModule(task, connection, None, None, None, None)
    changed = {"changed": True, "concerns": {"routes": [{"changed": True}]}}
    hostvars = {"kobuki": {"opened": changed}, "dabo": {}}
    result = module.run(task_vars={"hostvars": hostvars, "ansible_play_hosts_all": ["kobuki", "dabo"]})
    assert shown == ["\nSUMMARY: 1 of 2 computers would change.\n  kobuki: routes"]
    assert result["computers"] == ["kobuki: routes"] and not result["changed"]
