# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults of packet filters. Ids RF-3xx: the tens say which packets are dropped, the last digit in which direction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from .fault import ALWAYS, COMPUTERS, Fault, Key, hand, on, site

RULES = on("nft -a list ruleset; iptables -S")
FORWARDED = on("nft -a list ruleset; iptables -S FORWARD")
LARGE = "large"  # the mode of a rule for the size of packets


class Dropped(NamedTuple):
    """A kind of packets that a filter may drop."""

    id: int  # the tens of the id
    words: str
    match: str  # as nft has it; empty for all packets
    option: str  # the same, as iptables has it
    what: str = ""
    more: float = 0.0  # its extra cost, compared with the others


#: mode -> its packets. {what} is a port, or a size in bytes.
DROPPED: Mapping[str, Dropped] = {
    "icmp": Dropped(31, "ICMP", "meta l4proto icmp", "-p icmp"),
    "udp": Dropped(32, "packets for UDP port {what}", "udp dport {what}", "-p udp --dport {what}", "11511"),
    "group": Dropped(33, "packets for the multicast group", "ip daddr 224.0.0.0/4", "-d 224.0.0.0/4", more=0.2),
    "rpc": Dropped(
        34, "connections to TCP port {what} of the discovery node", "tcp dport {what}", "-p tcp --dport {what}", "11611"
    ),
    "roscore": Dropped(
        35, "connections to TCP port {what} of the roscore", "tcp dport {what}", "-p tcp --dport {what}", "11311"
    ),
    "nodes": Dropped(36, "connections to the TCP ports of nodes", "tcp dport 1024-65535", "-p tcp --dport 1024:65535"),
    "all": Dropped(37, "packets that no rule of it lets pass", "", "", more=0.3),
    LARGE: Dropped(
        38, "packets of more than {what} bytes", "meta length gt {what}", "-m length --length {what}:65535", "1400", 0.5
    ),
}
#: direction in the mode -> the last digit of the id, the word in a sentence, the extra cost
DIRECTIONS: Mapping[str, tuple[int, str, float]] = {
    "in": (1, "incoming", 0.2),
    "out": (2, "outgoing", 0.8),
    "": (3, "incoming and outgoing", 0.4),
}
#: the traffic that is accepted, for a person
ACCEPTED: Mapping[str, str] = {
    "icmp": "ICMP",
    "udp": "UDP port {what}",
    "group": "the multicast group, and IGMP",
    "rpc": "TCP port {what}",
    "roscore": "TCP port {what}",
    "nodes": "TCP ports 1024 to 65535",
    "all": "ICMP, UDP port 11511 and TCP ports 1024 to 65535",
    LARGE: "packets of any size",
}
MAKERS = "in the program that makes its rules, such as ufw, firewalld, Docker or nftables.conf"

FILTERS: Mapping[Key, Fault] = {
    ("filter", f"{mode} {direction}".strip()): Fault(
        f"RF-{dropped.id}{digit}",
        f"a packet filter on {{place}} drops {word} {dropped.words}",
        do=(hand(f"accept {ACCEPTED[mode]} between the robots' networks on {{place}}, {MAKERS}"),),
        look=(RULES,),
        cost=2.5 + dropped.more + more,
        why="filters let in less than they let out, and seldom name one kind of packets",
        what=dropped.what,
    )
    for mode, dropped in DROPPED.items()
    for direction, (digit, word, more) in DIRECTIONS.items()
}

GATEWAYS: Mapping[Key, Fault] = {
    ("filter", "forward"): Fault(
        "RF-301",
        "a packet filter on {place} drops {what} meant for another network",
        do=(
            hand(
                f"accept packets that are forwarded between the robots' networks on {{place}}, {MAKERS} (with Docker in the chain DOCKER-USER)"
            ),
        ),
        look=(FORWARDED,),
        cost=2.5,
        why="Docker and ufw drop packets that they forward",
        what="what is",
    ),
    ("filter", "changed"): Fault(
        "RF-302",
        "the packet filter of {place} is not as planned",
        do=(site("loads the planned rules"),),
        look=(RULES, on("journalctl -b -u multimaster-firewall -u nftables -u ufw -u firewalld")),
        hard=False,
        read=ALWAYS,
        why="the rules were read",
    ),
    ("filter", "pair"): Fault(
        "RF-303",
        "something drops packets between {place}, and between nobody else: a packet filter or a route with the other's address",
        do=(hand("delete the rule or the route with the other's address, on {place} or on a gateway between them"),),
        look=(on("nft -a list ruleset; ip rule; ip route"),),
        cost=6.0,
        why="few rules are about a single pair",
        at=COMPUTERS,
    ),
}

#: The packet filters that a rule shows, if rules can be read.
RULED = frozenset({*FILTERS, ("filter", "forward")})
