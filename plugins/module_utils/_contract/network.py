# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The network as a computer sees it, and the computer's packet filter."""

import typing

from .fields import Struct, field
from .outcomes import Outcome


class TargetRoute(Struct):
    """The route that the kernel takes to an address."""

    device: typing.Optional[str] = field("The interface, or null without a route.", "eth0")
    source: typing.Optional[str] = field("The source address, or null without a route.", "192.168.1.229")
    gateway: typing.Optional[str] = field("The gateway, or null if the computer is on the same network.")
    error: str = field("Why there is no route, or empty.", "")
    metric: typing.Optional[str] = field(
        "The metric of the route, or null if it has none.", "100", returned="if there is a route", kept=False
    )


class Ping(Struct):
    """The answer to an ICMP echo request."""

    ok: bool = field("Whether an answer came.", True)
    rtt_ms: typing.Optional[float] = field("The round-trip time in milliseconds, or null without an answer.", 0.4)
    error: str = field("The reason for no answer, for example the report of a router; empty after an answer.", "")
    outcome: Outcome = field(
        "The same as one word, V(answered), V(prohibited), V(time_exceeded), V(too_large), V(wrong_source), or as "
        "RV(masters[].outcome).",
        "answered",
    )
    errno: typing.Optional[int] = field("The number of the error of the kernel here, or null.")
    icmp_type: typing.Optional[int] = field("The type of the ICMP message that came back, or null.", 0)
    icmp_code: typing.Optional[int] = field("Its code, or null.", 0)
    reporter: str = field("The address that sent it, or empty.", "192.168.1.239")


class SeenMember(Struct):
    """A computer of the fleet, seen from another computer. A computer looks up its own name only."""

    name: str = field("The name of the computer.", "kobuki2computer", needed=True)
    address: str = field("Its planned address.", "192.168.1.239")
    addresses: typing.Tuple[str, ...] = field(
        "The IPv4 addresses that its name has on this computer, by the resolver that all programs use.",
        ["192.168.1.239"],
    )
    file_addresses: typing.Tuple[str, ...] = field(
        "The addresses that its name has in C(/etc/hosts).", ["192.168.1.239"]
    )
    resolve_error: str = field("Why the name has none, or empty.", "")
    route: typing.Optional[TargetRoute] = field(
        "The route that the kernel takes to the planned address.", returned="for every other computer"
    )
    discovery_route: typing.Optional[TargetRoute] = field(
        "The route to RV(members[].name)'s O(members[].discovery_address), as RV(members[].route); null if that is its address.",
        returned="for every other computer",
    )
    ping_address: typing.Optional[Ping] = field(
        "Whether an ICMP echo request to the planned address is answered; up to three are sent.",
        returned="for every other computer",
    )
    ping_name: typing.Optional[Ping] = field(
        "The same for the first address that the name has on this computer.", returned="for every other computer"
    )
    ping_large: typing.Optional[Ping] = field(
        "The same for packets to the planned address that are as large as this computer's interface allows, 1500 bytes at most, and "
        "that no router may split. A router that reports that they are too large for the next network is as good as an answer. Null if"
        " small ones are not answered.",
        {
            "ok": True,
            "rtt_ms": 0.5,
            "error": "",
            "outcome": "answered",
            "errno": None,
            "icmp_type": 0,
            "icmp_code": 0,
            "reporter": "192.168.1.239",
        },
        returned="for every other computer",
    )
    neighbour: str = field(
        "The hardware address that this computer knows for the planned address; empty for a computer in another network.",
        "02:42:c0:a8:01:ef",
        returned="for every other computer",
    )
    neighbour_fixed: bool = field(
        "Whether a person or a program has set that hardware address, so that the kernel does not ask for it.",
        False,
        returned="for every other computer",
    )
    user_addresses: typing.Optional[typing.Tuple[str, ...]] = field(
        "The IPv4 addresses that its name has for the user C(nobody), or null if that was not looked up.",
        ["192.168.1.239"],
    )
    loss: typing.Optional[float] = field(
        "The share of 20 further small echo requests to the planned address that have no answer, from 0 to 1; null if none were "
        "sent. In a large fleet they are sent to some of the computers, 32 at most.",
        0.0,
        returned="for every other computer",
    )
    tcp: str = field(
        "If no ping is answered, the answer of TCP port 9 (discard) of the planned address, V(refused) if the computer is there all "
        "the same, or why nothing came back. Empty if a ping is answered.",
        "",
        returned="for every other computer",
    )
    tcp_outcome: Outcome = field(
        "RV(members[].tcp) as one word, a word of RV(masters[].outcome).",
        "not_tried",
        returned="for every other computer",
    )
    silent: bool = field(
        "Whether no ping was answered, and within 3.5 seconds no computer on the way reported a reason, neither this computer's kernel nor a "
        "gateway. If no computer has the next address on the way, they would.",
        False,
        returned="for every other computer",
    )


