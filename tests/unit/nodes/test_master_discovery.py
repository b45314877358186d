# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The wiring of master_discovery, without rospy and without its loop; sockets and addresses are played."""

import importlib
import sys
import types

import pytest
import rosfleet_multimaster
from rosfleet_multimaster.discovery import datagrams
from rosfleet_multimaster.discovery.core.actions import Event, Send
from rosfleet_multimaster.discovery.core.peer import Contact
from rosfleet_multimaster.edge.addresses import Network
from rosfleet_multimaster.edge.clock import monotonic
from rosfleet_multimaster.edge.local_roscore import Start
from rosfleet_multimaster.edge.loop import EndFlag, Loop
from rosfleet_multimaster.protocol import parameters
from rosfleet_multimaster.protocol.graph import State
from rosfleet_multimaster.protocol.heartbeat import Kind, decode
from rosfleet_multimaster.protocol.messages import Master

URI = "http://robot1:11311/"
CONTACT = Contact(2000.0, URI, "robot1", "/master_discovery")
OTHER = Master("robot2", "http://robot2:11311/", "http://192.168.1.2:11611", "/d", 1.0, 1.0, True)
STATE = State(URI, "robot1", 1000.0, 1000.0)


class Lab:
    """The program, what it sends, and what it does in ROS."""

    def __init__(self, monkeypatch):
        self.addresses, self.sent, self.made = {"127.0.0.1": 1, "192.168.1.1": 2}, [], []
        ros = types.ModuleType("rosfleet_multimaster.edge.ros")
        ros.hostname = lambda: "robot1"
        ros.DiscoveryNode = self.discovery_node
        ros.master_name = lambda uri: "robot1"
        ros.md5sum = ros.sync_info = lambda name: None
        ros.Diagnostics = lambda: types.SimpleNamespace(has_listeners=lambda: True, publish=self.diagnose)
        self.diagnosed = []
        monkeypatch.setitem(sys.modules, "rosfleet_multimaster.edge.ros", ros)
        monkeypatch.setattr(rosfleet_multimaster.edge, "ros", ros, raising=False)
        monkeypatch.delitem(sys.modules, "rosfleet_multimaster.master_discovery", raising=False)
        module = importlib.import_module("rosfleet_multimaster.master_discovery")
        monkeypatch.setattr(module, "notify", lambda *lines: self.made.extend(lines))
        monkeypatch.setattr(datagrams, "Udp", self.udp)
        monkeypatch.setattr(datagrams, "network", self.network)
        monkeypatch.setattr(datagrams, "source_address", lambda group, port, own: max(self.addresses))
        monkeypatch.delenv("ROS_HOSTNAME", raising=False)
        monkeypatch.delenv("ROS_IP", raising=False)
        server = types.SimpleNamespace(sent=types.SimpleNamespace(value=7))
        monkeypatch.setattr(module, "serve", lambda *arguments: server)
        self.module, self.program = module, None
        self.start({})

    def start(self, given):
        """Make the program, with these parameters."""
        values, _warnings = parameters.overlay(parameters.DISCOVERY, given)
        roscore = types.SimpleNamespace(
            ask=lambda *calls: [0], rpc=types.SimpleNamespace(uri=URI), caller="/master_discovery"
        )
        start = Start(Loop(), EndFlag(), roscore, URI, "/master_discovery", "http://robot1:1/", values)
        self.program = self.module.MasterDiscovery(start)

    def udp(self, *arguments):
        return types.SimpleNamespace(sockets=[], close=lambda: None, send=lambda data, host: self.sent.append(data))

    def network(self):
        return Network(dict(self.addresses), {*self.addresses, "192.168.1.1"}, set(self.addresses.values()))

    def discovery_node(self, masters, refresh):
        self.made.append(([master.name for master in masters()], len(self.sent)))
        return types.SimpleNamespace(
            service_uri=lambda: ("", ""),
            publish_change=lambda *event: None,
            links=lambda *links: None,
        )

    def diagnose(self, entries, _now, _robot):
        self.diagnosed.append({entry.name: entry for entry in entries})

    def move(self):
        """The computer gets another address, which the others hear."""
        self.addresses = {"127.0.0.1": 1, "192.168.1.2": 2}


