# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Packets of IPv4: copies of UDP datagrams, the ICMP echo request, and the readers of its replies."""

import ctypes
import select
import socket
import struct
import time
import typing

from ..._contract.outcomes import Outcome

HEADERS = 28  # bytes of the headers of IPv4 and ICMP
UDP_HEADER = 8
IP_PKTINFO = 8  # linux/in.h; Python does not name it in every version
ARP_OF_IPV4 = 28  # bytes of an ARP message about IPv4 (RFC 826)
# From linux/in.h; Python's socket has no names for them: set "do not fragment", and do not ask the kernel's own memory.
IP_MTU_DISCOVER, IP_PMTUDISC_PROBE = 10, 3
SO_ATTACH_FILTER = 26  # asm-generic/socket.h; Python does not name it

# RFC 792: (type, code) of the messages that come back instead of an echo reply -> outcome, and words for a sentence
REFUSALS = {
    (3, 0): (Outcome.NETWORK_UNREACHABLE, "network unreachable"),
    (3, 1): (Outcome.HOST_UNREACHABLE, "host unreachable"),
    (3, 4): (Outcome.TOO_LARGE, "packet too large"),
    (3, 9): (Outcome.PROHIBITED, "network administratively prohibited"),
    (3, 10): (Outcome.PROHIBITED, "host administratively prohibited"),
    (3, 13): (Outcome.PROHIBITED, "communication administratively prohibited"),
    (11, 0): (Outcome.TIME_EXCEEDED, "time to live exceeded: the routers pass it round in a circle"),
}


class RawPacket(typing.NamedTuple):
    """One IPv4 packet as a raw socket returns it."""

    source: str
    destination: str
    header: bytes
    body: bytes


class UdpDatagram(typing.NamedTuple):
    """A UDP datagram: the first bytes of its payload, and the length of all of it."""

    source: typing.Tuple[str, int]
    destination: str
    payload: bytes
    length: int


class EchoReply(typing.NamedTuple):
    """The answer to an echo request: a reply, or the refusal of a router."""

    source: str
    sequence: int
    outcome: Outcome
    type: int = 0  # of ICMP
    code: int = 0


def packet(data: bytes) -> typing.Optional[RawPacket]:
    """Split an IPv4 packet (RFC 791, section 3.1); None if it is too short to be one."""
    length = (data[0] & 0x0F) * 4 if data else 0
    if length < 20 or len(data) < length:
        return None
    return RawPacket(socket.inet_ntoa(data[12:16]), socket.inet_ntoa(data[16:20]), data[:length], data[length:])


def attach_filter(link: socket.socket, program: typing.Sequence[typing.Tuple[int, int, int, int]]) -> None:
    """Give a socket a program of classic BPF: code, jump if true, jump if false and operand of each instruction. Raises OSError."""
    code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *line) for line in program))
    link.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, struct.pack("HP", len(program), ctypes.addressof(code)))


def open_copies(port: int) -> socket.socket:
    """Open a raw socket that gets copies of UDP datagrams to a port. Raises OSError.

    It gets 64 bytes of each, and no other traffic: that costs nothing here. The classic BPF program sees the packet from its
    IP header on: x = length of that header; port = 16 bits at x + 2.
    """
    raw = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_UDP)
    raw.setblocking(False)
    attach_filter(raw, ((0xB1, 0, 0, 0), (0x48, 0, 0, 2), (0x15, 0, 1, port), (0x06, 0, 0, 64), (0x06, 0, 0, 0)))
    return raw


def datagram(data: bytes, port: int) -> typing.Optional[UdpDatagram]:
    """Read a UDP datagram to a port out of an IPv4 packet; None for anything else."""
    found = packet(data)
    if found is None or len(found.body) < UDP_HEADER:
        return None
    origin, target, length = struct.unpack("!HHH", found.body[:6])
    if target != port:
        return None
    return UdpDatagram((found.source, origin), found.destination, found.body[UDP_HEADER:], length - UDP_HEADER)


def read_copies(raw: socket.socket, port: int) -> typing.Iterator[typing.Tuple[UdpDatagram, int]]:
    """Yield the datagrams to a port that wait in a raw socket, with the number of their interface; 0 if that is not given (IP_PKTINFO)."""
    for data, ancillary, _flags, _sender in take_waiting(lambda: raw.recvmsg(128, 64)):
        found = datagram(data, port)
        given = [info for level, kind, info in ancillary if (level, kind) == (socket.IPPROTO_IP, IP_PKTINFO)]
        if found:
            yield found, struct.unpack("i", given[0][:4])[0] if given else 0


def take_waiting(take: typing.Callable[[], typing.Any], most: int = 1000) -> typing.Iterator[typing.Any]:
    """Yield the data that waits in a socket that does not block, so much at most; `take` takes one of it."""
    for _unused in range(most):
        try:
            taken = take()
        except OSError:
            return
        yield taken


class Arp(typing.NamedTuple):
    """A message of ARP about IPv4 (RFC 826)."""

    kind: int
    sender: str  # its IPv4 address
    mac: str  # its hardware address
    target: str


def read_arp(data: bytes) -> typing.Optional[Arp]:
    """Read a message of ARP about IPv4; None for anything else."""
    if len(data) < ARP_OF_IPV4 or data[:7] != b"\0\1\x08\0\x06\x04\0":
        return None
    return Arp(data[7], socket.inet_ntoa(data[14:18]), write_mac(data[8:14]), socket.inet_ntoa(data[24:28]))


def write_mac(data: bytes) -> str:
    """Write a hardware address as ip(8) does."""
    return ":".join(f"{byte:02x}" for byte in data)


def checksum(data: bytes) -> int:
    """Compute the Internet checksum (RFC 1071)."""
    data += b"\0" * (len(data) % 2)
    total = sum(struct.unpack(f"!{len(data) // 2}H", data))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF


def echo_request(identifier: int, sequence: int, size: int = 0) -> bytes:
    """Make an ICMP echo request (RFC 792); both numbers have 16 bits. With `size`, the IPv4 packet has so many bytes."""
    head = struct.pack("!BBHHH", 8, 0, 0, identifier, sequence) + bytes(max(0, size - HEADERS))
    return head[:2] + struct.pack("!H", checksum(head)) + head[4:]


def echo(received: bytes, identifier: int) -> typing.Optional[EchoReply]:
    """Read the answer to an echo request of ours out of an IPv4 packet; None for anything else."""
    outer = packet(received)
    if outer is None or len(outer.body) < 8:
        return None
    kind, code, echoed, sequence = struct.unpack("!BB2xHH", outer.body[:8])
    if (kind, code) == (0, 0):
        return EchoReply(outer.source, sequence, Outcome.ANSWERED) if echoed == identifier else None
    inner = packet(outer.body[8:]) if (kind, code) in REFUSALS else None
    if inner is None or len(inner.body) < 8:
        return None
    kind_sent, echoed, sequence = struct.unpack("!B3xHH", inner.body[:8])
    if (kind_sent, echoed) != (8, identifier):
        return None
    return EchoReply(outer.source, sequence, REFUSALS[kind, code][0], kind, code)


def read_echoes(link: socket.socket, identifier: int, deadline: float) -> typing.Iterator[EchoReply]:
    """Yield the answers to our echo requests until the deadline (monotonic seconds)."""
    while time.monotonic() < deadline:
        if not select.select([link], [], [], max(0.0, deadline - time.monotonic()))[0]:
            return
        try:
            answer = echo(link.recv(2048), identifier)
        except OSError:
            continue
        if answer is not None:
            yield answer
