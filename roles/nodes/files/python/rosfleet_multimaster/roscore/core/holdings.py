# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The memory that each robot holds for registrations and parameters, so that no robot fills it for the others.

The threat: any program of another robot, or of a stranger, registers nodes or sets parameters until the roscore takes no more.
The caller has a share, whatever it says in the request: a robot by all of its computers, and all strangers together. All that it gives
up, or another program replaces, is given back. It is kept with the registration (registry.py), so the count of each outlives a restart.
"""

from collections import Counter
from typing import Any, Collection, Dict, Iterable, Mapping, NamedTuple, Optional, Sequence, Tuple
from typing import Counter as Counts

from ...edge.core.shares import Shares
from .bounds import BOUNDS, refuse, weigh, weigh_member, weigh_record, weigh_registration
from .owners import Owner, Owners, find_place, list_owners
from .registry import Record, key_of, split_name

OWN = "this robot"  # all of its computers


class Change(NamedTuple):
    """A change of the parameters that is allowed."""

    growth: Mapping[Owner, int]  # bytes that each robot has more
    place: Sequence[str] = ()  # in the tree, at which
    owner: Optional[Tuple[Owner]] = None  # from now on; None if it is deleted

    @property
    def total(self) -> int:
        """Return the bytes that all have more together."""
        return sum(self.growth.values())


class Holdings:
    """The shares of both sums of a roscore."""

    def __init__(self) -> None:
        self._robots: Collection[str] = ()
        self._shares = {bound: _make_shares(bound, ()) for bound in ("registrations", "parameters")}
        self._made: Dict[
            Tuple[str, ...], Tuple[str, int]
        ] = {}  # a registration of another robot -> that robot, and the weight
        self.owners = Owners()  # of the parameters
        self.recount({})

    def set_robots(self, robots: Collection[str]) -> None:
        """Keep a part for each of these robots from now on."""
        self._robots = robots
        for bound, before in self._shares.items():
            self._shares[bound] = shares = _make_shares(bound, robots)
            for robot, size in before.counts.items():
                shares.add(robot, size)

    def count(self, robot: Owner, bound: str = "registrations") -> int:
        """Return how many bytes a robot has."""
        return self._shares[bound].count(_party(robot))

    # Registrations

    def have_room(self, robot: Owner, *texts: str) -> bool:
        """True if a robot has room for one more registration with these texts."""
        return self._shares["registrations"].have_room(_party(robot), weigh_registration(*texts))

    def check(self, robot: Owner, name: str, *texts: str) -> None:
        """Raise BoundRefusal if a robot has no room for one more registration with these texts."""
        self._check("registrations", robot, name, weigh_registration(*texts))

    def note(self, record: Record, growth: int) -> None:
        """Count a change of the registrations. `growth`: its addition to their sum."""
        shares, key = self._shares["registrations"], key_of(record)
        if key in self._made:
            robot, size = self._made.pop(key)
            shares.remove(robot, size)
            growth += size
        if record.by is not None and record.is_there:
            size = weigh_record(record)
            self._made[key] = record.by, size
            shares.add(record.by, size)
            growth -= size
        shares.add(OWN, growth)

    def find_maker(self, record: Record) -> Owner:
        """Return the other robot that has made a registration."""
        return self._made.get(key_of(record), (None, 0))[0]

    def restore(self, records: Iterable[Record], owners: Owners) -> None:
        """Take the owners of an earlier life, before their data is counted."""
        self._made = {key_of(record): (record.by, 0) for record in records if record.by is not None}
        self._shares["registrations"] = _make_shares("registrations", self._robots)
        self.owners = owners

    # Parameters

    def plan_set(self, tree: Mapping[str, Any], name: str, growth: int, robot: Owner) -> Change:
        """Plan that a robot sets a parameter. Raises BoundRefusal if it has no room.

        `growth`: its addition to the sum.
        """
        place = find_place(tree, split_name(name))
        changes: Counts[Owner] = Counter()
        if self.owners.find(place) != robot:  # else all of it was and is of this robot
            changes = self._find_changes(tree, place)
        changes[robot] += growth - sum(changes.values())
        if changes[robot] > 0:
            self._check("parameters", robot, name, changes[robot])
        return Change(changes, place, (robot,))

    def plan_delete(self, tree: Mapping[str, Any], name: str) -> Change:
        """Plan that a parameter is deleted."""
        parts = split_name(name)
        return Change(self._find_changes(tree, parts), parts)

    def _find_changes(self, tree: Mapping[str, Any], parts: Sequence[str]) -> Counts[Owner]:
        """Return how much less each robot has (below 0) without the values at a name."""
        changes: Counts[Owner] = Counter()
        value: Any = tree
        for part in parts:
            if not isinstance(value, dict) or part not in value:
                return changes
            value = value[part]
        for at, (owner, name, member) in enumerate(list_owners(value, self.owners.find(parts))):
            name = parts[-1] if not at and parts else name
            changes[owner] -= weigh_member(name, member) if at or parts else weigh(member)
        return changes

    def apply(self, change: Change) -> None:
        """Carry out a change that was planned."""
        self._add(change.growth)
        if change.owner:
            self.owners.set(change.place, *change.owner)
        elif change.place:
            self.owners.delete(change.place)

    def recount(self, tree: Mapping[str, Any]) -> None:
        """Count the parameters anew: rosmaster failed half way, or they are of an earlier life."""
        self._add({robot: -size for robot, size in self._shares["parameters"].counts.items()})
        self._add({robot: -size for robot, size in self._find_changes(tree, ()).items()})

    def _add(self, growth: Mapping[Owner, int]) -> None:
        for robot, size in growth.items():
            self._shares["parameters"].add(_party(robot), size)

    def _check(self, bound: str, robot: Owner, name: str, size: int) -> None:
        if not self._shares[bound].have_room(_party(robot), size):
            raise refuse(bound if robot is None else f"{bound} of one", name)


def _party(robot: Owner) -> str:
    return OWN if robot is None else robot


def _make_shares(bound: str, robots: Collection[str]) -> Shares:
    most = BOUNDS[bound].most
    return Shares(most, BOUNDS[f"{bound} of one"].most, robots, OWN, most // 2, most // 8)