@pytest.fixture(name="lab")
def _lab(monkeypatch):
    return Lab(monkeypatch)


def test_sockets_that_close_in_a_pass_are_opened_again_in_time(lab):
    lab.program._tick(monotonic())
    lab.move()
    lab.program.address_looks.due = 0.0
    now = monotonic()
    assert now < lab.program._tick(now) < now + 0.9, "after 0.5 s, and not with the look of the next second"


def test_sockets_that_a_datagram_closes_are_opened_again_in_time(lab):
    def gone(data, host):
        raise OSError("Network is unreachable")

    lab.program._tick(monotonic())
    lab.program.datagrams._udp.send = gone
    lab.program.core.actions.append(Send(b"x", None))
    now = monotonic()
    assert now < lab.program._tick(now) < now + 0.9


@pytest.mark.parametrize("look", ["of the second", "after a contact"])
def test_what_is_to_be_sent_goes_before_the_sockets_close(lab, look):
    lab.program._tick(monotonic())
    lab.program.core.actions.append(Send(b"x", None))
    lab.move()
    if look == "of the second":
        lab.program.address_looks.due = 0.0
    else:
        lab.program._on_contact(("192.168.1.2", 11511, 11611), CONTACT, "", False, False)
    lab.program._tick(monotonic())
    assert b"x" in lab.sent


def test_diagnostics_and_metrics_tell_the_same(lab, tmp_path):
    lab.program.display._path = str(tmp_path / "metrics.prom")
    lab.program._on_state(STATE)
    for _answer in range(3):
        lab.program.served.changes.add(1)
    lab.program._report()
    assert lab.diagnosed[-1]["multimaster: roscore"].level == 0
    lab.program._event(Event("new", OTHER))
    lab.program.masters = (OTHER,)
    lab.program._report()
    assert lab.diagnosed[-1]["multimaster: link to robot2"].message == "online"
    lab.program._on_roscore_failure("refused", monotonic() - 10.0)
    lab.program.display._write_due = 0.0
    lab.program._report()
    assert lab.diagnosed[-1]["multimaster: roscore"].level == 2
    text = (tmp_path / "metrics.prom").read_text()
    for line in ("roscore_up 0", 'link_up{master="robot2"} 1', "sent_bytes_total 7", "changes_sent_total 3"):
        assert f"\nmultimaster_{line}\n" in text
    assert (tmp_path / "metrics.prom").stat().st_mode & 0o777 == 0o644
    lab.program.display.end()
    assert list(tmp_path.iterdir()) == []


def test_ready_is_said_when_the_own_master_is_announced(lab):
    lab.program._on_state(STATE)
    (masters, sent), ready = lab.made
    assert masters == ["robot1"] and sent > 0 and ready == "READY=1"
    assert Kind.STATE in [decode(data).kind for data in lab.sent]


def test_without_a_network_the_node_is_ready_for_its_own_robot(lab, monkeypatch):
    def no_interface(*arguments):
        raise OSError("no interface of this computer has the address 192.168.1.1")

    udp = datagrams.Udp
    monkeypatch.setattr(datagrams, "Udp", no_interface)
    lab.start({"interface": "192.168.1.1"})
    lab.program._on_state(STATE)
    (masters, sent), ready = lab.made
    assert masters == ["robot1"] and sent == 0 and ready == "READY=1"
    assert "192.168.1.1" in lab.program.datagrams.own_addresses, "else own nodes would be told what others are told"
    lab.program._tick(monotonic())
    assert "; discovery cannot use " in lab.made[-1]
    monkeypatch.setattr(datagrams, "Udp", udp)
    lab.program._tick(monotonic() + 1.0)
    lab.program._tick(monotonic() + 1.0)
    assert Kind.STATE in [decode(data).kind for data in lab.sent] and lab.made[-1] == "STATUS=1 master: robot1"


def test_a_change_of_the_network_is_looked_at_once_not_for_ever(lab):
    lab.program._tick(monotonic())
    looked = lab.program.looked
    lab.program._on_network_change()
    assert lab.program.address_looks.due == pytest.approx(looked + 0.1)
    lab.program._on_network_change()
    assert lab.program.address_looks.due == pytest.approx(looked + 0.1)
