# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults that nobody foresaw: drawn by a seed out of what can be altered on a Linux computer between two ROS nodes. Pure.

Each kind is a row of KINDS: a function that draws a fault on a computer of the lab. The oracle is where it was made. Whether it breaks
anything is found out in the lab (harm.py); one that breaks nothing is drawn again.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count

from catalogue import Fault, Step
from setups import people_nodes
from setups.people_nodes import (
    BRIDGED,
    BRIDGED_ADDRESS,
    BRIDGED_AS_COMPUTER,
    DOCKER,
    GONE,
    HUNG,
    Wrong,
    announce,
    use_roscore,
)

GATES = ("tibi-gate", "dabo-gate")
MASTERS = ("kobuki-pc", *GATES)
COMPUTERS = (*MASTERS, "tibi-arm", "dabo-arm")
ROBOT = {name: name.partition("-")[0] for name in COMPUTERS}
UNITS = ("roscore", "discovery", "sync")
PORTS = (11311, 11611)
SOME = "192.168.66.0/24"  # a network of no computer


@dataclass(frozen=True)
class Draw:
    """A fault that was drawn: what is done on its computer, what takes it back, and the kinds of parts that say it."""

    title: str
    inject: str
    undo: str
    parts: tuple[str, ...]  # kinds of plugin_utils/_verify/components/component.py
    also: tuple[str, ...] = ()  # other computers where it may be named, since they have to do with it


class Place:
    """The dice, and the computer on which the fault is made."""

    def __init__(self, dice: random.Random, facts: Mapping[str, str], host: str) -> None:
        self.dice, self.facts, self.host = dice, facts, host
        self.gate = host in GATES

    def choose(self, options: Sequence[str]) -> str:
        """Choose one of these."""
        return self.dice.choice(options)

    def other(self) -> str:
        """Choose another computer."""
        return self.choose([name for name in COMPUTERS if name != self.host])

    def address(self, name: str) -> str:
        """The address by which this computer reaches another one."""
        return self.facts[name if ROBOT[name] == ROBOT[self.host] else f"{name}.common" if name in GATES else name]

    def interface(self) -> str:
        """The shell's words for one interface of this computer: a gateway has two."""
        networks = [self.facts[self.host], *([self.facts[f"{self.host}.common"]] if self.gate else [])]
        return f"$(ip -4 -o address show to {self.choose(networks)} | cut -d' ' -f2)"


def _sysctl(place: Place) -> Draw:
    rows = [
        ("net.ipv4.ip_default_ttl", place.choose(["1", "2"]), "64", ("setting",)),
        ("net.ipv4.icmp_echo_ignore_all", "1", "0", ("setting",)),
        ("net.ipv4.conf.all.arp_ignore", "8", "0", ("neighbour",)),
        ("net.ipv4.ip_local_port_range", "65535 65535", "32768 60999", ("computer",)),
    ]
    if place.gate:
        rows += [
            ("net.ipv4.ip_forward", "0", "1", ("forwarding",)),
            ("net.ipv4.conf.all.rp_filter", "1", "2", ("reverse_path",)),
        ]
    name, value, usual, parts = place.dice.choice(rows)
    return Draw(f"{name} is {value}", f"sysctl -w {name}='{value}'", f"sysctl -w {name}='{usual}'", parts)


def _neighbour(place: Place) -> Draw:
    near = [
        name
        for name in COMPUTERS
        if name != place.host and (ROBOT[name] == ROBOT[place.host] or {name, place.host} <= set(MASTERS))
    ]
    address = place.address(place.choose(near))
    mac = f"02:00:00:{place.dice.randrange(256):02x}:{place.dice.randrange(256):02x}:66"
    made = f"ip neighbour replace {address} lladdr {mac} nud permanent dev $(ip -o route get {address} | sed 's/.* dev \\([^ ]*\\).*/\\1/')"
    return Draw(f"{address} has another hardware address", made, "ip neighbour flush nud permanent", ("neighbour",))


def _route(place: Place) -> Draw:
    address = place.address(place.other())
    kind, table = place.choose(["blackhole", "unreachable", "prohibit"]), place.choose(["main", "main", "77"])
    words = f"{kind} {address} table {table}"
    made, back = f"ip route add {words}", f"ip route del {words}"
    if table != "main":
        made, back = f"{made}; ip rule add pref 98 lookup {table}", f"ip rule del pref 98 lookup {table}; {back}"
    return Draw(f"a {kind} route of the table {table} takes {address}", made, back, ("route",))


def _rule(place: Place) -> Draw:
    kind = place.choose(["blackhole", "unreachable", "prohibit"])
    address = place.address(place.other())
    match = place.choose(
        [
            f"to {address}",
            f"from {address}",
            f"to {address} ipproto tcp",
            f"dport {place.choose([str(port) for port in PORTS])} ipproto tcp",
        ]
    )
    words = f"pref 99 {match} {kind}"
    return Draw(f"a rule for {match}: {kind}", f"ip rule add {words}", f"ip rule del {words}", ("route",))


