# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The variables of the fleet: place, kind and default of each. The purpose of each is only in docs/operate/variables.md.

A variable is a field of one of three classes. The class is the level at which it is set. Its name is `multimaster_` and the name of
the field. To add one, add a field. Reading and the checks for agreement follow. Those of an optional feature are in its folder.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from ipaddress import IPv4Address, IPv4Network
from typing import Any, TypeVar

from .._base.features import FeaturePart, load_hooks
from . import kinds
from .exports import Export, read_exports, read_frames
from .rows import Variable, VariableHooks, list_rows, make_rows, row, word

T = TypeVar("T")

# Set by the preflight role for the other roles; not for an inventory.
RESERVED = ("multimaster_fleet", "multimaster_info", "multimaster_plan")


@dataclass(frozen=True)
class ComputerVariables:
    """The variables of one computer."""

    address: IPv4Address = row(kinds.address, example="192.168.1.229")
    aliases: list[str] = row(kinds.given_names, [])
    firewall_also: tuple[IPv4Network, ...] = row(kinds.sources, [])
    firewall_ports: tuple[str, ...] = row(kinds.ports, [])
    ros_setup: str = row(kinds.setup, "auto")
    shells: str = word("all", "names", "none")
    features: Mapping[str, FeaturePart] = field(default_factory=dict)


@dataclass(frozen=True)
class FleetVariables:
    """The variables that are equal on all computers of the fleet."""

    common_network: IPv4Network = row(kinds.network, example="192.168.1.0/24")
    router: IPv4Address | None = row(kinds.address)
    transport: str = word("both", "multicast", "unicast")
    multicast_group: IPv4Address = row(kinds.group, "226.0.0.0")
    multicast_port: int = row(kinds.number(int, 1024, 65535), 11511)
    answer_broadcast_pings: bool = row(kinds.switch, True)
    firewall: str = word("none", "fleet")
    advertise: str = word("name", "address")
    strangers: str = word("ignore", "allow")
    allow: tuple[IPv4Network, ...] = row(kinds.sources, [])
    diagnostics: str = word("local", "exchanged", "none")
    heartbeat_hz: float = row(kinds.number(float, 0.02, 25.5), 1.0)
    offline_after: float = row(kinds.number(float, 3, 3600))
    features: Mapping[str, FeaturePart] = field(default_factory=dict)


@dataclass(frozen=True)
class RobotVariables:
    """The variables that are equal on all computers of a robot."""

    network: IPv4Network | None = row(kinds.network)
    gateway: str | IPv4Address | None = row(kinds.gateway)
    common_address: IPv4Address | None = row(kinds.address)
    routes: str = word("default", "networks", "existing")
    master: str | None = row(kinds.text)  # compared with the computers of the robot: that sentence names them
    sealed: Mapping[str, kinds.SealedComputer] = row(kinds.seals, {})
    companion: str | None = row(kinds.name)
    roscore: str = word("managed", "existing")
    roscore_port: int = row(kinds.number(int, 1024, 65235), 11311)
    rpc_port: int = row(kinds.number(int, 1024, 65535))
    filters: Mapping[str, list[str]] = row(kinds.filters, {})
    exports: tuple[Export, ...] | None = row(read_exports)
    frames: tuple[str, str] | None = row(read_frames)
    provider: str = word("bundled", "fkie_apt", "fkie_existing")
    metrics: str = word("none", "textfile")
    metrics_folder: str = row(kinds.folder, "/var/lib/prometheus/node-exporter")


_HOOKS = load_hooks("variables", VariableHooks)
#: class -> feature -> the addition of that feature
_OF_FEATURES: Mapping[type, Mapping[str, type[FeaturePart]]] = {
    FleetVariables: {name: hooks.of_fleet for name, hooks in _HOOKS.items() if hooks.of_fleet},
    ComputerVariables: {name: hooks.of_computer for name, hooks in _HOOKS.items() if hooks.of_computer},
}


def rows(kind: type) -> tuple[Variable, ...]:
    """Return the variables of one of the classes above, with those of the features."""
    of_features = (entry for part in _OF_FEATURES.get(kind, {}).values() for entry in list_rows(part))
    return (*list_rows(kind), *of_features)


OF_COMPUTER, OF_FLEET, OF_ROBOT = map(rows, (ComputerVariables, FleetVariables, RobotVariables))
# The order of docs/operate/variables.md, and of the sentences about a host.
VARIABLES = (*OF_COMPUTER[:2], *OF_FLEET, *OF_ROBOT, *OF_COMPUTER[2:])
BY_NAME = {row.name: row for row in VARIABLES}


def make(kind: type[T], values: Mapping[str, Any]) -> T:
    """Make one of the classes above of values by the names of their variables. One without a value is None."""
    if kind not in _OF_FEATURES:
        return make_rows(kind, values)
    features = {name: make_rows(part, values) for name, part in _OF_FEATURES[kind].items()}
    return make_rows(kind, values, features=features)