class Claim(Struct):
    """The ARP answers for an address on a network of the computer: all hardware addresses but the computer's own."""

    address: str = field("The address that was asked for.", "192.168.1.239", needed=True)
    interface: str = field("The interface by which was asked.", "eth0")
    macs: typing.Tuple[str, ...] = field(
        "The hardware addresses of all who answered; for the own address there should be no answer.",
        ["02:42:c0:a8:01:ef"],
    )


class PolicyRouting(Struct):
    """Rules and routes outside of the main table: lines of `ip rule` and of `ip route show table all`."""

    rules: typing.Tuple[str, ...] = field(
        "The rules without the kernel's own, as C(ip rule) prints them, 100 at most.",
        ["100: from all to 192.168.12.0/24 lookup 77"],
    )
    closed: typing.Tuple[str, ...] = field(
        "The routes of all tables that lead nowhere, as C(ip route) prints them, 100 at most.",
        ["blackhole 192.168.12.5"],
    )


class DefaultRoute(Struct):
    """A default route of the computer."""

    device: typing.Optional[str] = field("The interface.", "eth0")
    source: typing.Optional[str] = field("The source address, or null if the route names none.")
    gateway: typing.Optional[str] = field("The gateway, or null if the route names none.", "192.168.1.1")
    metric: typing.Optional[str] = field("The metric, or null if the route names none, which is the metric 0.")


class ForwardingInterface(Struct):
    """The kernel's settings of one interface; a setting is None if it cannot be read."""

    interface: str = field("The interface.", "eth0", needed=True)
    addresses: typing.Tuple[str, ...] = field("Its IPv4 addresses.", ["192.168.1.201"])
    forwarding: typing.Optional[int] = field("Whether packets that come in there are passed on, or null.", 1)
    rp_filter: typing.Optional[int] = field(
        "The effective reverse-path filter, 0 for none, 1 for a strict and 2 for a loose one, or null.", 2
    )
    send_redirects: typing.Optional[int] = field("Whether ICMP redirects are sent there, or null.", 1)
    prefixes: typing.Tuple[int, ...] = field("The length of the network prefix of each of the addresses.", [24])
    mtu: typing.Optional[int] = field(
        "The largest packet that the interface sends, in bytes, or null if it cannot be read.", 1500
    )
    mac: str = field("The hardware address of the interface, or empty.", "02:42:c0:a8:01:c9")
    state: str = field(
        "The operational state of the interface as the kernel reports it, such as V(up) or V(down), or empty.", "up"
    )
    carrier_changes: typing.Optional[int] = field(
        "How often its link came or went since the interface is there, or null if the kernel does not count.", 2
    )
    last: str = field(
        "Of an interface that is down, the last line of the journal about its link, with its time, or empty.",
        "2026-11-22T09:12:44+0000 kobuki2computer kernel: eth0: Link is Down",
    )
    point_to_point: bool = field("Whether the interface is one end of a link with two ends, such as a tunnel.", False)
    power_save: typing.Optional[bool] = field(
        "Whether a wireless interface saves power, as C(iw) reports; null of an access point, of any other interface, and without C(iw).",
        False,
    )
    port_of: str = field(
        "The bridge or bond of which it is a port, or empty. A packet that comes in at a port belongs to the interface above it.",
        "",
    )


class ForwardingSettings(Struct):
    """The settings that decide whether the computer passes packets on."""

    ip_forward: typing.Optional[int] = field("C(net.ipv4.ip_forward), or null if it cannot be read.", 1)
    interfaces: typing.Tuple[ForwardingInterface, ...] = field(
        "The interfaces that have an IPv4 address.",
        [
            {
                "interface": "eth0",
                "addresses": ["192.168.1.201"],
                "forwarding": 1,
                "rp_filter": 2,
                "send_redirects": 1,
                "prefixes": [24],
                "mtu": 1500,
                "mac": "02:42:c0:a8:01:c9",
                "state": "up",
                "carrier_changes": 2,
                "last": "",
                "power_save": None,
            }
        ],
    )
    icmp_echo_ignore_all: typing.Optional[int] = field(
        "C(net.ipv4.icmp_echo_ignore_all), V(1) if the kernel answers no pings, or null if it cannot be read.", 0
    )
    macs: typing.Tuple[str, ...] = field(
        "The hardware addresses of all interfaces that are up, also of those without an address, such as the ports of a bridge.",
        ["02:42:c0:a8:01:c9"],
        added="1.1.0",
    )


