# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_predict: what the computers registered in, a table or warnings out."""

import types

import pytest
from acting import act
from ansible.playbook.task import Task
from ansible_collections.rosfleet.multimaster.plugins.action import fleet_predict
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import Rule
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.plan_world import make_world
from mentioned import mentions
from worlds import change, change_interface, fig12, info_of

PLAN = fig12()
WORLD = make_world(PLAN)


def predict(read, failed=(), **options):
    task = Task()
    task.action, task.async_val = "rosfleet.multimaster.fleet_predict", 0
    task.args = {"fleet": to_plain(PLAN), "machine": "multimaster_info", **options}
    task.check_mode = False
    connection = types.SimpleNamespace(_shell=types.SimpleNamespace(tmpdir=None))
    hostvars = {name: {"multimaster_info": info} for name, info in read.items()}
    module = fleet_predict.ActionModule(task, connection, None, None, None, None)
    present = [name for name in read if name not in failed]
    return act(module, {"hostvars": hostvars, "ansible_play_hosts_all": list(read), "ansible_play_hosts": present})


def machines(world=WORLD):
    return {name: info_of(world.machines[name]) for name in PLAN.computers}


@pytest.fixture
def shown(monkeypatch):
    texts = []
    monkeypatch.setattr(fleet_predict.Display, "display", lambda self, text, **_more: texts.append(text))
    return texts


def test_what_would_work_is_told_in_a_line(shown):
    result = predict(machines())
    assert result["works"] and not result["warnings"] and not result["ways"] and not result["assumed"] and not shown
    assert result["msg"].startswith("PREDICTED: all of ")


def test_what_would_not_is_a_warning_or_a_table(shown):
    world = change(WORLD, "kobuki", rules=(Rule("in", "drop", "icmp"),))
    result = predict(machines(world))
    assert not result["works"] and result["warnings"] == result["sentences"] and not shown
    assert mentions(result["sentences"][0], "kobuki", "site.yml")
    assert {"from": "tibi-nav", "to": "kobuki", "traffic": "ping"}.items() <= result["ways"][0].items()
    result = predict(machines(world), table=True)
    assert "warnings" not in result and "PREDICTION for 5 computers" in shown[0]


@pytest.mark.parametrize("strange", [{}, {"failed": True}, {"interfaces": [{"name": "\x1b[2J"}], "routing": 3}])
def test_a_computer_that_says_nothing_of_use_is_taken_as_planned(strange, shown):
    result = predict({**machines(), "tibi-nav": strange})
    assert result["works"] and result["assumed"] == ["tibi-nav"]


def test_another_thing_than_a_plan_is_one_sentence():
    result = predict({}, fleet={"common_network": "here"})
    assert result["failed"] and result["msg"].startswith("The plan of the fleet cannot be read: ")


def test_a_computer_that_was_refused_is_left_out_and_named(shown):
    """It stays as it is: as a gateway it still passes packets on, or does not."""
    result = predict(machines(), failed=["tibi-nav"])
    assert result["refused"] == ["tibi-nav"] and result["works"]
    assert mentions(result["warnings"][-1], "tibi-nav") and "tibi-nav" not in str(result["ways"])
    closed = WORLD
    for interface in WORLD.machines["tibi-visio"].interfaces:
        closed = change_interface(closed, "tibi-visio", interface.name, forwarding=False)
    for failed, works in ((), True), (["tibi-visio"], False):
        assert predict(machines(closed), failed=failed)["works"] == works
