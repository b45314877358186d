# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A case: one observer and one target of a fleet, with everything that a check may look at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from ipaddress import IPv4Address

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.model import Gateway
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import (
    ComputerPlan,
    FleetPlan,
    Master,
    Member,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.exchange import Exchanges
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import (
    Datagrams,
    Exchange,
    HeardTopic,
    Icmp,
    ListedMaster,
    Multicast,
    Observation,
    Probe,
    SeenMaster,
    SeenMember,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.ways import Way, Ways


@dataclass(frozen=True)
class Participant:
    """A computer of the run: its plan and its observation, with an index for each list of the observation."""

    name: str
    plan: ComputerPlan
    seen: Observation
    members: Mapping[str, SeenMember] = field(default_factory=dict)
    masters: Mapping[str, SeenMaster] = field(default_factory=dict)  # by computer
    listed: Mapping[str, ListedMaster] = field(default_factory=dict)
    topics: Mapping[str, HeardTopic] = field(default_factory=dict)  # by computer of the talker
    udp: Mapping[str, Datagrams] = field(default_factory=dict)
    answered: frozenset[str] = frozenset()  # the members that answered its pings
    callers: frozenset[str] = frozenset()  # the addresses from which it was called
    # who answered each round of pings of the group, by the number of the round
    rounds: Sequence[tuple[int, frozenset[str]]] = ()

    @classmethod
    def of(cls, name: str, plan: ComputerPlan, seen: Observation) -> Participant:
        """Index an observation."""
        probe = seen.probe or Probe()
        multicast = seen.multicast or Multicast()
        return cls(
            name=name,
            plan=plan,
            seen=seen,
            members={entry.name: entry for entry in probe.members},
            masters={entry.computer: entry for entry in probe.masters},
            listed={entry.name: entry for entry in probe.list_masters.masters},
            topics={entry.computer: entry for entry in probe.topics},
            udp={entry.name: entry for entry in multicast.udp},
            answered=frozenset(entry.name for entry in probe.members if entry.ping_address and entry.ping_address.ok),
            callers=frozenset(entry.address for entry in multicast.callers),
            rounds=_rounds(multicast.icmp),
        )

    @property
    def without_ros(self) -> bool:
        """True for the router, and for a second computer of a robot without ROS; a master's computer needs ROS."""
        return not self.plan.is_master and (self.seen.probe is None or bool(self.seen.probe.ros_missing))


# The pairs of computers that a check may name in `explained_by`, before a colon.
def _rounds(icmp: Icmp | None) -> Sequence[tuple[int, frozenset[str]]]:
    return [(entry.round, frozenset(entry.answered)) for entry in icmp.rounds] if icmp else ()


def _set_up(computer: Participant) -> bool:
    """The collection has records there; so it is taken where nobody looked."""
    return computer.seen.found is None or computer.seen.found.set_up


def _runs(computer: Participant) -> bool:
    return computer.seen.found is not None and bool(computer.seen.found.runs)


SIDES = (
    "",  # observer and target of the check itself
    "observer",
    "target",
    "back",  # the target looks at the observer
    "gateway",  # of the observer's network
    "its gateway",  # of the target's network
    "to gateway",
    "to its gateway",
    "master",  # the computer with the observer's roscore
    "its master",
    "to its master",
    "between masters",
)


@dataclass(eq=False)  # not frozen: there are millions in a large fleet, and freezing makes them three times slower
class Case:
    """The fleet, an observer, and a target, which is a member or a master of the plan."""

    fleet: FleetPlan
    ways: Ways
    observer: Participant
    target: str
    address: IPv4Address  # of the target
    target_master: Master | None  # in a check of masters only
    run: Mapping[str, Participant]  # the computers of this run
    exchanges: Exchanges

    @property
    def master(self) -> Master:
        """The master that the target is, in a check of masters. Raises LookupError in other checks."""
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
        """The content of the observer's roscore; None without a roscore, and where it does not answer."""
        if not self.observer.plan.is_master or self.probe is None or self.probe.roscore.error:
            return None
        return self.probe.exchange

    @property
    def by_hand(self) -> bool:
        """The collection did not set the computer up, and not its robot's master, where something else runs the nodes."""
        if _set_up(self.observer):
            return False
        master = self.run.get(self.masters[0])
        return master is None or (not _set_up(master) and (master is not self.observer or _runs(master)))

    @property
    def probe(self) -> Probe | None:
        """The result of multimaster_verify on the observer."""
        return self.observer.seen.probe

    @property
    def peer(self) -> Participant | None:
        """The target, if it takes part in this run."""
        return self.run.get(self.target)

    @property
    def udp(self) -> Datagrams | None:
        """The datagrams between observer and target; None where the target does not take part."""
        return self.observer.udp.get(self.target) if self.target in self.run else None

    @property
    def back_udp(self) -> Datagrams | None:
        """The datagrams between target and observer, as the target counts them."""
        return self.peer.udp.get(self.observer.name) if self.peer else None

    def hears_target(self) -> bool:
        """Say if datagrams of the target arrive here on the group."""
        return bool(self.udp and self.udp.heard_from)

    @property
    def member(self) -> SeenMember | None:
        """The target, as multimaster_verify on the observer saw it."""
        return self.observer.members.get(self.target)

    @property
    def topic(self) -> HeardTopic | None:
        """The topic of the target's talker, as the observer heard it."""
        return self.observer.topics.get(self.target)

    @property
    def planned(self) -> Member | None:
        """The target among the members of the plan; None for the router."""
        return self.ways.members.get(self.target)

    @property
    def own(self) -> Member | None:
        """The observer among the members of the plan; None for the router."""
        return self.ways.members.get(self.observer.name)

    @property
    def way(self) -> Way:
        """The planned way of packets to the target."""
        return self.ways.way(self.observer.plan, self.target)

    @property
    def gateways(self) -> tuple[Gateway | None, Gateway | None]:
        """The gateways on the way to the target; in a check of one computer the gateway of its network, and None."""
        if self.target in self.ways.members and self.target != self.observer.name:
            return self.way.own, self.way.its
        behind = not self.observer.plan.common_address
        return self.ways.gateways.get(self.observer.plan.robot) if behind else None, None

    @property
    def masters(self) -> tuple[str, str]:
        """The computers with the roscores of the observer and of the target."""
        return self.ways.master(self.observer.plan.robot), self.ways.master(self.planned.robot if self.planned else "")

    def sides(self) -> dict[str, tuple[str, str]]:
        """Find the (observer, target) of each of SIDES; an empty name is nobody's."""
        observer, target = self.observer.name, self.target
        gateway, its_gateway = (found.name if found else "" for found in self.gateways)
        master, its_master = self.masters
        pairs = (
            (observer, target),
            (observer, observer),
            (target, target),
            (target, observer),
            (gateway, gateway),
            (its_gateway, its_gateway),
            (observer, gateway),
            (observer, its_gateway),
            (master, master),
            (its_master, its_master),
            (observer, its_master),
            (master, its_master),
        )
        return dict(zip(SIDES, pairs, strict=True))