def _address(place: Place) -> Draw:
    device = place.interface()
    size = place.choose(["30", "29", "28"])
    save = f"ip -4 route save > /run/fault-routes; device={device}; address=$(ip -4 -o address show dev $device | awk '{{print $4; exit}}')"
    made = f"{save}; echo $device $address > /run/fault-address; ip address add ${{address%/*}}/{size} dev $device; ip address del $address dev $device"
    back = (
        f"read device address < /run/fault-address; ip address add $address dev $device; ip address del ${{address%/*}}/{size} dev $device; "
        "ip -4 route restore < /run/fault-routes; rm -f /run/fault-routes /run/fault-address"
    )
    return Draw(f"an address has the prefix length {size}", made, back, ("interface", "route", "link"))


def _link(place: Place) -> Draw:
    device = place.interface()
    what, usual, parts = place.dice.choice(
        [
            ("mtu 576", "mtu 1500", ("interface", "network", "forwarding")),
            ("arp off", "arp on", ("neighbour", "link", "interface")),
            ("multicast off", "multicast on", ("interface", "link", "network")),
        ]
    )
    return Draw(f"an interface has {what}", f"ip link set {device} {what}", f"ip link set {device} {usual}", parts)


def _filter(place: Place) -> Draw:
    hook = place.choose(["input", "output", *(["forward", "forward"] if place.gate else [])])
    address, port = place.address(place.other()), place.choose([str(port) for port in PORTS])
    match = place.choose(
        [
            f"ip saddr {address}",
            f"ip daddr {address}",
            "ip protocol icmp",
            f"tcp dport {port}",
            f"tcp sport {port}",
            "tcp dport 1024-65535",
            "ip protocol udp",
            "udp dport 11511",
            "ct state new",
            "meta length > 800",
            "ip ttl < 64",
            f"tcp dport {port} ct state new limit rate over 2/minute",
            "ip protocol tcp tcp flags syn",
            "ct state established",
            "ct direction reply",
            "meta l4proto tcp",
            "meta pkttype multicast",
            f"ip daddr {place.facts['group']}",
            "icmp type echo-reply",
            "ip length > 800",
            "ip dscp cs0",
            "numgen random mod 2 0",
        ]
    )  # fmt: skip
    verdict = place.choose(["drop", "drop", "counter drop", "reject", "reject with icmp type admin-prohibited"])
    rule = f"table inet fault {{ chain one {{ type filter hook {hook} priority {place.choose(['-300', '-10', '0', '10'])}; {match} {verdict}; }}; }}"
    return Draw(f"{hook}: {match} {verdict}", f"nft '{rule}'", "nft delete table inet fault", ("filter",))


def _arp_filter(place: Place) -> Draw:
    operation = place.choose(["request", "reply"])
    rule = f"table arp fault {{ chain one {{ type filter hook {place.choose(['input', 'output'])} priority 0; arp operation {operation} drop; }}; }}"
    flush = "for device in $(ls /sys/class/net); do ip neighbour flush dev $device; done"
    return Draw(
        f"ARP of the kind {operation} is dropped",
        f"nft '{rule}'; {flush}",
        f"nft delete table arp fault; {flush}",
        ("neighbour", "filter", "link", "network"),
    )


def _signal(place: Place) -> Draw:
    unit = f"multimaster-{place.choose(UNITS)}"
    stop = f"systemctl kill --signal=STOP {unit}"
    back = f"systemctl kill --signal=CONT {unit}; systemctl restart {unit}"
    return Draw(f"{unit} is stopped", stop, back, ("service", unit.rpartition("-")[2]))


def _limit(place: Place) -> Draw:
    unit = f"multimaster-{place.choose(UNITS)}"
    folder = f"/run/systemd/system/{unit}.service.d"
    # A service that cannot start with so few files is the fault, not a failure of the lab.
    words = f"mkdir -p {folder}; printf '[Service]\\nLimitNOFILE=%s\\n' 12 > {folder}/fault.conf"
    restart = "systemctl daemon-reload; systemctl restart multimaster-roscore multimaster-discovery multimaster-sync"
    return Draw(
        f"{unit} may open twelve files",
        f"{words}; {restart} || true",
        f"rm -r {folder}; {restart}",
        ("service", "computer", unit.rpartition("-")[2]),
    )


def _package(place: Place) -> Draw:
    name = place.choose(["rospy", "genpy", "std_msgs"])
    found = f"bash -lc 'python3 -c \"import {name}; print(list({name}.__path__)[0])\"'"
    restart = "systemctl restart multimaster-discovery multimaster-sync"
    return Draw(
        f"the Python package {name} is removed, and the nodes are started again",
        f"path=$({found}); echo $path > /run/fault-package; mv $path /run/fault-folder; {restart} || true",
        f"mv /run/fault-folder $(cat /run/fault-package); rm /run/fault-package; {restart}",
        ("service", "ros", "discovery", "sync"),
    )


