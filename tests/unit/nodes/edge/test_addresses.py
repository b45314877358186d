# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The addresses and links of this computer, as its kernel tells them."""

import select
import socket

from rosfleet_multimaster.edge.addresses import Changes, addresses, network


def test_the_kernel_lists_the_addresses():
    found = addresses()
    assert ("127.0.0.1", socket.if_nametoindex("lo")) in found


def test_the_kernel_lists_interfaces_own_addresses_and_carriers():
    loopback = socket.if_nametoindex("lo")
    found = network()
    assert found.interfaces == dict(addresses()) and found.own >= set(found.interfaces)
    assert loopback in found.running


def test_changes_are_heard_by_a_socket_that_never_blocks():
    changes = Changes()
    changes.clear()
    assert select.select([changes.socket], [], [], 0)[0] == []
    changes.socket.close()
