# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The command that mends a part, where it needs more than the part's name: pure, parts and what was read there in, words out.

What a machine told is in them only where it has the form of its place: advice.py makes each command.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._case.case import (
    FleetState,
    Participant,
    interfaces_by_network,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._case.parts import SITE, Part
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet import advice
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._observed.observations import ForwardingInterface

ROS = ("roscore", "discovery", "sync")  # services


@dataclass(frozen=True)
class Place:
    """The computer of a part, and the fleet."""

    computer: Participant
    state: FleetState

    @property
    def interfaces(self) -> Sequence[ForwardingInterface]:
        """Those of the computer."""
        probe = self.computer.seen.probe
        return probe.forwarding.interfaces if probe else ()

    def interface_on(self, network: str) -> ForwardingInterface | None:
        """Return the interface on a network."""
        found = interfaces_by_network(self.computer, self.state.ways).get(network)
        return found if found in self.interfaces else None


Commands = Iterator[str]


def _switch_on(place: Place, parts: Sequence[Part]) -> Commands:
    for part in parts:
        if interface := place.interface_on(part.what):
            yield advice.command("ip link set dev {} up", ("device", interface.interface))


def _set_mtu(place: Place, parts: Sequence[Part]) -> Commands:
    for part in parts:
        interface, usual = place.interface_on(part.what), place.state.usual.get(part.what)
        if interface and usual and interface.mtu != usual:
            yield advice.command("ip link set dev {} mtu {}", ("device", interface.interface), ("number", usual))


def _correct_prefix(place: Place, _parts: Sequence[Part]) -> Commands:
    planned = {str(entry.address): entry.network.prefixlen for entry in place.computer.plan.networks}
    for entry in place.interfaces:
        for address, found in zip(entry.addresses, entry.prefixes, strict=False):
            if planned.get(address, found) != found:
                at, device = ("address", address), ("device", entry.interface)
                yield advice.command("ip address add {}/{} dev {}", at, ("number", planned[address]), device)
                yield advice.command("ip address del {}/{} dev {}", at, ("number", found), device)


def _delete_default_routes(place: Place, _parts: Sequence[Part]) -> Commands:
    """Delete those that are not planned, if the planned one is there."""
    probe = place.computer.seen.probe
    routes = probe.default_routes if probe else ()
    planned = {str(route.gateway) for route in place.computer.plan.routes if not route.destination.prefixlen}
    others = [route for route in routes if route.gateway not in planned]
    for route in others if len(others) < len(routes) else ():
        yield advice.command(
            "ip route del default via {} dev {} metric {}",
            ("address", route.gateway),
            ("device", route.device),
            ("number", route.metric or "0"),
        )


def _delete_closed_routes(_place: Place, parts: Sequence[Part]) -> Commands:
    return (advice.command("ip route del {}", ("route", part.what)) for part in parts)


def _delete_rules(_place: Place, parts: Sequence[Part]) -> Commands:
    return (advice.command("ip rule del {}", ("rule", part.what)) for part in parts)


def _comment_out_lines(_place: Place, parts: Sequence[Part]) -> Commands:
    """Lines with one of the names that are not the collection's become comments."""
    names = "|".join("{}" for _part in parts)
    line = f"s/^[^#].*[[:space:]]({names})([[:space:]]|$)/# &/"
    yield advice.command(
        f"sed -i -E '/rosfleet.multimaster/! {line}' /etc/hosts", *(("name", part.what) for part in parts)
    )


def _comment_out_settings(place: Place, parts: Sequence[Part]) -> Commands:
    """The line that decides at the next boot becomes a comment; nothing of a package is changed."""
    probe = place.computer.seen.probe
    for entry in probe.next_boot if probe else ():
        if entry.kind == "sysctl" and entry.name in {part.what for part in parts}:
            file = entry.file.partition(" line ")[0]
            words = "sed -i -E 's,^[[:space:]]*-?{}[[:space:]]*=,# &,' {}"
            yield advice.command(words, ("setting", entry.name), ("file", file))


def _drop_ins(place: Place, _parts: Sequence[Part]) -> Commands:
    """Drop-in files that set variables are set aside; nodes are registered at the roscore, so all of them start again."""
    services = place.computer.seen.probe.services if place.computer.seen.probe else ()
    moves = [
        advice.command("mv {} {}.off", ("drop-in", path), ("drop-in", path))
        for entry in services
        for path in entry.drop_ins
    ]
    units = [("unit", entry.unit) for entry in services if entry.name in ROS]
    restart = advice.command(" ".join(["systemctl restart", *("{}" for _unit in units)]), *units)
    if any(moves) and restart:
        yield from [*moves, "systemctl daemon-reload", restart]


# (kind, mode) -> the commands, from what was read.
COMMANDS: Mapping[tuple[str, str], Callable[[Place, Sequence[Part]], Commands]] = {
    ("link", "down"): _switch_on,
    ("interface", "mtu"): _set_mtu,
    ("interface", "prefix"): _correct_prefix,
    ("route", "defaults"): _delete_default_routes,
    ("route", "closed"): _delete_closed_routes,
    ("route", "rule"): _delete_rules,
    ("names", "several"): _comment_out_lines,
    ("boot", "sysctl"): _comment_out_settings,
    ("environment", "service"): _drop_ins,
}
# What site.yml does after these.
THEN = {
    ("link", "down"): "sets its routes",
    ("interface", "prefix"): "sets its routes",
    ("boot", "sysctl"): "sets it at boot",
}


def command(parts: Sequence[Part], computer: Participant | None, state: FleetState) -> str:
    """Return what to paste for parts that are one finding; empty where nothing was read that says it."""
    fault = parts[0].kind, parts[0].mode
    found = COMMANDS.get(fault)
    if found is None or computer is None:
        return ""
    words = "; ".join(filter(None, dict.fromkeys(found(Place(computer, state), parts))))
    after = f"; then {SITE}, which {THEN[fault]}" if fault in THEN else ""
    return f"on {parts[0].place}: {words}{after}" if words else ""