def _file(place: Place) -> Draw:
    path, parts = place.dice.choice([("/etc/hosts", ("names",)), ("/etc/nsswitch.conf", ("names",))])
    made, back = place.dice.choice(
        [
            (f"chmod 600 {path}", f"chmod 644 {path}"),
            (f"mv {path} /run/fault-file; touch {path}", f"mv /run/fault-file {path}"),
        ]
    )
    return Draw(f"{path}: {made}", made, back, parts)


def _person(place: Place) -> Draw:
    """A node of a person, started wrongly in a shell, a unit, a launch file or a container."""
    starter = place.choose(people_nodes.STARTERS)
    wrong = _choose_wrong(place, contained=starter == "container")
    name = f"fault_person{place.dice.randrange(1000)}"
    master = next(host for host in MASTERS if ROBOT[host] == ROBOT[place.host])
    return Draw(
        f"a node that a {starter} has started {wrong.title}",
        people_nodes.start(name, starter, wrong),
        people_nodes.stop(name, wrong),
        ("node", "registration"),
        (master,) if wrong is GONE else (),  # its roscore holds it
    )


def _choose_wrong(place: Place, *, contained: bool) -> Wrong:
    foreign = place.choose([name for name in COMPUTERS if ROBOT[name] != ROBOT[place.host]])
    its_master = next(host for host in MASTERS if ROBOT[host] == ROBOT[foreign])
    return place.dice.choice(
        [
            *(announce(host, "announces the loopback") for host in ("127.0.0.1", "localhost", "127.0.1.1")),
            announce("192.168.66.9", "announces an address of no computer", "ROS_IP"),
            announce("laptop-of-ann", "announces a name of no computer"),
            announce(foreign, "announces the name of another robot's computer"),
            announce(place.facts[foreign], "announces the address of another robot's computer", "ROS_IP"),
            DOCKER,
            use_roscore(f"http://{its_master}:11311", "uses the roscore of another robot"),
            use_roscore("http://localhost:11399", "uses a roscore that is not there", registers=False),
            HUNG,
            GONE,
            *((BRIDGED, BRIDGED_ADDRESS, BRIDGED_AS_COMPUTER) * contained),
        ]
    )


@dataclass(frozen=True)
class Kind:
    """A kind of faults, and the computers on which it can be made."""

    draw: Callable[[Place], Draw]
    hosts: tuple[str, ...] = COMPUTERS
    weight: int = 1


KINDS: Mapping[str, Kind] = {
    "sysctl": Kind(_sysctl, weight=2),
    "neighbour": Kind(_neighbour),
    "route": Kind(_route),
    "rule": Kind(_rule),
    "address": Kind(_address),
    "link": Kind(_link),
    "filter": Kind(_filter, weight=5),
    "arp": Kind(_arp_filter),
    "signal": Kind(_signal, MASTERS),
    "limit": Kind(_limit, MASTERS),
    "package": Kind(_package, MASTERS),
    "file": Kind(_file),
    "person": Kind(_person, weight=4),
}


def draw_faults(seed: int, facts: Mapping[str, str]) -> Iterator[Fault]:
    """Draw faults without end. `facts`: what the placeholders of the catalogue mean."""
    dice = random.Random(seed)
    for number in count(1):
        name = dice.choices(list(KINDS), [kind.weight for kind in KINDS.values()])[0]
        place = Place(dice, facts, dice.choice(KINDS[name].hosts))
        drawn = KINDS[name].draw(place)
        yield Fault(
            name=f"{name}-{seed}-{number}",
            title=f"{place.host}: {drawn.title}",
            inject=(Step(place.host, drawn.inject),),
            settled=(),
            undo=(Step(place.host, drawn.undo),),
            parts=tuple((part, "") for part in drawn.parts),
            at=(place.host, *drawn.also),
            quick=False,
        )


def draw_pairs(seed: int, facts: Mapping[str, str]) -> Iterator[tuple[Fault, Fault]]:
    """Draw two faults at once without end: on two computers, of which one at least is a person's."""
    dice, faults = random.Random(-seed), draw_faults(seed, facts)
    kept: list[Fault] = []
    for fault in faults:
        fits = [
            other
            for other in kept
            if not set(other.at) & set(fault.at)
            and "person" in (_kind(other), _kind(fault))
            and _kind(other) != "package"
        ]
        if not fits:
            kept.append(fault)
            continue
        other = dice.choice(fits)
        kept.remove(other)
        yield other, fault


def join_faults(pair: tuple[Fault, Fault]) -> Fault:
    """Make one fault of two: both are made, one after the other, and taken back in the reverse order."""
    one, other = pair
    return Fault(
        name=f"{one.name}-and-{other.name}",
        title=f"{one.title}; {other.title}",
        inject=(*one.inject, *other.inject),
        settled=(),
        undo=(*other.undo, *one.undo),
        parts=(*one.parts, *other.parts),
        at=(*one.at, *other.at),
        quick=False,
    )


def _kind(fault: Fault) -> str:
    return fault.name.partition("-")[0]