class SeenMaster(Struct):
    """The discovery node of a master: its TCP port and its clock, seen from another computer."""

    computer: str = field("The computer that runs the roscore.", "kobuki2computer", needed=True)
    address: str = field("Its address.", "192.168.1.239")
    port: int = field("The TCP port of its discovery node.", 11611)
    open: bool = field("Whether a TCP connection from this computer opens.", True)
    connect_ms: typing.Optional[float] = field("How long that takes in milliseconds, or null.", 0.3)
    error: str = field("Why it does not open, or empty.", "")
    outcome: Outcome = field(
        "The same as one word, V(open), V(refused), V(no_answer), V(network_unreachable), V(host_unreachable), V(unknown_name), "
        "V(failed) or V(not_tried). An error of the kernel here is V(no_local_port) (C(EADDRNOTAVAIL)), V(no_file) (C(EMFILE)), "
        "V(no_file_here) (C(ENFILE)), V(no_memory) (C(ENOBUFS), C(ENOMEM)), V(not_permitted) (C(EPERM), a packet filter), "
        "V(closed_route) (C(EACCES), C(EINVAL), a rule or a route that leads nowhere) or V(reset) (C(ECONNRESET)).",
        "open",
    )
    errno: typing.Optional[int] = field("The number of the error of the kernel here, or null.")
    route: typing.Optional[TargetRoute] = field(
        "The route that the kernel takes to that address, as RV(members[].route)."
    )
    roscore: str = field(
        "The answer of the TCP port of its roscore, by O(masters[].uri), V(open) or why it does not open; empty if the URI is not "
        "given.",
        "open",
    )
    roscore_outcome: Outcome = field("The same as one word, as RV(masters[].outcome).", "open")
    clock_offset_s: typing.Optional[float] = field(
        "How many seconds its clock is ahead of this computer's by C(getCurrentTime), or null without an answer.",
        0.0004,
    )
    clock_uncertainty_s: typing.Optional[float] = field(
        "By how many seconds this may be wrong, half of the round-trip time, or null without an answer.", 0.0007
    )
    clock_error: str = field("Why there was no answer on an open port, or empty.", "")


class FilterRule(Struct):
    """A rule of the packet filter that is understood; an empty field matches everything."""

    verdict: str = field("V(accept), V(drop), V(reject) or V(masquerade).", "accept", needed=True)
    protocol: str = field("V(tcp), V(udp), V(icmp) or the like.", "tcp")
    ports: typing.Tuple[int, ...] = field("The first and the last port of the destination.", [22, 22])
    sources: typing.Tuple[str, ...] = field("The addresses and networks from which it comes.", [])
    destinations: typing.Tuple[str, ...] = field("The addresses and networks to which it goes.", [])
    incoming: str = field("The interface by which it comes in.", "")
    leaving: str = field("The interface by which it goes out.", "")
    state: str = field("The state of its connection, V(new), or V(answer) for all others.", "")
    above: int = field("Only packets of more bytes.", 0)
    chain: str = field("The chain that has the rule.", "input")


class FilterChain(Struct):
    """A chain of the packet filter."""

    hook: str = field("V(input), V(output), V(forward) or V(postrouting).", "forward", needed=True)
    table: str = field("The family and the table.", "ip filter")
    policy: str = field("The fate of a packet that no rule decides about, V(accept) or V(drop).", "drop")
    rules: typing.Tuple[FilterRule, ...] = field(
        "The rules that are understood, those of chains that are jumped to in their place."
    )
    unread: int = field("The number of rules that say more than that.", 0)
    chain: str = field("The name of the chain.", "FORWARD", default="")


class FilterChains(Struct):
    """All chains of the packet filter that may drop something."""

    readable: bool = field("Whether C(nft) is there and prints its rules.", True)
    chains: typing.Tuple[FilterChain, ...] = field(
        "The chains that may drop or translate packets, in the order in which a packet meets them, without the collection's own."
    )
    arp: typing.Tuple[str, ...] = field(
        "The family and the name of each table that drops ARP, whoever asks or answers.",
        ["arp filter"],
        added="1.1.0",
    )
