# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Packets of a run are read from whatever comes; real packets are in plugins/modules/test_multimaster_packet_trace.py."""

import struct

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.network import UpperInterface
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast.packets import checksum
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.trace import capture
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.trace.capture import Tag
from hypothesis import given
from hypothesis import strategies as st

TAG = Tag.from_run("test", [11311])
MACS = ("02:00:00:00:00:01", "02:00:00:00:00:02")


def ipv4(protocol, body, ttl=64, source="10.0.0.1", target="10.0.0.2"):
    ends = bytes(map(int, f"{source}.{target}".split(".")))
    head = struct.pack("!BBHHHBBH", 0x45, 0, 20 + len(body), 0, 0, ttl, protocol, 0) + ends
    return head[:10] + struct.pack("!H", checksum(head)) + head[12:] + body


class Link:
    """A socket in which one packet waits."""

    def __init__(self, kind, protocol=b"\x08\x00", told=capture.IPV4):
        macs = b"".join(bytes.fromhex(mac.replace(":", "")) for mac in MACS[::-1])
        self.packets = [(macs + protocol + ipv4(6, syn()), ("eth0", told, kind, 1, b""))]

    def recvfrom(self, _size):
        if not self.packets:
            raise BlockingIOError
        return self.packets.pop()


def read(data, protocol=capture.IPV4):
    return capture.read_packet(TAG, protocol, data, MACS)


def syn(port=11311, sequence=77, flags=capture.SYN, answered=0):
    return struct.pack("!HHIIBBHHH", 40000, port, sequence, answered, 0x50, flags, 0, 0, 0)


@given(st.binary(max_size=capture.SNAP), st.sampled_from([capture.IPV4, capture.ARP, 0x86DD]))
def test_bytes_of_any_kind_are_read_without_an_error(data, protocol):
    read(data, protocol)


@given(st.binary(max_size=60), st.sampled_from([1, 6, 17]))
def test_bodies_of_any_kind_are_read_without_an_error(body, protocol):
    read(ipv4(protocol, body))
    read(ipv4(1, struct.pack("!BBHI", 3, 1, 0, 0) + ipv4(protocol, body)))


def test_a_connection_and_its_answer_have_one_number():
    asked = read(ipv4(6, syn()))
    answer = struct.pack("!HHIIBBHHH", 11311, 40000, 5, 78, 0x50, capture.SYN | capture.ACK, 0, 0, 0)
    answered = read(ipv4(6, answer, source="10.0.0.2", target="10.0.0.1"))
    assert (asked.kind, asked.sequence, asked.port) == ("request", 77, 11311)
    assert (answered.kind, answered.sequence) == ("answer", 77)
    assert read(ipv4(6, syn(port=22))) is None


@pytest.mark.parametrize(("kind", "code"), [(3, 1), (3, 13), (11, 0)])
def test_an_error_tells_its_sender_and_the_packet(kind, code):
    quoted = ipv4(6, syn()[:8])  # a router quotes eight bytes at least (RFC 792)
    error = read(ipv4(1, struct.pack("!BBHI", kind, code, 0, 0) + quoted, source="10.0.0.254"))
    assert (error.kind, error.icmp_type, error.icmp_code, error.reporter) == ("error", kind, code, "10.0.0.254")
    assert (error.sequence, error.destination) == (77, "10.0.0.2")


def test_what_another_run_has_sent_is_not_read():
    other = Tag.from_run("other")
    assert read(ipv4(17, struct.pack("!HHHH", 1, 2, 0, 0) + other.payload(1))) is None
    assert read(ipv4(17, struct.pack("!HHHH", 1, 2, 0, 0) + TAG.payload(1))).number == 1
    assert read(ipv4(1, struct.pack("!BBHHH", 8, 0, 0, other.identifier, 1))) is None
    assert read(ipv4(1, struct.pack("!BBHHH", 8, 0, 0, TAG.identifier, 1))).number == 1


def test_a_damaged_header_is_told():
    data = bytearray(ipv4(6, syn()))
    data[8] ^= 1
    assert not read(bytes(data)).intact
    assert read(ipv4(6, syn())).intact


def test_an_answer_of_arp_tells_who_has_an_address():
    body = (
        b"\0\1\x08\0\x06\x04\0\2"
        + bytes.fromhex("020000000099")
        + bytes([10, 0, 0, 9])
        + bytes(6)
        + bytes([10, 0, 0, 1])
    )
    told = read(body, capture.ARP)
    assert (told.kind, told.source, told.source_mac, told.destination) == (
        "answer",
        "10.0.0.9",
        "02:00:00:00:00:99",
        "10.0.0.1",
    )


def test_a_redirect_gives_no_packet_up():
    """The router that sends it has passed the packet on."""
    assert read(ipv4(1, struct.pack("!BBHI", 5, 1, 0, 0) + ipv4(6, syn()[:8]), source="10.0.0.254")) is None


def test_a_packet_for_another_computer_has_not_come_in():
    """An interface in promiscuous mode, as a port of a bridge or while tcpdump runs, shows it."""

    assert [len(list(capture.read_packets(Link(kind), TAG, 9, {}))) for kind in (0, capture.FOR_OTHERS)] == [1, 0]


def test_a_port_shows_what_is_for_its_bridge_and_what_has_left():
    for port, kind, count in (
        (UpperInterface("br0", MACS[1]), capture.FOR_OTHERS, 1),
        (UpperInterface("br0", MACS[0]), capture.FOR_OTHERS, 0),
        (UpperInterface("eth0", MACS[1]), capture.OUTGOING, 0),  # it is above another one, which may drop it
    ):
        assert len(list(capture.read_packets(Link(kind), TAG, 9, {"eth0": port}))) == count


def test_what_comes_in_for_a_port_is_for_the_bond_above():
    """A bond with balance-alb tells each neighbour the hardware address of one of its ports (Documentation/networking/bonding.rst)."""
    for kind, mac in ((0, "02:00:00:00:00:99"), (capture.OUTGOING, MACS[1])):
        (found,) = capture.read_packets(Link(kind), TAG, 9, {"eth0": UpperInterface("bond0", "02:00:00:00:00:99")})
        assert found.target_mac == mac


def test_a_tag_in_the_header_is_read_over():
    """The tag is in the header if the interface of a VLAN leaves it in, or if a port cannot put it in itself."""
    (found,) = capture.read_packets(Link(capture.OUTGOING, b"\x81\x00\x00\x0a\x08\x00", capture.VLAN), TAG, 9, {})
    assert (found.port, found.source_mac, found.target_mac) == (11311, *MACS)
