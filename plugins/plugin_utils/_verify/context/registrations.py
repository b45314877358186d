# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The registrations that pass between robots: the planned flows (Flows), and the contents of the roscores (Exchanges).

Pure: the plan of the fleet and the observed contents of roscores in, facts out. Each robot's registrations are read
once. Pairs are compared by their sets, and names only if two robots have the same one.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import islice
from typing import NamedTuple, cast

from ..._inventory import filters
from ..._inventory.flows import VERIFICATION_TOPICS
from ..._plan.model import FleetPlan
from ..observe.observations import Exchange, Import, NodeConnection
from ..observe.uris import normalise_uri

MOST = 20_000  # registrations of a robot that are compared: of another one, the nodes take 5,000
RELAY = "/master_relay"  # the check of the relay judges its topics
#: the nodes that the collection starts, or its provider, and the one of each roscore
COLLECTION = frozenset(("/master_discovery", "/master_sync", "/mas_discovery", "/mas_sync", RELAY, "/rosout"))
TEST_NODES = "/multimaster_verify_"  # the beginning of the names of the verification's own nodes
#: Types of topics on which each message says of whom it is: many nodes of a single robot publish them, too.
MEANT_FOR_MANY = (
    "diagnostic_msgs/DiagnosticArray",
    "diagnostic_msgs/DiagnosticStatus",
    "rosgraph_msgs/Log",
    "rosgraph_msgs/TopicStatistics",
)
_BRIDGE = re.compile(r"(?:/\w+)*/ros1?_bridge\w*")  # a node of the package ros1_bridge calls itself /ros_bridge


class RegisteredItem(NamedTuple):
    """One registration of a node."""

    kind: str  # publisher, subscriber or service
    name: str
    node: str

    def __str__(self) -> str:
        return f"the {self.kind} {self.name} of {self.node}" if self.kind != "service" else f"the service {self.name}"


class Clash(NamedTuple):
    """A node or service that two robots have: a roscore can hold only one of them. Or a topic that both publish."""

    kind: str  # node, service or topic
    name: str
    robots: tuple[str, str]


class Conflict(NamedTuple):
    """A topic that differs on two robots; each of the two is (robot, type, md5 sum)."""

    topic: str
    one: tuple[str, str, str]
    other: tuple[str, str, str]


@dataclass(frozen=True)
class FlowRules(filters.Rules):
    """The rules from robot to robot: the filters of the receiver, and the declared flow if there is one."""

    hide_subscribers: filters.Pattern = filters.Pattern()  # a parameter of the giving robot

    @classmethod
    def from_patterns(cls, patterns: Mapping[str, Iterable[str]]) -> FlowRules:
        """Make rules of patterns, by the names of the fields."""
        rules = cls(**{rule.name: filters.usable(patterns.get(rule.name, ())) for rule in fields(cls)})
        return cast(FlowRules, rules.complete_white_lists())  # it keeps the class

    def passes(self, item: RegisteredItem, type_name: str) -> bool:
        """Return True if a registration is to be known to the receiving robot."""
        if item.kind == "service":
            return self.service(item.node, item.name)
        if item.kind == "subscriber" and self.hide_subscribers.matches(item.name):
            return False
        return self.topic(item.node, item.name, type_name, item.kind == "publisher")


NOTHING = FlowRules.from_patterns({"ignore_nodes": ("*",)})


