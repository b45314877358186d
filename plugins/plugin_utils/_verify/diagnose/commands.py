# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The command that mends a part, where it needs more than the part's name: pure, parts and what was read there in, words out.

What a machine told is in them only where it has the form of its place: advice.py makes each command.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from ..._base import advice
from ..components.fault import SITE
from ..components.parts import Part
from ..context.case import FleetState, Participant
from .node_remedies import describe_remedy

ROS = ("roscore", "discovery", "sync")  # services


Commands = Iterator[str]


def _switch_on(computer: Participant, parts: Sequence[Part], _state: FleetState) -> Commands:
    for part in parts:
        if interface := computer.interface_on.get(part.what):
            yield advice.command("ip link set dev {} up", ("device", interface.interface))


def _set_mtu(computer: Participant, parts: Sequence[Part], state: FleetState) -> Commands:
    for part in parts:
        interface, usual = computer.interface_on.get(part.what), state.usual.get(part.what)
        if interface and usual and interface.mtu != usual:
            yield advice.command("ip link set dev {} mtu {}", ("device", interface.interface), ("number", usual))


def _correct_prefix(computer: Participant, _parts: Sequence[Part], _state: FleetState) -> Commands:
    for interface, text, found, planned in computer.find_wrong_prefixes():
        address, device = ("address", text), ("device", interface)
        yield advice.command("ip address add {}/{} dev {}", address, ("number", planned), device)
        yield advice.command("ip address del {}/{} dev {}", address, ("number", found), device)


def _delete_default_routes(computer: Participant, _parts: Sequence[Part], _state: FleetState) -> Commands:
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


def _delete_closed_routes(_computer: Participant, parts: Sequence[Part], _state: FleetState) -> Commands:
    return (advice.command("ip route del {}", ("route", part.what)) for part in parts)


def _delete_rules(_computer: Participant, parts: Sequence[Part], _state: FleetState) -> Commands:
    return (advice.command("ip rule del {}", ("rule", part.what)) for part in parts)


def _comment_out_lines(_computer: Participant, parts: Sequence[Part], _state: FleetState) -> Commands:
    """Lines with one of the names that are not the collection's become comments."""
    names = "|".join("{}" for _part in parts)
    line = f"s/^[^#].*[[:space:]]({names})([[:space:]]|$)/# &/"
    yield advice.command(
        f"sed -i -E '/rosfleet.multimaster/! {line}' /etc/hosts", *(("name", part.what) for part in parts)
    )


def _comment_out_settings(computer: Participant, parts: Sequence[Part], _state: FleetState) -> Commands:
    """The line that decides at the next boot becomes a comment; nothing of a package is changed."""
    for entry in computer.probe.next_boot:
        if entry.kind == "sysctl" and entry.name in {part.what for part in parts}:
            file = entry.file.partition(" line ")[0]
            words = "sed -i -E 's,^[[:space:]]*-?{}[[:space:]]*=,# &,' {}"
            yield advice.command(words, ("setting", entry.name), ("file", file))


def _drop_ins(computer: Participant, _parts: Sequence[Part], _state: FleetState) -> Commands:
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


def _limit_files(_computer: Participant, parts: Sequence[Part], _state: FleetState) -> Commands:
    """A drop-in file gives a unit the limit that systemd gives, where nobody says another one."""
    for part in parts:
        folder, unit = "/etc/systemd/system/{}.d", ("unit", part.what)
        lines = "printf '[Service]\\nLimitNOFILE=1024:524288\\n'"
        yield advice.command(f"mkdir -p {folder}; {lines} > {folder}/files.conf", unit, unit)
        yield advice.command("systemctl daemon-reload; systemctl restart {}", unit)


# (kind, mode) -> the commands, from what was read.
COMMANDS: Mapping[tuple[str, str], Callable[[Participant, Sequence[Part], FleetState], Commands]] = {
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
    if parts[0].kind == "node":
        return describe_remedy(parts, computer, state)
    found = COMMANDS.get(fault)
    if found is None or computer is None:
        return ""
    words = "; ".join(filter(None, dict.fromkeys(found(computer, parts, state))))
    after = f"; then {SITE}, which {THEN[fault]}" if fault in THEN else ""
    return f"on {parts[0].place}: {words}{after}" if words else ""
