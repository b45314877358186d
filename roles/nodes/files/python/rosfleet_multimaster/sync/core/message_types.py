# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Types of shared topics, compared here and there: answers of nodes and masters in, questions and refusals out.

The roscore is not enough. It keeps one type per topic, that of the last publisher (a later subscriber changes nothing),
even when all nodes of the topic are gone. So own nodes that share a topic with another master are asked for its type,
and the master's discovery for md5 sums of the types that own nodes have.

Free of sockets, threads and clocks.
"""

import math
from typing import AbstractSet, Any, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

from ...protocol.filters import UNKNOWN_TYPES
from ...protocol.messages import NodeKey, View
from ...protocol.plain_text import quote
from .sync import Candidate, RegistrationConflict

MOST = 500  # types of one question
AGAIN = 60.0  # seconds until the same is asked again: no event announces a new answer
Users = Mapping[NodeKey, None]  # own nodes on a topic, in their order


class TypeVerdict(NamedTuple):
    """The candidates to register now, the conflicts, and the questions to ask."""

    wanted: List[Candidate]
    refused: List[RegistrationConflict]
    nodes: List[NodeKey]  # own nodes to be asked for the types of their topics
    masters: Mapping[str, AbstractSet[str]]  # master to be asked -> types whose md5 sums are wanted


class _Book:
    """The questions that were asked, and the answers, by who is asked: a node or a master."""

    def __init__(self) -> None:
        self.answers: Dict[Any, Mapping[str, str]] = {}
        self._asked: Dict[Any, Tuple[AbstractSet[str], float, float]] = {}  # names, stamp, valid until
        self._open: Set[Any] = set()

    def open(self, names: Mapping[Any, AbstractSet[str]], stamps: Mapping[Any, float], now: float) -> List[Any]:
        """Open the questions for these names that are due, and forget all other keys. The keys to ask now."""
        asked = [key for key in names if self._open_one(key, names[key], stamps.get(key, 0.0), now)]
        for key in (self.answers.keys() | self._asked.keys()) - names.keys():
            self.answers.pop(key, None)
            self._asked.pop(key, None)
        return asked

    def _open_one(self, key: Any, names: AbstractSet[str], stamp: float, now: float) -> bool:
        """True if these names must be asked now: a name or the stamp is new."""
        asked, before, until = self._asked.get(key, (frozenset(), stamp, -math.inf))
        if key in self._open:
            return False
        if key in self.answers:  # a topic that has gone may come back with a new type
            self.answers[key] = {name: text for name, text in self.answers[key].items() if name in names}
        if names <= asked and stamp == before and now < until:
            self._asked[key] = names, before, until
            return False
        self._asked[key] = names, stamp, math.inf
        self._open.add(key)
        return True

    def waits(self, key: Any, name: str) -> bool:
        """True if an answer is awaited, and there is no earlier one."""
        return key in self._open and name not in self.answers.get(key, ())

    def answer(self, key: Any, answer: Optional[Mapping[str, str]], now: float) -> None:
        """Take the answer. Without one (None) the earlier answer counts."""
        self._open.discard(key)
        if answer is not None:
            self.answers[key] = answer
        if key in self._asked:
            self._asked[key] = (*self._asked[key][:2], now + AGAIN)


class TypeGuard:
    """Refuses registrations on topics that own nodes have with a different type, or with a different md5 sum of it."""

    def __init__(self) -> None:
        self._nodes = _Book()  # own node -> topic -> type
        self._masters = _Book()  # master -> type -> md5 sum there
        self._own_md5: Dict[str, str] = {}

    def judge(
        self,
        wanted: Sequence[Candidate],
        view: View,
        claims: Mapping[NodeKey, str],
        stamps: Mapping[str, float],
        now: float,
    ) -> TypeVerdict:
        """`stamps`: of each master's state; with a new stamp, its answers may have changed.

        A new registration on a shared topic waits for the answers to open questions. A present one stays meanwhile.
        """
        users = view.local_nodes(claims)
        shared = [item for item in wanted if _type(item) and item.registration.name in users]
        topics = {item.registration.name for item in shared}
        asked_nodes = self._nodes.open(_group_by_node(topics, users), {}, now)
        named = {topic: self._types_of_users(topic, users[topic]) for topic in topics}
        types = _group_by_master(shared, named)
        asked_masters = {master: types[master] for master in self._masters.open(types, stamps, now)}
        held, conflicts = view.registrations(claims), self._conflicts(shared, users, named, view)

        def is_ready(item: Candidate) -> bool:
            topic = item.registration.name
            if not _type(item) or topic not in users:
                return True
            if (topic, item.master) in conflicts:
                return False
            return item.registration in held or not self._waits(item, users[topic], named[topic])

        refused = [RegistrationConflict("type", topic, master, *sides) for (topic, master), sides in conflicts.items()]
        return TypeVerdict([item for item in wanted if is_ready(item)], refused, asked_nodes, asked_masters)

    def take_node_types(self, node: NodeKey, types: Optional[Mapping[str, str]], now: float) -> None:
        """Take the answer of an own node: topic -> type; None if it does not answer."""
        self._nodes.answer(node, types, now)

    def take_md5sums(
        self, master: str, there: Optional[Mapping[str, str]], here: Mapping[str, str], now: float
    ) -> None:
        """Take the md5 sums of types there (None: no answer) and here."""
        self._masters.answer(master, there, now)
        self._own_md5.update(here)

    def _types_of_users(self, topic: str, users: Users) -> Dict[str, str]:
        """Type -> the own node that has the topic with it."""
        types: Dict[str, str] = {}
        for node in users:
            kind = self._nodes.answers.get(node, {}).get(topic, "")
            if kind not in UNKNOWN_TYPES:
                types.setdefault(kind, node[0])
        return types

    def _conflicts(
        self,
        shared: Sequence[Candidate],
        users: Mapping[str, Users],
        named: Mapping[str, Dict[str, str]],
        view: View,
    ) -> Dict[Tuple[str, str], Tuple[str, str]]:
        """(topic, master) -> its type there, and here."""
        there: Dict[Tuple[str, str], List[Candidate]] = {}
        for item in shared:
            there.setdefault((item.registration.name, item.master), []).append(item)
        conflicts = {}
        for (topic, master), items in there.items():
            here = named[topic] or self._roscore_type(topic, users[topic], view)
            if not here:
                continue
            nodes = ", ".join(quote(node) for node in sorted({item.registration.node for item in items})[:3])
            kind = items[0].type
            theirs, ours = self._masters.answers.get(items[0].master_uri, {}).get(kind), self._own_md5.get(kind)
            if kind not in here:
                own_kind, node = next(iter(here.items()))
                conflicts[topic, master] = f"{quote(kind)} (of {nodes})", f"{quote(own_kind)} (of {quote(node)})"
            elif theirs and ours and theirs != ours and kind in named[topic]:
                conflicts[topic, master] = (
                    f"{quote(kind)} with the md5 sum {quote(theirs)} (of {nodes})",
                    f"{quote(kind)} with {quote(ours)} (of {quote(here[kind])})",
                )
        return conflicts

    def _roscore_type(self, topic: str, users: Users, view: View) -> Dict[str, str]:
        """The type in the roscore, if no own node names one. A node that takes any type conflicts with no other."""
        kind = view.types.get(topic, "")
        if kind in UNKNOWN_TYPES or self._silent(topic, users):
            return {}
        if any(topic in self._nodes.answers.get(node, {}) for node in users):
            return {}
        return {kind: next(iter(users))[0]}

    def _waits(self, item: Candidate, users: Users, named: Mapping[str, str]) -> bool:
        if self._silent(item.registration.name, users):
            return True
        return item.type in named and self._masters.waits(item.master_uri, item.type)

    def _silent(self, topic: str, users: Users) -> bool:
        """True while an own node has yet to name its type of the topic."""
        return any(self._nodes.waits(node, topic) for node in users)


def _type(item: Candidate) -> str:
    """The type of a wanted topic, "" if there is nothing to compare."""
    return "" if item.registration.kind == "service" or item.type in UNKNOWN_TYPES else item.type


def _group_by_node(topics: Iterable[str], users: Mapping[str, Iterable[NodeKey]]) -> Dict[NodeKey, Set[str]]:
    """Own node that shares topics, and can be asked -> these topics."""
    nodes: Dict[NodeKey, Set[str]] = {}
    for topic in topics:
        for node in users[topic]:
            if node[1]:
                nodes.setdefault(node, set()).add(topic)
    return nodes


def _group_by_master(shared: Sequence[Candidate], named: Mapping[str, Mapping[str, str]]) -> Dict[str, Set[str]]:
    """Master -> those of its types that an own node has, too. A type that only others have is never imported."""
    groups: Dict[str, Set[str]] = {}
    for item in shared:
        if item.type in named[item.registration.name]:
            groups.setdefault(item.master_uri, set()).add(item.type)
    return {master: set(sorted(types)[:MOST]) for master, types in groups.items()}
