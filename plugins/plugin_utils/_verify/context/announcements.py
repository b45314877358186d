# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""People's nodes that announce a host at which others do not reach them, or use another roscore than their robot's, with their process.

A node announces the host of ROS_HOSTNAME or ROS_IP of its shell or unit, or else the name of its computer. Other nodes connect
to that host, so with a wrong one the node hears others, and the others do not hear it. The roscore is that of ROS_MASTER_URI.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from ipaddress import IPv4Address, IPv4Interface, ip_address
from typing import NamedTuple

from ..._base.hosts import host_of
from ..._base.sentences import shorten_list
from ..._plan.model import FleetPlan, Membership
from ..components.component import Component
from ..observe.observations import AnnouncedHost, ForwardingInterface, NodeHost, Probe, SilentNode
from .registrations import TEST_NODES

LOOPBACK_NAMES = ("localhost", "localhost.localdomain", "ip6-localhost", "ip6-loopback")
NAMED = 4  # robots that a sentence names
UNREAD = NodeHost("", readable=False)  # a process that was not found


class Misplaced(NamedTuple):
    """A node that announces a wrong host, or uses a wrong roscore."""

    node: str
    host: str
    mode: str  # a mode of the component `node`
    computer: str  # of the process; its robot if that is not known
    process: NodeHost = UNREAD
    detail: str = ""  # the interface or the computer that has the host, the robot at whose roscore it is, or the host of its services
    refused: tuple[tuple[str, str], ...] = ()  # the robots whose sync nodes refuse it, each with its reason

    def __str__(self) -> str:
        if self.mode == "unregistered":
            return f"{self.node} ({', '.join(self._list_signs())})"
        return f"{self.node} {self._deed}{self._origin}{self._refusal}"

    def _list_signs(self) -> Iterable[str]:
        """Yield by what a person finds a process without a registration."""
        process = self.process
        yield f"process {process.pid}"
        if process.topics:
            yield f"publishes {shorten_list(process.topics, NAMED)}"
        if process.unit:
            yield f"in {process.unit}"

    @property
    def _deed(self) -> str:
        if self.mode == "robot":
            return f"uses the roscore of {self.detail} (another robot)"
        if self.mode == "master":
            return f"uses the roscore {self.process.master}"
        if self.mode == "services":
            return f"announces {self.host}, and {self.detail} for its services"
        owner = f" (of {self.detail})" if self.detail else ""
        return f"announces {self.host}{owner}"

    @property
    def source(self) -> str:
        """The variable or argument that has decided what is wrong, `hostname`, or empty if it is not known."""
        if self.mode in ("robot", "master"):
            return self.process.master_source or ("ROS_MASTER_URI" if self.process.readable else "")
        return self.process.source

    @property
    def _origin(self) -> str:
        """The variable that has decided it, and the place where the process runs."""
        source, unit = self.source, self.process.unit
        whose = "container" if self.process.starter == "container" else "computer"
        by = f" by the name of the {whose}" if source == "hostname" else f" by {source}" if source else ""
        return f"{by}, in {unit}" if unit else by

    @property
    def _refusal(self) -> str:
        return f" (refused by {shorten_list((robot for robot, _why in self.refused), NAMED)})" if self.refused else ""

    @property
    def component(self) -> Component:
        """The component that is broken."""
        return Component("node", self.computer, self.mode, str(self))


