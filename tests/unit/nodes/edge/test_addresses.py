# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The addresses and links of this computer, as its kernel tells them."""

import select
import socket
import time

import pytest
from rosfleet_multimaster.edge import addresses as module
from rosfleet_multimaster.edge.addresses import AddressChanges, addresses, network


def test_the_kernel_lists_the_addresses():
    found = addresses()
    assert ("127.0.0.1", socket.if_nametoindex("lo")) in found


def test_the_kernel_lists_interfaces_own_addresses_and_carriers():
    loopback = socket.if_nametoindex("lo")
    found = network()
    assert found.interfaces == dict(addresses()) and found.own >= set(found.interfaces)
    assert loopback in found.running


def test_changes_are_heard_by_a_socket_that_never_blocks():
    changes = AddressChanges()
    changes.clear()
    assert select.select([changes.socket], [], [], 0)[0] == []
    changes.socket.close()


URIS = {
    name: f"http://{name}:4321/" for name in ("mine", "alias", "theirs", "lost", "127.0.0.9", "192.168.1.5", "10.0.0.7")
}
NAMES = {"alias": "192.168.1.5", "theirs": "10.0.0.7"}


@pytest.fixture
def names(monkeypatch):
    """This computer is Mine, at 192.168.1.5."""

    def resolved(host):
        if host in NAMES or host[0].isdigit():
            return NAMES.get(host, host)
        raise OSError("unknown")

    monkeypatch.setattr(module, "network", lambda: module.Network({}, {"127.0.0.1", "192.168.1.5"}, set()))
    monkeypatch.setattr(module.socket, "gethostname", lambda: "Mine")
    monkeypatch.setattr(module, "address_of", resolved)
    for variable in ("ROS_IP", "ROS_HOSTNAME"):
        monkeypatch.delenv(variable, raising=False)


def test_uris_that_lead_to_this_computer(names):
    found = module.local_uris([*URIS.values(), "nonsense", "http://[::", ""], 2.0)
    assert found == {URIS[name] for name in ("mine", "alias", "127.0.0.9", "192.168.1.5")}


def test_the_name_that_ros_was_given_leads_here_too(names, monkeypatch):
    monkeypatch.setenv("ROS_HOSTNAME", "Theirs")
    assert URIS["theirs"] in module.local_uris(URIS.values(), 2.0)


def test_a_name_server_without_an_answer_is_not_waited_for(names, monkeypatch):
    monkeypatch.setattr(module, "address_of", lambda _host: time.sleep(5))
    began = time.monotonic()
    assert module.local_uris(URIS.values(), 0.2) == {URIS[name] for name in ("mine", "127.0.0.9", "192.168.1.5")}
    assert time.monotonic() - began < 3


def test_without_a_network_the_own_names_are_known(names, monkeypatch):
    def fails():
        raise OSError("the kernel is busy")

    monkeypatch.setattr(module, "network", fails)
    assert module.local_hosts() == {"mine", "localhost"}