class Flows:
    """The planned flows between the robots of a fleet."""

    def __init__(self, fleet: FleetPlan) -> None:
        self._masters = fleet.master_of
        self._plans = {robot: fleet.computers[master.computer] for robot, master in self._masters.items()}
        self._declared: dict[tuple[str, str], tuple[list[str], list[str]]] = defaultdict(lambda: ([], []))
        for flow in fleet.flows:
            for source in flow.givers:
                for target in flow.to:
                    if source != target:
                        topics, services = self._declared[source, target]
                        topics += flow.topics
                        services += flow.services
        self._rules: dict[tuple[str, str], FlowRules] = {}
        self._by_patterns: dict[tuple[tuple[str, ...], ...], FlowRules] = {}
        # by receiving robot
        self._filters = {robot: filters.Filters(plan.sync, lenient=True) for robot, plan in self._plans.items()}
        self._general: dict[str, Mapping[str, Sequence[str]]] = {}  # the patterns that hold for all masters
        # (robot, topic) of the declarations
        self._named = {(giver, topic) for flow in fleet.flows for giver in flow.givers for topic in flow.topics}

    def rules(self, source: str, target: str) -> FlowRules:
        """Return the rules by which registrations pass from one robot to another."""
        key = source, target
        if key not in self._rules:
            self._rules[key] = self._make_rules(source, target)
        return self._rules[key]

    def declares_nothing(self, source: str, target: str) -> bool:
        """Return True if a robot declares (multimaster_exports) that it gives the target nothing."""
        return self._masters[source].declared and self.rules(source, target) == NOTHING

    def names_topic(self, robot: str, topic: str) -> bool:
        """Return True if a robot declares a topic by its whole name, so that it is given on purpose."""
        return (robot, topic) in self._named

    def _make_rules(self, source: str, target: str) -> FlowRules:
        """Make the rules of a pair. The declared flow itself is used, not the white lists that the plan makes of it."""
        name, parameters = self._masters[source].name, self._filters[target]
        if any(map(parameters.values.get, filters.HOSTS)) and not parameters.wants_host(name):
            return NOTHING
        values: dict[str, Iterable[str]] = {**self._patterns(target, name)}
        if self._masters[source].declared:
            if (source, target) not in self._declared:
                return NOTHING
            topics, services = self._declared[source, target]
            values.update(sync_nodes=(), sync_topics=(*topics, VERIFICATION_TOPICS), sync_services=tuple(services))
        values["hide_subscribers"] = self._plans[source].discovery.get("hide_subscribers", ())
        key = tuple(tuple(patterns) for patterns in values.values())
        if key not in self._by_patterns:
            self._by_patterns[key] = FlowRules.from_patterns(values)
        return self._by_patterns[key]

    def _patterns(self, target: str, name: str) -> Mapping[str, Sequence[str]]:
        """Return the patterns of a receiving robot for a master. Patterns for all masters are read once."""
        parameters = self._filters[target]
        if _particular(parameters.values.values()):
            return {rule: parameters.patterns(rule, name) for rule in filters.NAMES}
        if target not in self._general:
            self._general[target] = {rule: tuple(parameters.patterns(rule, name)) for rule in filters.NAMES}
        return self._general[target]


def _particular(values: Iterable[object]) -> bool:
    """Return True if some of the parameters of master_sync are for only one master: such are mappings."""
    return any(isinstance(value, dict) or (isinstance(value, list) and _particular(value)) for value in values)


class RoscoreIndex(NamedTuple):
    """The content of a robot's roscore, indexed."""

    own: Mapping[RegisteredItem, str]  # registration of an own node -> type
    sums: Mapping[str, tuple[str, str]]  # topic of own nodes -> type, md5 sum
    imports: Mapping[str, Mapping[RegisteredItem, str]]  # URI of the other master -> item -> type

    @classmethod
    def from_content(cls, exchange: Exchange) -> RoscoreIndex:
        """Index an observation."""
        return cls(
            own=dict(islice(_items(exchange), MOST)),
            sums={topic.name: (topic.type, topic.md5sum) for topic in exchange.topics[:MOST]},
            imports={
                normalise_uri(component.master): dict(islice(_items(component), MOST)) for component in exchange.imports
            },
        )

    def list_bridged_topics(self) -> frozenset[str]:
        """List the topics of own nodes of ros1_bridge."""
        return frozenset(item.name for item in self.own if item.kind != "service" and _BRIDGE.fullmatch(item.node))

    def names(self) -> dict[tuple[str, str], list[RegisteredItem]]:
        """List the registrations by (kind, name) of own nodes, services and published topics, without those of every robot."""
        names: dict[tuple[str, str], list[RegisteredItem]] = defaultdict(list)
        for item in self.own:
            if filters.matches(filters.BUILT_IN["ignore_nodes"], item.node) or item.node.startswith(TEST_NODES):
                continue
            names["node", item.node].append(item)
            if item.kind == "service":
                names["service", item.name].append(item)
            elif item.kind == "publisher" and self.own[item] not in MEANT_FOR_MANY:
                names["topic", item.name].append(item)
        return names


def _items(component: Exchange | Import) -> Iterator[tuple[RegisteredItem, str]]:
    """Yield each registration with its type."""
    for topic in component.topics:
        for kind, nodes in (("publisher", topic.publishers), ("subscriber", topic.subscribers)):
            for node in nodes:
                yield RegisteredItem(kind, topic.name, node), topic.type
    for service in component.services:
        yield RegisteredItem("service", service.name, service.node), ""