class _Fleet:
    """The computers of a fleet, and the observations of them."""

    def __init__(self, fleet: FleetPlan, probes: Mapping[str, Probe]) -> None:
        self.fleet, self.probes = fleet, probes
        self.at = {
            host.lower(): member.name
            for member in fleet.members
            for host in (member.name, str(member.address), str(member.discovery_address))
        }
        self.masters = {master.name: robot for robot, master in fleet.master_of.items()}

    def list_processes(self, robot: str) -> list[tuple[str, NodeHost]]:
        """List the processes on the computers of a robot that are not as planned."""
        computers = (name for name, plan in self.fleet.computers.items() if plan.robot == robot)
        return [
            (name, process) for name in computers if name in self.probes for process in self.probes[name].node_hosts
        ]

    def find_refusers(self, robot: str, node: str) -> tuple[tuple[str, str], ...]:
        """Name the robots whose sync nodes refuse the place of a robot's node, each with its reason."""
        reasons = {
            self.fleet.computers[name].robot: row.here
            for name, probe in self.probes.items()
            for service in probe.services
            for row in service.refusals
            if row.kind == "place" and row.name == node and self.masters.get(row.master) == robot
        }
        return tuple(sorted(reasons.items()))

    def find_interface(self, computers: Iterable[str], address: str) -> tuple[str, str]:
        """Find the computer and the interface that has an address, or, as that of a bridge of containers, a network with it."""
        near = ("", "")
        for computer in computers:
            for entry in self.probes[computer].forwarding.interfaces if computer in self.probes else ():
                if address in entry.addresses:
                    return computer, entry.interface
                if not near[0] and self.at.keys().isdisjoint(entry.addresses) and _is_near(address, entry):
                    near = computer, entry.interface
        return near


def _is_near(address: str, interface: ForwardingInterface) -> bool:
    """Return True if an address is in a network of an interface, of which each text may be anything."""
    try:
        wanted = IPv4Address(address)
        places = zip(interface.addresses, interface.prefixes, strict=False)
        return any(wanted in IPv4Interface(f"{one}/{size}").network for one, size in places)
    except ValueError:
        return False


def find_misplaced(fleet: FleetPlan, probes: Mapping[str, Probe]) -> dict[str, dict[str, Misplaced]]:
    """Find the nodes that announce a wrong host: robot -> node -> place and reason. `probes` are those of computers.

    A node that answers the roscore's computer at a loopback address runs there.
    """
    seen = _Fleet(fleet, probes)
    found: dict[str, dict[str, Misplaced]] = {}
    for name, probe in probes.items():
        if not fleet.computers[name].is_master or probe.roscore.error:
            continue
        robot = fleet.computers[name].robot
        for row in probe.exchange.announced:
            one = _locate(seen, name, row)._replace(refused=seen.find_refusers(robot, row.node))
            is_fine = _is_guest(one, fleet.belonging) or (one.mode == "name" and _leads_home(one, row, seen, robot))
            if not row.node.startswith(TEST_NODES) and not is_fine:
                found.setdefault(robot, {})[row.node] = one
        found.setdefault(robot, {}).update(_find_apart(seen, robot, probe.exchange.silences))
    return {robot: nodes for robot, nodes in found.items() if nodes}


def _find_apart(seen: _Fleet, robot: str, silences: Iterable[SilentNode]) -> dict[str, Misplaced]:
    """Find the nodes that announce their computer, and do not answer there, since they listen in a network of their own."""
    found = {}
    for row in silences:
        at = seen.at.get(row.host, "")
        for computer, process in seen.list_processes(robot):
            if computer == at and process.apart and row.port in process.ports and process.host == row.host:
                found[row.node] = Misplaced(row.node, row.host, "network", computer, process)
    return found


def find_strays(
    fleet: FleetPlan, probes: Mapping[str, Probe], misplaced: Mapping[str, Mapping[str, Misplaced]]
) -> dict[str, list[Misplaced]]:
    """Find the processes with another roscore than their robot's, if that does not report them itself, or with none: computer -> processes."""
    seen = _Fleet(fleet, probes)
    reported = {(one.computer, one.process) for nodes in misplaced.values() for one in nodes.values()}
    found: dict[str, list[Misplaced]] = {}
    for computer, probe in probes.items():
        for process in probe.node_hosts:
            if process.master and (computer, process) not in reported:
                its = seen.at.get(host_of(process.master), "")
                robot = fleet.computers[its].robot if its in fleet.computers else ""
                mode = "robot" if robot and robot != fleet.computers[computer].robot else "master"
                one = Misplaced(process.node, process.host, mode, computer, process, robot)
                found.setdefault(computer, []).append(one)
        for process in probe.unregistered.nodes:
            one = Misplaced(process.node, process.host, "unregistered", computer, process)
            found.setdefault(computer, []).append(one)
    return found


