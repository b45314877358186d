# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The command that mends a part, where it needs more than the part's name: pure, parts and what was read there in, words out.

The words are pasted by people as root, so what a machine told is in them only if it has the form of a device, of a number, or of
a file below /etc or of systemd.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.case import (
    Everything,
    Participant,
    own_networks,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import (
    DefaultRoute,
    ForwardingInterface,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.parts import SITE, Part

DEVICE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.@-]{0,14}")

FILE = re.compile(r"/etc/(?!.*\.\.)[A-Za-z0-9_./-]+")
DROP_IN = re.compile(r"/(etc|run)/systemd/system/(?!.*\.\.)[A-Za-z0-9_./@-]+\.conf")
SETTING = re.compile(r"[a-z0-9_]+(\.[a-z0-9_]+)+")
ROS = ("roscore", "discovery", "sync")  # services


@dataclass(frozen=True)
class Place:
    """The computer of a part, and the fleet."""

    computer: Participant
    everything: Everything

    @property
    def interfaces(self) -> Sequence[ForwardingInterface]:
        """Those of the computer, by names that can be pasted."""
        probe = self.computer.seen.probe
        return [entry for entry in probe.forwarding.interfaces if DEVICE.fullmatch(entry.interface)] if probe else []

    def on(self, network: str) -> ForwardingInterface | None:
        """Return the interface on a network."""
        found = own_networks(self.computer, self.everything.ways).get(network)
        return found if found in self.interfaces else None


Commands = Iterator[str]


def _up(place: Place, parts: Sequence[Part]) -> Commands:
    for part in parts:
        if interface := place.on(part.what):
            yield f"ip link set dev {interface.interface} up"


def _size(place: Place, parts: Sequence[Part]) -> Commands:
    for part in parts:
        interface, usual = place.on(part.what), place.everything.usual.get(part.what)
        if interface and usual and interface.mtu != usual:
            yield f"ip link set dev {interface.interface} mtu {usual}"


def _prefix(place: Place, _parts: Sequence[Part]) -> Commands:
    planned = {str(entry.address): entry.network.prefixlen for entry in place.computer.plan.networks}
    for entry in place.interfaces:
        for address, found in zip(entry.addresses, entry.prefixes, strict=False):
            if planned.get(address, found) != found:
                yield f"ip address add {address}/{planned[address]} dev {entry.interface}"
                yield f"ip address del {address}/{found} dev {entry.interface}"


def _defaults(place: Place, _parts: Sequence[Part]) -> Commands:
    """Delete those that are not planned, if the planned one is there."""
    probe = place.computer.seen.probe
    routes = probe.default_routes if probe else ()
    planned = {str(route.gateway) for route in place.computer.plan.routes if not route.destination.prefixlen}
    others = [route for route in routes if route.gateway not in planned]
    if len(others) < len(routes):
        yield from filter(None, map(_deleted, others))


def _deleted(route: DefaultRoute) -> str:
    gateway, device, metric = route.gateway or "", route.device or "", route.metric or "0"
    if not (_is_address(gateway) and DEVICE.fullmatch(device) and metric.isdecimal()):
        return ""
    return f"ip route del default via {gateway} dev {device} metric {metric}"


def _is_address(text: str) -> bool:
    try:
        return bool(IPv4Address(text))
    except ValueError:
        return False


def _closed(_place: Place, parts: Sequence[Part]) -> Commands:
    return (f"ip route del {part.what}" for part in parts)


def _rules(_place: Place, parts: Sequence[Part]) -> Commands:
    return (f"ip rule del {part.what}" for part in parts)


def _other_lines(_place: Place, parts: Sequence[Part]) -> Commands:
    """Lines with one of the names that are not the collection's become comments."""
    names = "|".join(part.what.replace(".", r"\.") for part in parts)
    yield rf"sed -i -E '/rosfleet.multimaster/! s/^[^#].*[[:space:]]({names})([[:space:]]|$)/# &/' /etc/hosts"


def _other_settings(place: Place, parts: Sequence[Part]) -> Commands:
    """The line that decides at the next boot becomes a comment; nothing of a package is changed."""
    probe = place.computer.seen.probe
    for entry in probe.next_boot if probe else ():
        asked = entry.kind == "sysctl" and entry.name in {part.what for part in parts}
        file = entry.file.partition(" line ")[0]
        if asked and FILE.fullmatch(file) and SETTING.fullmatch(entry.name):
            name = entry.name.replace(".", "[./]")
            yield rf"sed -i -E 's,^[[:space:]]*-?{name}[[:space:]]*=,# &,' {file}"


def _drop_ins(place: Place, _parts: Sequence[Part]) -> Commands:
    """Drop-in files that set variables are set aside; nodes are registered at the roscore, so all of them start again."""
    services = place.computer.seen.probe.services if place.computer.seen.probe else ()
    files = [path for entry in services for path in entry.drop_ins if DROP_IN.fullmatch(path)]
    if files:
        yield from (f"mv {path} {path}.off" for path in files)
        yield "systemctl daemon-reload"
        yield f"systemctl restart {' '.join(entry.unit for entry in services if entry.name in ROS)}"


# (kind, mode) -> the commands, from what was read.
COMMANDS: Mapping[tuple[str, str], Callable[[Place, Sequence[Part]], Commands]] = {
    ("link", "down"): _up,
    ("interface", "mtu"): _size,
    ("interface", "prefix"): _prefix,
    ("route", "defaults"): _defaults,
    ("route", "closed"): _closed,
    ("route", "rule"): _rules,
    ("names", "several"): _other_lines,
    ("boot", "sysctl"): _other_settings,
    ("environment", "service"): _drop_ins,
}
# What site.yml does after these.
THEN = {
    ("link", "down"): "sets its routes",
    ("interface", "prefix"): "sets its routes",
    ("boot", "sysctl"): "sets it at boot",
}


def command(parts: Sequence[Part], computer: Participant | None, everything: Everything) -> str:
    """Return what to paste for parts that are one finding; empty where nothing was read that says it."""
    fault = parts[0].kind, parts[0].mode
    found = COMMANDS.get(fault)
    if found is None or computer is None:
        return ""
    words = "; ".join(dict.fromkeys(found(Place(computer, everything), parts)))
    after = f"; then {SITE}, which {THEN[fault]}" if fault in THEN else ""
    return f"on {parts[0].place}: {words}{after}" if words else ""
