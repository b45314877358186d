# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Packets: echo requests, replies and refusals."""

import socket
import struct

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.outcomes import Outcome
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast import packets
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast.packets import echo_request
from hypothesis import given
from hypothesis import strategies as st


def test_echo_request_and_reply():
    request = packets.echo_request(0x1234, 7)
    assert request == bytes.fromhex("0800e5c412340007") and packets.checksum(request) == 0
    head = bytes([0x46]) + bytes(11) + bytes([192, 168, 1, 239]) + bytes([192, 168, 1, 229]) + bytes(4)
    assert packets.echo(head + b"\0" + request[1:], 0x1234) == ("192.168.1.239", 7, Outcome.ANSWERED, 0, 0)
    assert packets.echo(head + request, 0x1234) is None
    assert packets.echo(head + b"\0" + request[1:], 0x4321) is None
    assert packets.echo(head + b"\0\0", 0x1234) is None


def test_a_large_request_has_the_size_that_is_asked_for():
    request = packets.echo_request(0x1234, 7, 1500)
    assert len(request) == 1500 - 20 and packets.checksum(request) == 0
    assert len(packets.echo_request(0x1234, 7, 1)) == 8


def ip(body, source="192.168.1.239", destination="192.168.1.229", options=b""):
    head = struct.pack("!BBHHHBBH", 0x40 | (20 + len(options)) // 4, 0, 20 + len(options) + len(body), 0, 0, 64, 1, 0)
    return head + socket.inet_aton(source) + socket.inet_aton(destination) + options + body


def test_echo_reply_is_ours_by_its_identifier():
    reply = ip(b"\0\0" + echo_request(7, 3)[2:], options=b"\1\1\1\0")
    assert packets.echo(reply, 7) == ("192.168.1.239", 3, Outcome.ANSWERED, 0, 0)
    assert packets.echo(reply, 8) is None
    assert packets.echo(ip(echo_request(7, 3)), 7) is None  # a request, as on the loopback interface


@pytest.mark.parametrize(
    ("kind", "code", "outcome"),
    [
        (3, 0, Outcome.NETWORK_UNREACHABLE),
        (3, 1, Outcome.HOST_UNREACHABLE),
        (3, 13, Outcome.PROHIBITED),
        (3, 4, Outcome.TOO_LARGE),
        (11, 0, Outcome.TIME_EXCEEDED),
        (3, 3, None),
        (5, 1, None),
    ],
)
def test_what_routers_say(kind, code, outcome):
    refusal = struct.pack("!BBHI", kind, code, 0, 0) + ip(echo_request(7, 3), "192.168.1.229", "192.168.1.239")
    heard = packets.echo(ip(refusal, source="192.168.1.1"), 7)
    assert heard == (None if outcome is None else ("192.168.1.1", 3, outcome, kind, code))
    assert packets.echo(ip(refusal), 8) is None


@given(st.binary(max_size=80))
def test_any_packet_is_read(packet):
    packets.echo(packet, 7)