def _is_guest(one: Misplaced, belonging: Membership) -> bool:
    """Return True if a node is of a computer outside the inventory that may take part, such as a laptop with rviz."""
    if one.mode != "address" or one.process is not UNREAD:
        return False  # it runs on a computer of the fleet
    try:
        address = IPv4Address(one.host)
    except ValueError:
        return False
    return belonging.strangers == "allow" or any(address in network for network in belonging.allow)


def _leads_home(one: Misplaced, row: AnnouncedHost, seen: _Fleet, robot: str) -> bool:
    """Return True if another name, such as one that mDNS knows, leads to a computer of the robot, and no other robot refuses the node."""
    at = {seen.at.get(address, "") for address in row.addresses}
    own = {name for name, plan in seen.fleet.computers.items() if plan.robot == robot}
    return bool(at) and at <= own and not one.refused and not one.process.master


def _locate(seen: _Fleet, master: str, row: AnnouncedHost) -> Misplaced:
    """Find the process of a node, its computer, and the kind of its fault; without a process it is at the robot."""
    robot, silent = seen.fleet.computers[master].robot, seen.probes[master].exchange.silent
    computers = [name for name, plan in seen.fleet.computers.items() if plan.robot == robot]
    at = seen.at.get(row.host, "")
    if at in computers:  # its own host is right
        computer, process = _find_process(seen, robot, row) or (at, UNREAD)
        return Misplaced(row.node, row.host, "services", computer, process, row.services)
    found = _find_process(seen, robot, row)
    guest = None if found else _find_guest(seen, at, row, row.node not in silent)
    if guest:
        return Misplaced(row.node, row.host, "robot", *guest, robot)
    mode = _find_mode(row.host)
    place = computers[0] if len(computers) == 1 else master if mode == "loopback" and row.node not in silent else robot
    computer, process = found or (place, UNREAD)
    if mode == "address":
        has, interface = seen.find_interface([computer] if found else computers, row.host)
        if interface:
            return Misplaced(row.node, row.host, "interface", has, process, interface)
    return Misplaced(
        row.node, row.host, mode, computer, process, at if mode == "address" else _describe_owner(seen, at, bool(found))
    )


def _describe_owner(seen: _Fleet, at: str, is_found: bool) -> str:
    """Say of a planned name of another robot whose it is; of a node without a process also that it does not answer there, or it would be a guest."""
    robot = seen.fleet.computers[at].robot if at else ""
    return robot and (f"robot {robot}" if is_found else f"robot {robot}, where it does not answer")


def _find_guest(seen: _Fleet, at: str, row: AnnouncedHost, answers: bool) -> tuple[str, NodeHost] | None:
    """Find the process of a node that another robot's computer runs: the computer is the one that the node announces."""
    if not at:
        return None
    guest = _find_process(seen, seen.fleet.computers[at].robot, row, anywhere=True)
    return guest or ((at, UNREAD) if answers else None)


def _find_process(
    seen: _Fleet, robot: str, row: AnnouncedHost, *, anywhere: bool = False
) -> tuple[str, NodeHost] | None:
    """Find the process of a node: it listens on the port of the node's URI, and announces the same host.

    One that may not be looked at has the name of the node. `anywhere`: one that uses another roscore than its robot's.
    """
    processes = seen.list_processes(robot)
    for computer, process in processes:
        if row.port in process.ports and process.host == row.host and (process.master or not anywhere):
            return computer, process
    name = row.node.rpartition("/")[2]
    unread = [one for one in processes if not one[1].readable and one[1].node.strip('"') in (name, row.node)]
    return unread[0] if len(unread) == 1 and not anywhere else None


def _find_mode(host: str) -> str:
    if host in LOOPBACK_NAMES:
        return "loopback"
    try:
        return "loopback" if ip_address(host).is_loopback else "address"
    except ValueError:
        return "name"
