# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_check: plain data in, plain data out."""

import types

from acting import act
from ansible.playbook.task import Task
from ansible_collections.rosfleet.multimaster.plugins.action.fleet_check import ActionModule
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import from_plain, to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import ComputerPlan, PlannedAddress
from mentioned import mentions

ROUTER = {
    "computer": "router",
    "address": "192.168.1.1",
    "common_address": "192.168.1.1",
    "network": "192.168.1.0/24",
    "is_router": True,
}
MACHINE = {
    "hostname": "router",
    "systemd": {"running": True},
    "interfaces": [
        {
            "name": "eth0",
            "up": True,
            "multicast": True,
            "loopback": False,
            "addresses": [{"address": "192.168.1.1", "prefix": 24}],
        }
    ],
}


def check(plan, machine=None, **options):
    task = Task()
    task.action, task.async_val = "rosfleet.multimaster.fleet_check", 0
    task.args = {"plan": plan, "machine": machine or MACHINE, **options}
    task.check_mode = False
    connection = types.SimpleNamespace(_shell=types.SimpleNamespace(tmpdir=None))
    return act(ActionModule(task, connection, None, None, None, None), {})


def test_the_plan_comes_back_as_plain_data():
    plan = from_plain(ComputerPlan, ROUTER)
    given = to_plain(plan)
    given["networks"] = [to_plain(PlannedAddress(plan.network, plan.address))]
    given["sysctl"] = [{"name": "net.ipv4.conf.{common}.send_redirects", "value": "0"}]
    result = check(given)
    assert (result.get("failed", False), result["problems"], result["warnings"]) == (False, [], [])
    assert result["sysctl"] == [{"name": "net.ipv4.conf.eth0.send_redirects", "value": "0"}]
    assert set(given) <= set(result)
    assert result["packages"] == []


def test_another_thing_than_a_plan_is_one_sentence():
    result = check({**ROUTER, "address": "here"})
    assert result["failed"]
    assert mentions(result["msg"], "fleet_plan", "here", "IPv4")


def test_what_fails_is_sentences_without_the_plan():
    result = check(ROUTER, {**MACHINE, "systemd": {"running": False}})
    assert result["failed"]
    assert "systemd does not run the machine" in result["msg"]
    assert set(result) - {"failed", "msg"} == {"changed", "warnings", "problems", "noted"}
    assert len(str(result)) < 1000


def test_check_mode_notes_a_later_refusal():
    result = check(ROUTER, {**MACHINE, "systemd": {"running": False}}, refuse=False)
    assert not result.get("failed") and result["problems"] == []
    (noted,) = result["noted"]
    assert "systemd does not run the machine" in noted
    assert result["found"]["noted"] == [noted]
