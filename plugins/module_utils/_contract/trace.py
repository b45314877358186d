# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The answers of multimaster_packet_trace."""

import typing

from .fields import Struct, field
from .outcomes import Outcome


class SentProbe(Struct):
    """The end of a probe, as its sender knows it."""

    number: int = field("The number of the probe.", 0, needed=True)
    outcome: Outcome = field(
        "The outcome as one word, as RV(rosfleet.multimaster.multimaster_verify#module:members) has it, for example V(refused). "
        "Datagrams that were sent have V(no_answer).",
        "no_answer",
    )
    errno: typing.Optional[int] = field(
        "The number of the kernel's error, for example V(99) (EADDRNOTAVAIL); none without an error.", 110
    )
    source_port: int = field("The local port, or V(0).", 40132)
    data: Outcome = field("The outcome of a question in an open connection, as one word.", "not_tried")
    unconfirmed: int = field(
        "The number of packets of this question that the other kernel has not confirmed. A program that hangs has confirmed them.",
        0,
    )


class CapturedPacket(Struct):
    """A packet at an interface of a computer."""

    interface: str = field("The interface.", "eth0", needed=True)
    outgoing: bool = field("Whether it went out, and did not come in.", True, needed=True)
    kind: str = field(
        "V(request), V(answer), or V(error) for an ICMP error that quotes the packet.", "request", needed=True
    )
    protocol: str = field("V(icmp), V(tcp), V(udp) or V(arp).", "tcp", needed=True)
    source: str = field(
        "The IPv4 address of the sender; of an ICMP error that of the quoted packet.", "192.168.1.229", needed=True
    )
    destination: str = field(
        "The IPv4 address of the receiver; of an ARP message the one that is asked for.", "192.168.1.239", needed=True
    )
    source_port: int = field("The port of the sender, or V(0).", 40132)
    port: int = field("The port of the receiver, or V(0).", 11311)
    number: int = field("The number of the probe in echo requests and datagrams; else V(-1).", -1, default=-1)
    sequence: int = field(
        "The first sequence number of a connection. Routers leave it as it is, so it is the same on every computer.",
        2868410113,
    )
    ttl: int = field("The time to live with which it was seen.", 64)
    length: int = field("The bytes of the IPv4 packet.", 60)
    intact: bool = field("Whether its IPv4 header has the right checksum.", True, default=True)
    source_mac: str = field(
        "The hardware address from which it came; empty on an interface without such addresses.", "02:42:c0:a8:01:e5"
    )
    target_mac: str = field("The hardware address to which it went.", "02:42:c0:a8:01:ef")
    icmp_type: int = field("The type of an ICMP error; else V(-1).", -1, default=-1)
    icmp_code: int = field("The code of an ICMP error; else V(-1).", -1, default=-1)
    reporter: str = field("The address that has sent an ICMP error; else empty.", "")


class Counter(Struct):
    """A counter of the kernel, or a rule of the packet filter, and by how much it has grown."""

    counter: str = field(
        "The name of the counter, the rule, or the reason as C(drop reason NETFILTER_DROP).",
        "IpInHdrErrors",
        needed=True,
    )
    more: int = field("By how much it has grown.", 3)


class SentProbes(Struct, returned="when O(action=send)"):
    """The result of multimaster_packet_trace with `action: send`."""

    sent: typing.Tuple[SentProbe, ...] = field("The fate of each probe of this computer, as far as it knows itself.")


class SeenPackets(Struct, returned="when O(action=collect)"):
    """The result of multimaster_packet_trace with `action: collect`."""

    seen: typing.Tuple[CapturedPacket, ...] = field(
        "The packets that came in and went out here, in the order of time, 500 of each protocol at most, and 100 of one sender among "
        "them."
    )
    missed: int = field(
        "How many packets came beyond the 500 of a protocol, also those for which the kernel had no room.", 0
    )
    full: typing.Tuple[str, ...] = field(
        "The addresses that have sent more than 100 packets of a protocol, of which no more were kept, for example V([192.168.1.77]).",
        [],
    )
    counters: typing.Tuple[Counter, ...] = field(
        "Counters of packets that were given up which have grown meanwhile, 60 at most. They are those of C(/proc/net/snmp), "
        "C(/proc/net/netstat), C(/proc/net/dev) and conntrack, rules of nftables that drop or reject and count, and the reasons for "
        "which the kernel has dropped packets of IPv4 or ARP (C(skb:kfree_skb) in C(/sys/kernel/tracing), since Linux 5.17)."
    )
    fixed: typing.Tuple[str, ...] = field(
        "The hardware addresses of neighbours that a person or a program has set.", []
    )


class TraceAnswer(Struct):
    """The answer of each action of multimaster_packet_trace."""

    msg: str = field("The result, in a sentence.", "Saw 14 packets.")
