# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of the program master_discovery; only rospy is not there."""

import importlib
import sys
import types

import pytest
import rosfleet_multimaster
from rosfleet_multimaster import program

URI, R2 = "http://robot1:11311/", "http://robot2:11311/"
SYNC, FAR = ("/upstream_sync", "http://robot1:1/"), ("/far", "http://robot2:2/")


@pytest.fixture(name="module")
def _module(monkeypatch):
    ros = types.ModuleType("rosfleet_multimaster.edge.ros")
    ros.GET_SYNC_INFO = "get_sync_info"
    monkeypatch.setitem(sys.modules, "rosfleet_multimaster.edge.ros", ros)
    monkeypatch.setattr(rosfleet_multimaster, "ros", ros, raising=False)
    monkeypatch.delitem(sys.modules, "rosfleet_multimaster.master_discovery", raising=False)
    yield importlib.import_module("rosfleet_multimaster.master_discovery")
    sys.modules.pop("rosfleet_multimaster.master_discovery", None)


class Roscore:
    """With a node that another implementation of master_sync registered."""

    rpc = types.SimpleNamespace(uri=URI)

    def ask(self, *calls):
        nodes = dict([SYNC, FAR])
        answers = {
            "getPid": 1,
            "getTopicTypes": [["/chatter", "std_msgs/String"]],
            "getSystemState": [[["/chatter", ["/far"]]], [], [["/upstream_sync/get_sync_info", ["/upstream_sync"]]]],
            "lookupService": "rosrpc://robot1:3",
        }
        return [nodes.get(call[1]) if call[0] == "lookupNode" else answers.get(call[0]) for call in calls]


def test_the_first_state_waits_too_until_it_is_known_what_is_from_where(module, monkeypatch):
    poller = module.Poller(Roscore(), URI, "robot1", program.Identity())

    def fails(service):
        raise OSError("not yet")

    monkeypatch.setattr(module.ros, "sync_info", fails, raising=False)
    with pytest.raises(OSError):
        poller.poll()
    monkeypatch.setattr(module.ros, "sync_info", lambda service: {FAR: R2})
    assert poller.poll().nodes["/far"].origin == R2


def test_the_first_state_does_not_wait_for_ever(module, monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(module, "monotonic", lambda: clock[0])
    monkeypatch.setattr(module.ros, "sync_info", lambda service: 1 / 0, raising=False)
    poller = module.Poller(Roscore(), URI, "robot1", program.Identity())
    with pytest.raises(OSError):
        poller.poll()
    clock[0] += module.POSTPONE + 0.1
    assert poller.poll().nodes["/far"].origin == URI


def test_sockets_are_opened_again_where_the_kernel_did_not_list_the_addresses(module, monkeypatch):
    node = module.MasterDiscovery()
    node.values = {"mcast_group": "226.0.0.0", "mcast_port": 11511, "send_mcast": True, "listen_mcast": True}
    node.interface_name = ""

    def busy():
        raise OSError("timed out")

    monkeypatch.setattr(module, "Udp", lambda *arguments: types.SimpleNamespace(sockets=[], close=lambda: None))
    monkeypatch.setattr(module, "addresses", busy)
    node._open(100.0)
    assert node.udp is None and node.udp_due > 100.0  # else nobody would ever read from them


def test_what_is_said_of_a_master_that_is_not_known_is_not_kept(module):
    node = module.MasterDiscovery()
    node._compare(module.Contact(1.0, R2, "robot2", "/master_discovery"), "192.168.1.2", "", None)
    assert node.errors == {}
