# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The context of a check: one observer and one target of a fleet, with state that a check may look at."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import TypeVar

from ..._plan.model import COMMON, ComputerPlan, FleetPlan, Master
from ..observe.observations import (
    DatagramCounts,
    Exchange,
    ForwardingInterface,
    Multicast,
    Observation,
    Probe,
    SeenMember,
)
from .announcements import find_misplaced, find_strays
from .packet_filters import ReadFilters
from .registrations import Exchanges
from .ways import Way, Ways

T = TypeVar("T")

LATELY = 600.0  # seconds
HOST_BITS = 32  # the prefix length of an address on a point-to-point link, as of a VPN: routes lead to the others
NOT_SEEN = SeenMember("")  # a computer at which the observer did not look
ANSWERS_BROADCASTS = ("net.ipv4.icmp_echo_ignore_broadcasts", "0")


def _index(entries: Iterable[T], key: Callable[[T], str]) -> dict[str, T]:
    return {key(entry): entry for entry in entries}


def _list_rounds(multicast: Multicast) -> list[tuple[int, frozenset[str]]]:
    """List the rounds of pings of the group, each with the members that answered."""
    rounds = multicast.icmp.rounds if multicast.icmp else ()
    return [(entry.round, frozenset(entry.answered)) for entry in rounds]


def _read_arp_answers(probe: Probe) -> dict[str, bool]:
    """Return for each address on its networks if an answer came for it."""
    answered = {claim.address for claim in probe.claims if claim.macs}
    return {claim.address: claim.address in answered for claim in probe.claims}


def _find_interfaces(
    interfaces: Iterable[ForwardingInterface], planned: Mapping[str, str]
) -> dict[str, ForwardingInterface]:
    """Find the interface on each network; `planned`: the network of each planned address."""
    return {planned[address]: entry for entry in interfaces for address in entry.addresses if address in planned}


class Participant:
    """A computer of the run: its plan and its observation, with an index for each list of the observation."""

    def __init__(self, name: str, plan: ComputerPlan, seen: Observation, ways: Ways) -> None:
        probe, multicast = seen.probe or Probe(), seen.multicast or Multicast()
        self.name, self.seen = name, seen
        self.probe, self.is_probed = probe, seen.probe is not None
        self.multicast = multicast  # empty if it was not measured, as `probe`
        # without the services that cannot run there, as preflight found
        self.plan = plan if seen.services is None else replace(plan, services=seen.services)
        self.members = _index(probe.members, lambda entry: entry.name)
        self.masters = _index(probe.masters, lambda entry: entry.computer)
        self.listed = _index(probe.list_masters.masters, lambda entry: entry.name)
        self.topics = _index(probe.topics, lambda entry: entry.computer)  # by computer of the talker
        # by the computer to which it was sent
        self.streams = _index(seen.streams.streams if seen.streams else (), lambda entry: entry.computer)
        self.udp = _index(multicast.udp, lambda entry: entry.name)
        # the members that answered its pings
        self.answered = frozenset(entry.name for entry in probe.members if entry.ping_address and entry.ping_address.ok)
        self.callers = frozenset(entry.address for entry in multicast.callers)  # the addresses from which it was called
        self.rounds = _list_rounds(multicast)
        self.claimed = _read_arp_answers(probe)
        self.interfaces = probe.forwarding.interfaces
        self.macs = frozenset(entry.mac.lower() for entry in self.interfaces if entry.mac)
        # A port of a bridge and the interface below a macvlan have no address, and answer ARP all the same.
        self.hardware_addresses = self.macs | frozenset(mac.lower() for mac in probe.forwarding.macs)
        planned = {str(plan.common_address): COMMON, str(plan.address): ways.network(plan.robot)}
        # by network of the plan, as far as it was read
        self.interface_on = _find_interfaces(self.interfaces, planned)
        self.mtus = {network: entry.mtu for network, entry in self.interface_on.items() if entry.mtu is not None}
        # by plan
        self.answers_broadcasts = ANSWERS_BROADCASTS in {(entry.name, entry.value) for entry in plan.sysctl}

    def find_wrong_prefixes(self) -> list[tuple[str, str, int, int]]:
        """List the planned addresses in a network of another size: interface, address, its prefix length, the planned one."""
        planned = {str(entry.address): entry.network.prefixlen for entry in self.plan.networks}
        return [
            (entry.interface, address, size, planned[address])
            for entry in self.interfaces
            for address, size in zip(entry.addresses, entry.prefixes, strict=False)
            if planned.get(address, size) != size and not (entry.point_to_point and size == HOST_BITS)
        ]

    def list_ports(self) -> list[tuple[str, ForwardingInterface]]:
        """List the planned addresses that are on a port of a bridge or a bond, with the port."""
        planned = {str(entry.address) for entry in self.plan.networks}
        ports = [(one, entry) for entry in self.interfaces if entry.port_of for one in entry.addresses]
        return [(address, entry) for address, entry in ports if address in planned]

    @property
    def is_set_up(self) -> bool:
        """The collection has records there. Without a look there, it counts as set up."""
        return self.seen.found is None or self.seen.found.set_up

    @property
    def lacks_ros(self) -> bool:
        """True for the router, and for a second computer of a robot without ROS; a master's computer needs ROS."""
        return self.plan.is_router or (not self.plan.is_master and (not self.is_probed or bool(self.probe.ros_missing)))