class Exchanges:
    """The contents of all roscores of a run, with the planned flows."""

    def __init__(
        self, fleet: FleetPlan, seen: Mapping[str, Exchange], misplaced: Mapping[str, Collection[str]] | None = None
    ) -> None:
        """Index the contents of the roscores, by robot; robots without content are left out.

        `misplaced` are the nodes of each robot that announce a wrong host, so that no other robot takes them.
        """
        self._misplaced = misplaced or {}
        self.flows = Flows(fleet)
        self.robots = {robot: RoscoreIndex.from_content(exchange) for robot, exchange in seen.items()}
        self._uris = {robot: [normalise_uri(uri) for uri in uris] for robot, uris in fleet.master_uris.items()}
        self._wanted: dict[tuple[str, int], frozenset[RegisteredItem]] = {}  # by robot and id of its rules
        self._holders, self._shared = _find_shared_names({robot: has.names() for robot, has in self.robots.items()})
        self._bridged = {robot: has.list_bridged_topics() for robot, has in self.robots.items()}
        self._unlike = _find_unlike({robot: has.sums for robot, has in self.robots.items()})

    def find_due(self, source: str, target: str) -> frozenset[RegisteredItem]:
        """Return the registrations that the target is to get of a source with a known content."""
        rules = self.flows.rules(source, target)
        key = source, id(rules)
        if key not in self._wanted:
            self._wanted[key] = frozenset(
                item
                for item, kind in self.robots[source].own.items()
                if not item.node.startswith(TEST_NODES)
                and not (item.kind == "publisher" and kind in filters.UNKNOWN_TYPES)
                and rules.passes(item, kind)
            )
        return self._wanted[key]

    def find_missing(self, source: str, target: str) -> list[RegisteredItem]:
        """List the registrations that the target is to get and lacks, without the refusals that another check reports."""
        if source not in self.robots:
            return []
        absent = self.find_due(source, target) - self.find_imports(source, target).keys()
        if not absent:
            return []
        clashes = {(clash.kind, clash.name) for clash in self.clashes(source, target)}
        topics = {conflict.topic for conflict in self.conflicts(source, target)}
        return sorted(
            item
            for item in absent
            if item.node not in self._misplaced.get(source, ())
            and ("node", item.node) not in clashes
            and (item.name not in topics if item.kind != "service" else ("service", item.name) not in clashes)
        )

    def superfluous(self, source: str, target: str) -> list[RegisteredItem]:
        """List the registrations that the target has of the source and is not to get."""
        imports = self.find_imports(source, target)
        due = self.find_due(source, target) if source in self.robots else frozenset()
        rules = self.flows.rules(source, target)
        return sorted(item for item in imports.keys() - due if not rules.passes(item, imports[item]))

    def find_imports(self, source: str, target: str) -> Mapping[RegisteredItem, str]:
        """Return the registrations that a target with a known content has of the source, with the types."""
        imports = self.robots[target].imports
        return next((imports[uri] for uri in self._uris[source] if uri in imports), {})

    def clashes(self, source: str, target: str) -> list[Clash]:
        """List the names that pass from `source` and that `target` has itself, or gets of a third robot."""
        clashes: dict[tuple[str, str], Clash] = {}
        for key in self._shared.get(source, ()):  # nodes come first
            if key[0] == "service" and ("node", self._holders[key][source][0].node) in clashes:
                continue  # the clash of its node says so already
            if key[0] != "topic" and (clash := self._find_clash(key, source, target)):
                clashes[key] = clash
        return list(clashes.values())

    def find_shared_topics(self, source: str, target: str) -> list[Clash]:
        """List the topics that pass from `source`, and that `target` or a third robot, which gives it to `target`, publishes, too.

        A topic that both robots declare by its whole name is left out: that is on purpose.
        """
        keys = (key for key in self._shared.get(source, ()) if key[0] == "topic")
        found = filter(None, (self._find_clash(key, source, target) for key in keys))
        return [
            clash for clash in found if not all(self.flows.names_topic(robot, clash.name) for robot in clash.robots)
        ]

    def find_bridged_topics(self, source: str, target: str) -> list[str]:
        """List the topics that pass from `source`, and that a node of ros1_bridge has on both robots."""
        both = self._bridged[source] & self._bridged[target]
        return (
            sorted({item.name for item in self.find_due(source, target) if item.kind == "publisher"} & both)
            if both
            else []
        )

    def find_bridges(self, robots: Collection[str]) -> list[str]:
        """List the nodes of ros1_bridge that have a topic which nodes of ros1_bridge have on all of these robots."""
        topics = frozenset.intersection(*(self._bridged[robot] for robot in robots)) if robots else frozenset()
        return sorted(
            {
                item.node
                for robot in robots
                for item in self.robots[robot].own
                if item.name in topics and _BRIDGE.fullmatch(item.node)
            }
        )

    def _find_clash(self, key: tuple[str, str], source: str, target: str) -> Clash | None:
        if not self._passes(key, source, target) or not (other := self._find_holder(key, source, target)):
            return None
        first, second = sorted((source, other))
        return Clash(*key, robots=(first, second))

    def _find_holder(self, key: tuple[str, str], source: str, target: str) -> str | None:
        holders = self._holders[key]
        if target in holders:
            return target
        return next((robot for robot in holders if robot != source and self._passes(key, robot, target)), None)

    def _passes(self, key: tuple[str, str], source: str, target: str) -> bool:
        return not self.find_due(source, target).isdisjoint(self._holders[key][source])

    def conflicts(self, source: str, target: str) -> list[Conflict]:
        """List the topics that pass from `source` and that own nodes of `target` have with another type or md5 sum."""
        mine, theirs = self.robots[target].sums, self.robots[source].sums
        topics = [
            name for name in sorted(mine.keys() & theirs.keys() & self._unlike) if _differ(mine[name], theirs[name])
        ]
        if not topics:
            return []
        passing = {item.name for item in self.find_due(source, target) if item.kind != "service"}
        return [Conflict(name, (source, *theirs[name]), (target, *mine[name])) for name in topics if name in passing]

    def odd(self, conflict: Conflict) -> str:
        """Name the one robot whose type or md5 sum of a topic differs from all others; empty if no robot is the only one."""
        topic = conflict.topic
        kinds = {robot: has.sums[topic] for robot, has in self.robots.items() if topic in has.sums}
        odd = [one for one in kinds if all(_differ(kinds[one], kind) for robot, kind in kinds.items() if robot != one)]
        return odd[0] if len(odd) == 1 else ""

    def find_crossing_links(self, links: Iterable[NodeConnection], own: str, other: str) -> list[NodeConnection]:
        """List the connections between nodes of two robots that no planned registration explains.

        A subscriber that passes hears all publishers of its topic on the other robot, even those that do not pass.
        """
        types = self.robots[own].sums
        crossing = []
        for link in links:
            if link.robot != other or link.node == RELAY:
                continue
            mine, theirs = (own, link.node), (other, link.peer)
            publisher, subscriber = (theirs, mine) if link.direction == "in" else (mine, theirs)
            kind = types.get(link.topic, ("", ""))[0]
            passing = self.flows.rules(publisher[0], subscriber[0]).passes(
                RegisteredItem("publisher", link.topic, publisher[1]), kind
            )
            back = self.flows.rules(subscriber[0], publisher[0]).passes(
                RegisteredItem("subscriber", link.topic, subscriber[1]), kind
            )
            if not passing and not back:
                crossing.append(link)
        return crossing


