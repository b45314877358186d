# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The answer of multicast_verify."""

import typing

from .fields import Struct, field


class RoundTrip(Struct):
    """The round-trip times of datagrams between two computers, in milliseconds."""

    min: float = field("The shortest.", 0.4)
    median: float = field("The median.", 0.6)
    max: float = field("The longest.", 1.9)


class GroupRoute(Struct):
    """The route that the kernel takes to the group."""

    device: typing.Optional[str] = field("The interface, or null when there is no route.", "eth0")
    source: typing.Optional[str] = field("The source address, or null when there is no route.", "192.168.1.229")


class DatagramCounts(Struct):
    """The datagrams between the computer and another computer; None if no count came back."""

    name: str = field("The name of the other computer.", "kobuki2computer", needed=True)
    address: str = field("Its planned address.", "192.168.1.239")
    multicast: bool = field("Whether O(group) is to reach both computers, by O(computers[].multicast).", True)
    heard_from: bool = field("Whether its datagrams to the group arrive here, on the planned interface.", True)
    heard: int = field("How many of them arrived since this computer's helper was started.", 14)
    source_address: typing.Optional[str] = field(
        "The source address of these datagrams, or null without any. Another one than RV(udp[].address) means address translation.",
        "192.168.1.239",
    )
    other_interfaces: typing.Tuple[str, ...] = field("Other interfaces of this computer on which they arrive.", [])
    heard_by: typing.Optional[bool] = field(
        "Whether the other computer heard this computer's datagrams to the group while it measured, by its own count. Null when no "
        "count came back, which proves nothing (its own RV(udp[].heard_from) then shows it), and if O(computers[].multicast=false) for "
        "one of the two.",
        True,
    )
    loss: typing.Optional[float] = field(
        "The share of this computer's datagrams to the group that the other did not hear, from 0 to 1. Null without a count, and if "
        "O(computers[].multicast=false) for one of the two.",
        0.0,
    )
    own_source_address: typing.Optional[str] = field(
        "The source address from which the other computer sees this one, or null without an answer.", "192.168.1.229"
    )
    unicast: typing.Optional[bool] = field(
        "Whether it received unicast datagrams from this computer on O(port), or null without an answer or with O(unicast=false).",
        True,
    )
    rtt_ms: typing.Optional[RoundTrip] = field(
        "The round-trip time of unicast datagrams between the two helpers, in milliseconds, or null without an answer.",
        kept=False,
    )
    clock_offset_s: typing.Optional[float] = field(
        "How many seconds the other computer's clock is ahead of this one's, or null without an answer.",
        -0.0021,
        kept=False,
    )


class GroupMembership(Struct):
    """A multicast group that programs of the computer have joined on an interface; the measurement does not count."""

    interface: str = field("The name of the interface.", "eth0", needed=True)
    group: str = field("The address of the group.", "226.0.0.0", needed=True)
    users: int = field("How many sockets, or parts of the kernel, are members.", 1, default=1)
    family: str = field("V(ipv4) or V(ipv6).", "ipv4", kept=False)
    querier: typing.Optional[str] = field(
        "The IGMP version that the interface speaks, after the queries it last heard. No proof that a querier lives. Null for IPv6.",
        "V2",
        kept=False,
    )


class Stranger(Struct):
    """An address outside the fleet from which datagrams came on the group."""

    address: str = field("The source address.", "192.168.1.77", needed=True)
    interface: str = field("The interface on which they arrived.", "eth0", needed=True)
    datagrams: int = field("How many arrived since this computer's helper was started.", 3)


class LocalCaller(Struct):
    """An address from which empty datagrams came to the computer itself."""

    address: str = field("The source address.", "192.168.11.100", needed=True)
    datagrams: int = field("How many arrived.", 3)


class IcmpRound(Struct):
    """One ping of a multicast group: the names of the computers that answered."""

    round: int = field("The number of the round, from 1.", 1, needed=True)
    answered: typing.Tuple[str, ...] = field("The names of the computers that answered.", ["kobuki2computer"])
    missing: typing.Tuple[str, ...] = field("The names of the computers that did not answer.", [], kept=False)
    unexpected: typing.Tuple[str, ...] = field(
        "The addresses that answered and are no computers of the fleet.", [], kept=False
    )


class Icmp(Struct):
    """The pings of a multicast group."""

    group: str = field("The group that was asked.", "224.0.0.1", needed=True)
    error: typing.Optional[str] = field("Why the rounds could not be done, or null.")
    rounds: typing.Tuple[IcmpRound, ...] = field("At most five rounds.")
    echo_ignore_broadcasts: int = field(
        "The value of C(net.ipv4.icmp_echo_ignore_broadcasts) on this computer; with 1 it does not answer the others.",
        0,
        kept=False,
    )


class SendErrors(Struct):
    """The datagrams that the kernel refused to send."""

    count: int = field("How many.", 0)
    last: typing.Optional[str] = field(
        "The destination and the error of the last one, or null.", "226.0.0.0:11511: Operation not permitted"
    )


class Multicast(Struct, returned="when O(action=collect)"):
    """The answer of multicast_verify."""

    memberships: typing.Tuple[GroupMembership, ...] = field(
        "The multicast groups of every interface, from C(/proc/net/igmp) and C(/proc/net/igmp6), without the helper's own membership.",
        returned="always",
    )
    udp: typing.Tuple[DatagramCounts, ...] = field(
        "For every other computer, the result of UDP datagrams on the group and port."
    )
    unexpected: typing.Tuple[Stranger, ...] = field(
        "Sources of datagrams on the group and port that are no computers of the fleet."
    )
    callers: typing.Tuple[LocalCaller, ...] = field(
        "The senders of empty datagrams to O(port) of this computer itself since the helper was started. A computer that has sent some "
        "and is not among them is seen from another address, or its datagrams are dropped."
    )
    icmp: typing.Optional[Icmp] = field(
        "The rounds of ICMP echo requests. A host whose C(net.ipv4.icmp_echo_ignore_broadcasts) is 1, the kernel's default, never "
        "answers, though multicast works; and an answer says nothing on UDP and another group. Null with O(icmp=false)."
    )
    send_errors: SendErrors = field(
        "How many datagrams this computer's kernel refused to send, for example because of a firewall's output rule.",
        {"count": 0, "last": None},
    )
    route: GroupRoute = field(
        "The interface by which a program's datagrams to the group leave, if it does not choose an interface itself.",
        returned="always",
        kept=False,
    )
    interface: typing.Optional[str] = field(
        "The interface that has O(interface_address), or null when that option is not given.",
        "eth0",
        returned="always",
        kept=False,
    )
    heard: typing.Tuple[str, ...] = field("The names of the computers that are heard.", ["kobuki2computer"], kept=False)
    missing: typing.Tuple[str, ...] = field(
        "The names of the computers that are not heard, or that counted none of this computer's datagrams; if the group does not "
        "reach one of the two, by unicast.",
        [],
        kept=False,
    )
    unanswered: typing.Tuple[str, ...] = field(
        "The names of the computers that are heard, but gave no count, so that it is unknown here whether they hear this one.",
        [],
        kept=False,
    )
    multicast_ok: bool = field(
        "Whether it is proven for every other computer that it is heard and hears this one, that is, none is missing or unanswered.",
        True,
        kept=False,
    )
    msg: str = field(
        "The result, in a sentence or a few; of missing computers also the likely causes.",
        "Every other computer (1) is heard on the group and hears this one.",
        returned="always",
        kept=False,
    )