def _find_usual_mtus(computers: Iterable[Participant]) -> dict[str, int]:
    """Return the MTU that most computers have on each network."""
    counts: dict[str, Counter[int]] = defaultdict(Counter)
    for computer in computers:
        for network, mtu in computer.mtus.items():
            counts[network][mtu] += 1
    return {network: max(sizes, key=lambda mtu: (sizes[mtu], mtu)) for network, sizes in counts.items()}


class FleetState:
    """The fleet and its observations, which all cases share.

    `least` are the Mbit/s that are expected; 0 for any. `since_last` are the seconds since the last verification; 0 without one.
    """

    def __init__(
        self, fleet: FleetPlan, observations: Mapping[str, Observation], least: float = 0.0, since_last: float = 0.0
    ) -> None:
        self.fleet, self.ways, self.least = fleet, Ways(fleet), least
        self.lately = max(LATELY, since_last)  # seconds; an event on a computer is as old as its own clock says
        # the computers of this run
        self.run = {
            name: Participant(name, plan, observations[name], self.ways)
            for name, plan in fleet.computers.items()
            if name in observations
        }
        probes = {one.plan.robot: one.seen.probe for one in self.run.values() if one.plan.is_master}
        # the nodes of each robot that announce a wrong host
        probed = {name: one.probe for name, one in self.run.items() if one.is_probed}
        self.misplaced = find_misplaced(fleet, probed)
        # the processes of each computer with a roscore of no robot
        self.strays = find_strays(fleet, probed, self.misplaced)
        self.exchanges = Exchanges(
            fleet,
            {robot: probe.exchange for robot, probe in probes.items() if probe and not probe.exchange.error},
            self.misplaced,
        )
        self.usual = _find_usual_mtus(self.run.values())  # network -> the MTU of most computers there
        # the packet filters, by the rules that were read
        self.filters = ReadFilters(fleet, {name: computer.seen for name, computer in self.run.items()})


class CheckContext:  # no dataclass: a large fleet has hundreds of thousands, and many checks look at each
    """The fleet, an observer, and a target: a member or a master of the plan."""

    def __init__(
        self, state: FleetState, observer: Participant, target: str, target_master: Master | None = None
    ) -> None:
        self.state = state
        self.fleet = state.fleet
        self.ways = state.ways
        self.run = state.run
        self.observer = observer
        self.target = target
        self.target_master = target_master  # in a check of masters only
        # of the target; empty for the router
        self.address = str(target_master.address) if target_master else self.ways.addresses.get(target, "")
        # the result of multimaster_verify on the observer; empty without one
        self.probe = observer.probe
        # the target, if it takes part in this run, and the datagrams between the two
        self.peer = self.run.get(target)
        self.udp = observer.udp.get(target) if self.peer is not None else None
        # the target in the result of multimaster_verify on the observer, an empty one without a result, and the topic of its talker
        self.member = observer.members.get(target, NOT_SEEN)
        self.topic = observer.topics.get(target)
        # target and observer among the members of the plan; None for the router
        self.planned = self.ways.members.get(target)
        self.own = self.ways.members.get(observer.name)

    @property
    def master(self) -> Master:
        """The target as a master, in a check of masters. Raises LookupError in other checks."""
        if self.target_master is None:
            raise LookupError(f"{self.target} is looked at as a computer, not as a master")
        return self.target_master

    @property
    def robots(self) -> tuple[str, str]:
        """The robot of the observer, and that of the target."""
        its = self.target_master or self.planned
        return self.observer.plan.robot, its.robot if its else ""

    @property
    def exchange(self) -> Exchange | None:
        """The content of the observer's roscore; None without an answer."""
        if not self.observer.plan.is_master or not self.observer.is_probed or self.probe.roscore.error:
            return None
        return self.probe.exchange

    @property
    def is_set_up_by_hand(self) -> bool:
        """The collection set up neither this computer nor its robot's master; on a master, something else runs the nodes."""
        if self.observer.is_set_up:
            return False
        master = self.run.get(self.masters[0])
        if master is None or master.seen.found is None:
            return master is None
        return not master.seen.found.set_up and bool(master.seen.found.runs)

    @property
    def was_never_set_up(self) -> bool:
        """The collection has no records on the observer, and nothing else runs the nodes of its robot."""
        return not self.observer.is_set_up and not self.is_set_up_by_hand

    @property
    def was_none_set_up(self) -> bool:
        """The collection has no records on any of the several computers of this run."""
        return len(self.run) > 1 and not any(computer.is_set_up for computer in self.run.values())

    @property
    def back_udp(self) -> DatagramCounts | None:
        """The datagrams between target and observer, as the target counts them."""
        return self.peer.udp.get(self.observer.name) if self.peer else None

    @property
    def way(self) -> Way:
        """The planned way of packets to the target."""
        return self.ways.way(self.observer.plan, self.target)

    @property
    def masters(self) -> tuple[str, str]:
        """The computers with the roscores of the observer and of the target."""
        return self.ways.master_of(self.observer.name), self.ways.master_of(self.target)