def _find_shared_names(
    names: Mapping[str, Mapping[tuple[str, str], Sequence[RegisteredItem]]],
) -> tuple[dict[tuple[str, str], dict[str, Sequence[RegisteredItem]]], dict[str, list[tuple[str, str]]]]:
    """Find the (kind, name) that several robots have: robot and registrations of each, and the list of each robot."""
    holders: dict[tuple[str, str], dict[str, Sequence[RegisteredItem]]] = defaultdict(dict)
    for robot, registrations in names.items():
        for key, items in registrations.items():
            holders[key][robot] = items
    holders = {key: robots for key, robots in holders.items() if len(robots) > 1}
    shared: dict[str, list[tuple[str, str]]] = defaultdict(list)
    for key in sorted(holders):
        for robot in holders[key]:
            shared[robot].append(key)
    return holders, shared


def _find_unlike(sums: Mapping[str, Mapping[str, tuple[str, str]]]) -> frozenset[str]:
    """Return the topics that differ between the robots that have them."""
    kinds: dict[str, set[tuple[str, str]]] = defaultdict(set)
    for topics in sums.values():
        for name, kind in topics.items():
            kinds[name].add(kind)
    return frozenset(name for name, variants in kinds.items() if len(variants) > 1)


def _differ(one: tuple[str, str], other: tuple[str, str]) -> bool:
    """Return True if two of (type, md5 sum) are known to be different."""
    if one[0] in filters.UNKNOWN_TYPES or other[0] in filters.UNKNOWN_TYPES:
        return False
    return one[0] != other[0] or bool(one[1] and other[1] and one[1] != other[1])
