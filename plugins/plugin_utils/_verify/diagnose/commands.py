# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The command that repairs a component, if it needs more than the component's name. Pure: components and the values read there in, words out.

A text of a machine is in them only if it has the form of its place: advice.py makes each command.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from ipaddress import IPv4Network

from ..._base import advice
from ..._faults.fault import Advice, Advices
from ..._faults.filters import DROPPED, RULED, Dropped
from ..._network.model import MASQUERADE
from ..components.component import Component
from ..context.check_context import FleetState, Participant
from .node_remedies import list_remedies
from .onset import MAKERS

ROS = ("roscore", "discovery", "sync")  # services


UNTIL = "until the program that makes the rules loads them again: write it there, too"
Commands = Iterator[str]


def _switch_on(computer: Participant, components: Sequence[Component], _state: FleetState) -> Commands:
    for component in components:
        if interface := computer.interface_on.get(component.what):
            yield advice.command("ip link set dev {} up", ("device", interface.interface))


def _set_mtu(computer: Participant, components: Sequence[Component], state: FleetState) -> Commands:
    for component in components:
        interface, usual = computer.interface_on.get(component.what), state.usual.get(component.what)
        if interface and usual and interface.mtu != usual:
            yield advice.command("ip link set dev {} mtu {}", ("device", interface.interface), ("number", usual))


def _correct_prefix(computer: Participant, _components: Sequence[Component], _state: FleetState) -> Commands:
    for interface, text, found, planned in computer.find_wrong_prefixes():
        address, device = ("address", text), ("device", interface)
        yield advice.command("ip address add {}/{} dev {}", address, ("number", planned), device)
        yield advice.command("ip address del {}/{} dev {}", address, ("number", found), device)


def _delete_default_routes(computer: Participant, _components: Sequence[Component], _state: FleetState) -> Commands:
    """Delete those that are not planned, if the planned one is there."""
    routes = computer.probe.default_routes
    planned = {str(route.gateway) for route in computer.plan.routes if not route.destination.prefixlen}
    others = [route for route in routes if route.gateway not in planned]
    for route in others if len(others) < len(routes) else ():
        yield advice.command(
            "ip route del default via {} dev {} metric {}",
            ("address", route.gateway),
            ("device", route.device),
            ("number", route.metric or "0"),
        )


def _delete_closed_routes(_computer: Participant, components: Sequence[Component], _state: FleetState) -> Commands:
    return (advice.command("ip route del {}", ("route", component.what)) for component in components)


def _delete_rules(_computer: Participant, components: Sequence[Component], _state: FleetState) -> Commands:
    return (advice.command("ip rule del {}", ("rule", component.what)) for component in components)


def _comment_out_lines(_computer: Participant, components: Sequence[Component], _state: FleetState) -> Commands:
    """Lines with one of the names that are not the collection's become comments."""
    names = "|".join("{}" for _component in components)
    line = f"s/^[^#].*[[:space:]]({names})([[:space:]]|$)/# &/"
    yield advice.command(
        f"sed -i -E '/rosfleet.multimaster/! {line}' /etc/hosts",
        *(("name", component.what) for component in components),
    )


def _comment_out_settings(computer: Participant, components: Sequence[Component], _state: FleetState) -> Commands:
    """The line that decides at the next boot becomes a comment; nothing of a package is changed."""
    for entry in computer.probe.next_boot:
        if entry.kind == "sysctl" and entry.name in {component.what for component in components}:
            file = entry.file.partition(" line ")[0]
            words = "sed -i -E 's,^[[:space:]]*-?{}[[:space:]]*=,# &,' {}"
            yield advice.command(words, ("setting", entry.name), ("file", file))


def _drop_ins(computer: Participant, _components: Sequence[Component], _state: FleetState) -> Commands:
    """Drop-in files that set variables are set aside; nodes are registered at the roscore, so all of them start again."""
    services = computer.probe.services
    moves = [
        advice.command("mv {} {}.off", ("drop-in", path), ("drop-in", path))
        for entry in services
        for path in entry.drop_ins
    ]
    units = [("unit", entry.unit) for entry in services if entry.name in ROS]
    restart = advice.command(" ".join(["systemctl restart", *("{}" for _unit in units)]), *units)
    if any(moves) and restart:
        yield from [*moves, "systemctl daemon-reload", restart]


def _limit_files(_computer: Participant, components: Sequence[Component], _state: FleetState) -> Commands:
    """A drop-in file gives a unit the limit that systemd gives, if no file sets another one."""
    for component in components:
        folder, unit = "/etc/systemd/system/{}.d", ("unit", component.what)
        lines = "printf '[Service]\\nLimitNOFILE=1024:524288\\n'"
        yield advice.command(f"mkdir -p {folder}; {lines} > {folder}/files.conf", unit, unit)
        yield advice.command("systemctl daemon-reload; systemctl restart {}", unit)


#: a maker of packet filters -> its rule for a network, by the direction of its packets, so that it holds at boot; then the command that loads it
LASTING: Mapping[str, tuple[Mapping[str, str], str]] = {
    "ufw": ({"in": "ufw allow from {}", "out": "ufw allow out to {}", "forward": "ufw route allow from {}"}, ""),
    "firewalld": (
        dict.fromkeys(("in", "forward"), "firewall-cmd --permanent --zone=trusted --add-source={}"),
        "firewall-cmd --reload",
    ),
    "docker": ({"forward": "iptables -I DOCKER-USER -s {} -j ACCEPT"}, ""),
}


