# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Packets of one run, as they come in and go out: a packet socket, its filter in the kernel, and the reader of its data.

The filter lets through the packets of this run, its answers, the ICMP errors, and ARP. So the other traffic of a robot costs
nothing, and the socket needs no promiscuous mode: a packet with the hardware address of another computer is not its business.

An interface above others, as that of a VLAN, a bridge or a bond, shows a packet once more: first as it goes out, last as it comes in.
A packet with the tag of a VLAN (802.1Q) has come in only if the VLAN's interface shows it, without the tag.
"""

import contextlib
import hashlib
import socket
import struct
import typing

from ..._machine.network import UpperInterface
from ..multicast.packets import ARP_OF_IPV4, attach_filter, checksum, packet, read_arp, take_waiting, write_mac

ANY_PROTOCOL = 3  # ETH_P_ALL of linux/if_ether.h: only such a socket gets outgoing packets
IPV4, ARP, VLAN = 0x0800, 0x0806, 0x8100
TAGS = (b"\x81\x00", b"\x88\xa8")  # begin a tag of four bytes in a header of Ethernet (802.1Q, 802.1ad)
ICMP, TCP, UDP = 1, 6, 17
FOR_US, FOR_OTHERS, OUTGOING = 0, 3, 4  # PACKET_HOST, PACKET_OTHERHOST and PACKET_OUTGOING of linux/if_packet.h
SOL_PACKET, PACKET_STATISTICS = 263, 6  # packet(7): two numbers, of all packets and of those without room
SO_RCVBUFFORCE = 33  # asm-generic/socket.h
ROOM = 4 << 20  # bytes for packets that wait; a flood of ARP comes while rules are read
WITH_HEADER = (1, 772)  # ARPHRD_ETHER and ARPHRD_LOOPBACK of linux/if_arp.h: interfaces with a header of Ethernet
ETHERNET = 14  # bytes of that header
MOST_WAITING = 10_000  # packets that wait in a socket
SNAP = 192  # bytes of a packet that are read
SYN, RST, ACK = 0x02, 0x04, 0x10  # flags of TCP (RFC 9293)
# Types of ICMP that quote a packet which was given up (RFC 792). The one of a redirect goes on.
ERRORS = (3, 11, 12)
REQUEST, ANSWER, ERROR = "request", "answer", "error"

# Offsets of linux/filter.h: the fields that the kernel knows of a packet, and its network header, whatever comes before it
SKF_AD_PROTOCOL, NETWORK = 0xFFFFF000, 0xFFF00000
SKF_AD_PKTTYPE, SKF_AD_VLAN_TAG, SKF_AD_VLAN_TAG_PRESENT = (SKF_AD_PROTOCOL + more for more in (4, 44, 48))
# Classic BPF (kernel: Documentation/networking/filter.rst): code of each instruction that is used here
LOAD_WORD, LOAD_BYTE, LOAD_HALF_AT, LOAD_BYTE_AT, LOAD_WORD_AT = 0x20, 0x30, 0x48, 0x50, 0x40
LOAD_HALF, MASK, SHIFT, TO_INDEX, EQUAL, ANY_BIT, RETURN = 0x28, 0x54, 0x64, 0x07, 0x15, 0x45, 0x06


class Tag(typing.NamedTuple):
    """The mark of a run on its packets."""

    word: int  # the first 32 bits of a datagram's payload
    identifier: int  # of ICMP echo requests
    ports: typing.Tuple[int, ...]  # to which connections are opened

    @classmethod
    def from_run(cls, run: str, ports: typing.Iterable[int] = ()) -> "Tag":
        """Make the tag of a run from its label."""
        word, identifier = struct.unpack("!IH", hashlib.sha256(b"follow " + run.encode()).digest()[:6])
        return cls(word, identifier, tuple(sorted(set(ports))))

    def payload(self, number: int) -> bytes:
        """Return the payload of the datagram with a number."""
        return struct.pack("!IB", self.word, number)


class Capture(typing.NamedTuple):
    """A packet of the run, at one interface of this computer."""

    interface: str
    outgoing: bool
    kind: str  # request, answer or error
    protocol: str  # icmp, tcp, udp or arp
    source: str  # IPv4 address; of an ARP message, of the computer that sends it
    destination: str  # IPv4 address; of an ARP message, the one that is asked for, or answered
    source_port: int
    port: int
    number: int  # of the probe, in ICMP and UDP; -1 in others
    sequence: int  # of TCP: the first number of the connection (RFC 9293), which every router leaves as it is
    ttl: int
    length: int  # bytes of the IPv4 packet
    intact: bool  # its header has the right checksum
    source_mac: str
    target_mac: str
    icmp_type: int = -1  # of an error
    icmp_code: int = -1
    reporter: str = ""  # the address that sends the error


# The filter


# The program for all runs: (code, jump if true, jump if false, operand); a jump names a block, or counts the blocks that it leaves out
_TAGS: typing.List[typing.Tuple] = [
    (LOAD_WORD, 0, 0, SKF_AD_VLAN_TAG_PRESENT),
    (EQUAL, "kinds", 0, 0),
    (LOAD_WORD, 0, 0, SKF_AD_PKTTYPE),
    (EQUAL, "kinds", 0, OUTGOING),
    (LOAD_WORD, 0, 0, SKF_AD_VLAN_TAG),  # the number may be that of an earlier packet if this one has no tag
    (ANY_BIT, "refuse", 0, 0x0FFF),  # without a number it only has a priority
]
_KINDS: typing.List[typing.Tuple] = [
    (LOAD_WORD, 0, 0, SKF_AD_PROTOCOL),
    (EQUAL, "accept", 0, ARP),
    (EQUAL, "ipv4", 0, IPV4),
    (EQUAL, 0, "refuse", VLAN),  # it goes out, and the interface cannot put the tag in
    (LOAD_HALF, 0, 0, NETWORK),
    (EQUAL, "accept", 0, 1),  # so begins ARP
    (MASK, 0, 0, 0xF000),
    (EQUAL, 0, "refuse", 0x4000),
]
_IPV4: typing.List[typing.Tuple] = [
    (LOAD_HALF, 0, 0, NETWORK + 6),
    (ANY_BIT, "refuse", 0, 0x1FFF),  # a later fragment has no ports
    (LOAD_BYTE, 0, 0, NETWORK),
    (MASK, 0, 0, 0x0F),
    (SHIFT, 0, 0, 2),
    (TO_INDEX, 0, 0, 0),  # the length of the IPv4 header
    (LOAD_BYTE, 0, 0, NETWORK + 9),
    (EQUAL, "tcp", 0, TCP),
    (EQUAL, "udp", 0, UDP),
    (EQUAL, 0, "refuse", ICMP),
    (LOAD_BYTE_AT, 0, 0, NETWORK),
]


def make_filter(tag: Tag) -> typing.List[typing.Tuple[int, int, int, int]]:
    """Return the program that lets packets of a run through."""
    icmp: typing.List[typing.Tuple] = [(EQUAL, "accept", 0, kind) for kind in ERRORS]
    icmp += [(LOAD_HALF_AT, 0, 0, NETWORK + 4), (EQUAL, "accept", "refuse", tag.identifier)]
    udp: typing.List[typing.Tuple] = [(LOAD_WORD_AT, 0, 0, NETWORK + 8), (EQUAL, "accept", "refuse", tag.word)]
    tcp: typing.List[typing.Tuple] = [(LOAD_BYTE_AT, 0, 0, NETWORK + 13), (ANY_BIT, 0, "refuse", SYN | RST)]
    for offset in (2, 0):
        tcp += [(LOAD_HALF_AT, 0, 0, NETWORK + offset)]
        tcp += [(EQUAL, "accept", 0, port) for port in tag.ports]
    blocks = {"tags": _TAGS, "kinds": _KINDS, "ipv4": _IPV4, "icmp": icmp, "udp": udp, "tcp": tcp}
    blocks.update(refuse=[(RETURN, 0, 0, 0)], accept=[(RETURN, 0, 0, SNAP)])
    lines: typing.List[typing.Tuple] = []
    places = {}
    for name, block in blocks.items():
        places[name] = len(lines)
        lines += block
    return [
        (code, *(places[to] - place - 1 if isinstance(to, str) else to for to in jumps), operand)
        for place, (code, *jumps, operand) in enumerate(lines)
    ]


def open_socket(tag: Tag) -> socket.socket:
    """Open the packet socket of a run; needs root. Raises OSError."""
    link = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ANY_PROTOCOL))
    try:
        link.setblocking(False)
        attach_filter(link, make_filter(tag))
        with contextlib.suppress(OSError):  # without CAP_NET_ADMIN
            link.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, ROOM)
        with contextlib.suppress(BlockingIOError):
            for _packet in range(MOST_WAITING):
                link.recv(1)  # it came before the filter was set
        count_lost(link)
    except OSError:
        link.close()
        raise
    return link


def count_lost(link: socket.socket) -> int:
    """Count the packets for which the socket had no room since the last call."""
    return int(struct.unpack("II", link.getsockopt(SOL_PACKET, PACKET_STATISTICS, 8))[1])


# The reader


def read_packets(
    link: socket.socket, tag: Tag, most: int, ports: typing.Mapping[str, UpperInterface]
) -> typing.Iterator[Capture]:
    """Yield the packets of a run that wait in the socket, so many at most. `ports`: the interfaces below a bridge or a bond."""
    above = {port.master for port in ports.values()}
    for data, (interface, protocol, kind, hardware, _sender) in take_waiting(lambda: link.recvfrom(SNAP), most):
        header, protocol = _find_network_header(data, hardware, protocol)
        macs = (write_mac(data[6:12]), write_mac(data[:6])) if header else ("", "")
        if kind == FOR_OTHERS and (interface not in ports or macs[1] != ports[interface].mac):
            continue  # a foreign program has set an interface to promiscuous mode
        if kind == FOR_US and interface in ports:  # a bond may send others the hardware addresses of its ports
            macs = (macs[0], ports[interface].mac)
        found = read_packet(tag, protocol, data[header:], macs)
        if found is None or interface == "lo":
            continue
        if kind == OUTGOING and interface in above and found.protocol != "arp":
            continue  # it has left if a port shows it, and may be dropped before
        yield found._replace(interface=interface, outgoing=kind == OUTGOING)


def _find_network_header(data: bytes, hardware: int, protocol: int) -> typing.Tuple[int, int]:
    """Return the place at which the network header begins, behind the tags of VLANs, and its protocol."""
    header = ETHERNET if hardware in WITH_HEADER else 0
    while header and data[header - 2 : header] in TAGS:
        header += 4
        protocol = int.from_bytes(data[header - 2 : header], "big")
    return header, protocol


def read_packet(tag: Tag, protocol: int, data: bytes, macs: typing.Tuple[str, str]) -> typing.Optional[Capture]:
    """Read a packet without its header of Ethernet, whose hardware addresses are `macs`; None for one of no run of ours."""
    if protocol == ARP:
        return _read_arp(data, macs)
    found = _read_ipv4(tag, data, macs)
    if found is None or found.kind != ERROR:
        return found
    quoted = _read_ipv4(tag, data[(data[0] & 0x0F) * 4 + 8 :], macs)
    if quoted is None or quoted.kind == ERROR:
        return None
    return quoted._replace(
        kind=ERROR,
        ttl=found.ttl,
        length=found.length,
        intact=found.intact,
        icmp_type=found.icmp_type,
        icmp_code=found.icmp_code,
        reporter=found.source,
    )


def _read_arp(data: bytes, macs: typing.Tuple[str, str]) -> typing.Optional[Capture]:
    """Read a message of ARP. An answer comes from the computer that has its source address."""
    found = read_arp(data)
    kind = {1: REQUEST, 2: ANSWER}.get(found.kind) if found else None
    if found is None or kind is None:
        return None
    return Capture(
        "", False, kind, "arp", found.sender, found.target, 0, 0, -1, 0, 0, ARP_OF_IPV4, True, found.mac, macs[1]
    )


def _read_ipv4(tag: Tag, data: bytes, macs: typing.Tuple[str, str]) -> typing.Optional[Capture]:
    """Read a packet of IPv4, or the beginning of one that an ICMP error quotes."""
    found = packet(data)
    if found is None or len(found.body) < 8:
        return None
    length, ttl, number = struct.unpack("!2xH4xBB", found.header[:10])
    intact = checksum(found.header) == 0
    plain = Capture("", False, REQUEST, "", found.source, found.destination, 0, 0, -1, 0, ttl, length, intact, *macs)
    reader = _READERS.get(number)
    return reader(tag, plain, found.body) if reader else None


def _read_icmp(tag: Tag, plain: Capture, body: bytes) -> typing.Optional[Capture]:
    kind, code, identifier, number = struct.unpack("!BB2xHH", body[:8])
    plain = plain._replace(protocol="icmp", number=number)
    if kind in ERRORS:
        return plain._replace(kind=ERROR, icmp_type=kind, icmp_code=code)
    if identifier != tag.identifier or kind not in (0, 8):
        return None
    return plain._replace(kind=REQUEST if kind else ANSWER)


def _read_tcp(tag: Tag, plain: Capture, body: bytes) -> typing.Optional[Capture]:
    """Read the first packets of a connection. An answer has the next number of the request (RFC 9293, section 3.5)."""
    source, target, sequence = struct.unpack("!HHI", body[:8])
    if not {source, target} & set(tag.ports):
        return None
    flags = body[13] if len(body) > 13 else SYN  # an error quotes only eight bytes, and requests are refused
    plain = plain._replace(protocol="tcp", source_port=source, port=target, sequence=sequence)
    if flags & ACK and flags & (SYN | RST):
        answered = struct.unpack("!I", body[8:12])[0]
        return plain._replace(kind=ANSWER, sequence=(answered - 1) & 0xFFFFFFFF)
    return plain


def _read_udp(tag: Tag, plain: Capture, body: bytes) -> typing.Optional[Capture]:
    """Read a datagram. An error may quote only eight bytes of it, so its number is not known."""
    source, target = struct.unpack("!HH", body[:4])
    word, number = struct.unpack("!IB", body[8:13]) if len(body) >= 13 else (tag.word, -1)
    if word != tag.word:
        return None
    return plain._replace(protocol="udp", source_port=source, port=target, number=number)


_READERS = {ICMP: _read_icmp, TCP: _read_tcp, UDP: _read_udp}
