# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""People's nodes that announce a host where other robots do not reach them, with the process that does so.

A node announces the host of ROS_HOSTNAME or ROS_IP of its shell or unit, or else the name of its computer. Other nodes connect
to that host, so with a wrong one the node hears others and nobody hears it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from ipaddress import IPv4Address, ip_address
from typing import NamedTuple

from ..._plan.model import FleetPlan, Membership
from ..components.parts import Part
from ..observe.observations import AnnouncedHost, NodeHost, Probe
from .registrations import TEST_NODES

LOOPBACK_NAMES = ("localhost", "localhost.localdomain", "ip6-localhost", "ip6-loopback")


class Misplaced(NamedTuple):
    """A node that announces a wrong host."""

    node: str
    host: str
    mode: str  # loopback, address or name: a mode of the part `node`
    computer: str  # where it runs; its robot if that is not known
    source: str = ""  # what has decided the host: ROS_IP, ROS_HOSTNAME, an argument, hostname; empty if not known
    unit: str = ""  # in which the process runs

    def __str__(self) -> str:
        by = f" by {self.source}" if self.source and self.source != "hostname" else ""
        within = f", in {self.unit}" if self.unit else ""
        return f"{self.node} announces {self.host}{by}{within}"

    @property
    def part(self) -> Part:
        """The part that is broken."""
        return Part("node", self.computer, self.mode, str(self))


def find_misplaced(fleet: FleetPlan, probes: Mapping[str, Probe]) -> dict[str, dict[str, Misplaced]]:
    """Find the nodes that announce a wrong host: robot -> node -> where and why. `probes` are those of computers.

    A node that answers the roscore's computer at a loopback address runs there.
    """
    found: dict[str, dict[str, Misplaced]] = {}
    for name, probe in probes.items():
        robot = fleet.computers[name].robot
        if not fleet.computers[name].is_master or probe.roscore.error:
            continue
        computers = [computer for computer, plan in fleet.computers.items() if plan.robot == robot]
        processes = [(one, process) for one in computers if one in probes for process in probes[one].node_hosts]
        rows = (row for row in probe.exchange.announced if not row.node.startswith(TEST_NODES))
        for row in _drop_allowed(rows, fleet.belonging):
            answers = row.node not in probe.exchange.silent
            place = name if len(computers) == 1 or (answers and _find_mode(row.host) == "loopback") else robot
            found.setdefault(robot, {})[row.node] = _locate(row, place, processes)
    return found


def _drop_allowed(rows: Iterable[AnnouncedHost], belonging: Membership) -> Iterator[AnnouncedHost]:
    """Leave out the nodes of computers outside the inventory that may take part, such as a laptop with rviz."""
    for row in rows:
        address = _read_address(row.host)
        is_guest = address is not None and not address.is_loopback
        if not (is_guest and (belonging.strangers == "allow" or any(address in net for net in belonging.allow))):
            yield row


def _read_address(host: str) -> IPv4Address | None:
    try:
        return IPv4Address(host)
    except ValueError:
        return None


def _locate(row: AnnouncedHost, place: str, processes: Iterable[tuple[str, NodeHost]]) -> Misplaced:
    """Find the process of a node: it listens on the port of the node's URI, and announces the same host. Without such a process, it is at `place`."""
    for computer, process in processes:
        if process.host == row.host and row.port in process.ports:
            return Misplaced(row.node, row.host, _find_mode(row.host), computer, process.source, process.unit)
    return Misplaced(row.node, row.host, _find_mode(row.host), place)


def _find_mode(host: str) -> str:
    if host in LOOPBACK_NAMES:
        return "loopback"
    try:
        return "loopback" if ip_address(host).is_loopback else "address"
    except ValueError:
        return "name"