GROUPS = IPv4Network("224.0.0.0/4")  # of multicast: only the source of packets to it is of the fleet
#: direction of packets -> the chains of iptables that they pass, and the end of them that is in a network of the fleet
CHAINS: Mapping[str, tuple[tuple[str, str], ...]] = {
    "in": (("INPUT", "-s"),),
    "out": (("OUTPUT", "-d"),),
    "forward": (("FORWARD", "-s"),),
}


def _accept_packets(computer: Participant, components: Sequence[Component], state: FleetState) -> Commands:
    """A rule before the one that drops lets the packets of the fleet pass; its program gets the rule, too, if it is known."""
    networks = sorted({*(entry.network for entry in state.fleet.networks), state.fleet.common_network})
    for component in components:
        origins, direction = state.filters.list_origins(component), component.mode.rpartition(" ")[2]
        known = [
            lasting for maker, lasting in LASTING.items() if any(re.fullmatch(MAKERS[maker], one) for one in origins)
        ]
        if known and (words := known[0][0].get(direction)):
            ends = (GROUPS,) if component.mode == "group out" else networks
            yield from (words.format(end) for end in ends)
            yield known[0][1]
        elif origins:
            yield _accept_before(component, origins[0], networks)
        elif (
            computer.seen.filters is not None and not computer.seen.filters.readable
        ):  # without nft the rules are those of iptables
            yield from _accept_first(component, networks)


def _find_dropped(component: Component) -> tuple[Dropped | None, str, str]:
    """Find the packets that a filter drops, their direction, and their port, which is empty if the rule names no valid one."""
    mode, _space, direction = component.mode.rpartition(" ")
    if direction not in CHAINS:
        mode, direction = component.mode, ""
    dropped = DROPPED.get(mode)
    what = component.what or (dropped.what if dropped else "")
    return dropped, direction, what if what.isdecimal() and what.isascii() else ""


def _accept_before(component: Component, origin: str, networks: Iterable[IPv4Network]) -> str:
    dropped, direction, port = _find_dropped(component)
    match = dropped.match if dropped else ""
    if "{what}" in match and not port:
        return ""
    end = "daddr" if direction == "out" and "daddr" not in match else "saddr"
    among = f"ip {end} {{{{ {', '.join(map(str, networks))} }}}}"
    words = ("nft insert rule {}", among, match.format(what=port), "accept")
    return advice.command(" ".join(filter(None, words)), ("chain", origin))


def _accept_first(component: Component, networks: Iterable[IPv4Network]) -> Commands:
    dropped, direction, port = _find_dropped(component)
    option = dropped.option if dropped else ""
    if "{what}" in option and not port:
        return
    for chain, end in CHAINS.get(direction, (*CHAINS["in"], *CHAINS["out"])):
        of_fleet = "-s" if "-d " in option else end
        words = (
            f"iptables -I {chain} {of_fleet} {','.join(map(str, networks))}",
            option.format(what=port),
            "-j ACCEPT",
        )
        yield " ".join(filter(None, words))


CONNTRACK = "conntrack -D --src-nat"
PACKAGE = "conntrack is of the package of that name; it ends connections from before, which are still translated"


def _stop_translating(computer: Participant, _components: Sequence[Component], state: FleetState) -> Commands:
    """Rules before those that masquerade leave out what goes between the robots; then what they have begun to translate is ended.

    Nothing if there is a rule that was not understood: it may be the one.
    """
    filters = computer.seen.filters
    chains = [one for one in filters.chains if one.hook == "postrouting"] if filters and filters.readable else None
    if chains is None or any(one.unread for one in chains):
        return
    networks = sorted({*(entry.network for entry in state.fleet.networks), state.fleet.common_network})
    among = f"{{{{ {', '.join(map(str, networks))} }}}}"
    words = f"nft insert rule {{}} ip saddr {among} ip daddr {among} accept"
    rules = [(one.table, rule.chain) for one in chains for rule in one.rules if rule.verdict == MASQUERADE]
    inserted = [advice.command(words, ("chain", " ".join(place))) for place in dict.fromkeys(rules)]
    if all(inserted):
        yield from [*inserted, CONNTRACK]


# (kind, mode) -> the commands, from the values that were read.
COMMANDS: Mapping[tuple[str, str], Callable[[Participant, Sequence[Component], FleetState], Commands]] = {
    ("link", "down"): _switch_on,
    ("interface", "mtu"): _set_mtu,
    ("interface", "prefix"): _correct_prefix,
    ("route", "defaults"): _delete_default_routes,
    ("route", "closed"): _delete_closed_routes,
    ("route", "rule"): _delete_rules,
    ("names", "several"): _comment_out_lines,
    ("boot", "sysctl"): _comment_out_settings,
    ("environment", "service"): _drop_ins,
    ("limit", "unit"): _limit_files,
    ("translation", "on"): _stop_translating,
    **dict.fromkeys(RULED, _accept_packets),
}


def make_commands(components: Sequence[Component], computer: Participant | None, state: FleetState) -> Advices:
    """Return the commands to paste for components that are one finding; nothing if no value that was read says it."""
    fault = components[0].kind, components[0].mode
    if components[0].kind == "node":
        return list_remedies(components, computer, state)
    found = COMMANDS.get(fault)
    if found is None or computer is None:
        return ()
    words = "; ".join(filter(None, dict.fromkeys(found(computer, components, state))))
    effects = (UNTIL if words.startswith(("nft ", "iptables ")) else "", PACKAGE if CONNTRACK in words else "")
    effect = "; ".join(filter(None, effects))
    return (Advice(components[0].place, words, effect),) if words else ()
