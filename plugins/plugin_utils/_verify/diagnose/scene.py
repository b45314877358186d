# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The state of a diagnosis: the rows that no finding explains yet, the findings so far, and the evidence of successes and values on a component.

The rules of rules.py change it, in their order. It knows none of them.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain, islice

from ..._faults.fault import ALWAYS
from ..checks.engine import OK, Judgement, Row, Verification
from ..components.component import ANY, FOLLOWS, RULED, Component
from ..context.check_context import Participant
from ..context.errors import find_components
from ..context.needs import Components
from ..trace.findings import SeenEnd, find_ends
from ..trace.probes import list_trips
from .finding import Finding

ALL_NODES = ("nodes", "nodes in", "nodes out")  # filters of any port, and so of the others, too
ASKED = 60  # pairs that are looked at for a success that clears a component
ENOUGH = 3  # successes that clear it, if it lets nothing pass
MANY = 20  # those that are counted of a component that lets some things pass: their share says how likely it is
UNREAD = 1.0  # the extra cost of a component that a value would show, if it had been read
NOT_FOUND = 2.0  # the extra cost of a packet filter if the rules were read and none of them drops it


class OpenRow:
    """A row that is not ok, as its check has judged it, and the components that may be its reason."""

    def __init__(self, number: int, row: Row, verification: Verification) -> None:
        self.number, self.row = number, row
        check = verification.checks[row.check]
        context = verification.make_context(check, row.observer, row.target)
        judged = check.look(context) or Judgement(row.verdict)
        self.outcome = judged.outcome
        self.shown = context.ways.seal(judged.broken)  # by a value
        self.left = context.ways.seal(find_components(context, judged.outcome, check.carries))  # by an error
        self._verification = verification
        self._suspects: Components | None = None

    @property
    def suspects(self) -> Components:
        """The components that may be its reason: those that an error leaves, or else all that the check names."""
        if self._suspects is None:
            self._suspects = self.left or self._verification.list_suspects(self.row)
        return self._suspects

    @suspects.setter
    def suspects(self, components: Components) -> None:
        self._suspects = components


class Scene:
    """The state of a diagnosis."""

    def __init__(self, verification: Verification, rows: Sequence[Row]) -> None:
        self.verification = verification
        self.bad = {(row.check, row.observer, row.target) for row in rows}
        self.broken: dict[Component, Finding] = {}  # a finding for each component, at first
        self.winners: dict[Row, str] = {}  # row -> the rule that has explained it
        self.traced: dict[Row, str] = {}  # row on a way that was followed -> the rule that has followed it
        self.outcomes: dict[Row, str] = {}  # row -> the outcome of a probe of its check, if an error shows a component
        self.places: dict[tuple[str, ...], list[Component]] = defaultdict(
            list
        )  # the components that values show as broken, by place
        self.cleared: dict[tuple[str, str], Counter[Component]] = {}
        self.by_chance: dict[int, Components] = {}  # number of a row -> the losses that it may be by chance
        self.open = [OpenRow(number, row, verification) for number, row in enumerate(rows)]
        self.numbers = {row: number for number, row in enumerate(rows)}
        self.shown: dict[Component, list[SeenEnd]] = defaultdict(
            list
        )  # the observations of packets at the place of a component
        self.ends = [
            replace(end, sign=None) if self._is_disproved(end.sign) else end for end in find_ends(verification)
        ]

    def find(self, component: Component, rule: str) -> Finding:
        """Return the finding of a component; a new one is of this rule."""
        return self.broken.setdefault(component, Finding(component, rule=rule))

    def prove(self, components: Components, row: Row, rule: str) -> None:
        """Note that a row shows components to be broken."""
        for component in components:
            self.find(component, rule).proof.append(row)
        self.winners[row] = rule

    def explain(self, component: Component, rows: Iterable[Row], rule: str) -> None:
        """Note that the finding of a component explains rows."""
        for row in rows:
            self.find(component, rule).rows.append(row)
            self.winners[row] = rule

    def order_proofs(self) -> None:
        """Bring the findings and their rows into the order of the rows: each rule has looked at all of them."""
        for entry in self.broken.values():
            entry.proof.sort(key=self.numbers.__getitem__)
        first = {component: self.numbers[entry.proof[0]] for component, entry in self.broken.items()}
        self.broken = dict(sorted(self.broken.items(), key=lambda item: (first[item[0]], item[0])))

    def find_end(self, row: Row) -> SeenEnd | None:
        """Find the place where packets of the same kind ended on the way of a row."""
        for trip in list_trips(self.verification, row) if self.ends else ():
            own = [end for end in self.ends if end.trip == trip]
            computers = self.list_computers(trip.sender, trip.target)
            same = [end for end in self.ends if end.trip.traffic == trip.traffic and end.crosses(computers)]
            if own or same:
                return (own or same)[0]
        return None

    def _is_disproved(self, sign: Component | None) -> bool:
        """Return True if a setting that was read right is blamed by a counter of the whole machine, which spoofed packets count up, too."""
        return sign is not None and sign.kind == "reverse_path" and self.is_cleared(sign)

    def is_cleared(self, component: Component) -> bool:
        """Return True if a check of a single computer succeeded that needs the component, at one of its places."""
        return any(self.count_needs(place, place)[component] for place in component.places)

    def is_possible(self, component: Component) -> bool:
        """Return True if a component may be broken by the values of its own place: a setting that is right, or a filter without a rule."""
        if component in self.broken:
            return True
        return not self.is_cleared(component) and self.doubt(component) in (0.0, UNREAD)

    def list_computers(self, one: str, other: str) -> set[str]:
        """Name the planned computers on the way between two."""
        return {one, other, *(place for place, _network in self.verification.ways.list_links(one, other))}

    def doubt(self, component: Component) -> float | None:
        """Return the extra cost of a conclusion that no value shows; None if a value would have shown it."""
        if component.fault.read:
            computer = self.find_computer(component)
            is_read = component.fault.read == ALWAYS or (computer is not None and computer.seen.probe is not None)
            return None if is_read else UNREAD
        return (
            NOT_FOUND
            if (component.kind, component.mode) in RULED and self.verification.state.filters.lets_pass(component)
            else 0.0
        )

    def find_computer(self, component: Component) -> Participant | None:
        """The computer of the run that a component is on; None for a component between two."""
        return None if component.other else self.verification.run.get(component.place)

    def find_reason(self, component: Component) -> Component | None:
        """Find the component that was read, and from which another one of the same place follows."""
        kinds = FOLLOWS.get((component.kind, component.mode), ())
        read = [*self.places[component.places], *self.places[ANY,]]
        same = self._list_same_rule(component, read)
        first = max(same, key=lambda one: (one.mode in ALL_NODES, len(self.broken[one].proof), one), default=component)
        if first != component:
            return first
        return next((one for one in read if (one.kind, one.mode) in kinds and one not in same), None)

    def _list_same_rule(self, component: Component, read: Sequence[Component]) -> Sequence[Component]:
        """List the packet filters that one rule has shown: it drops several kinds of packets."""
        rules = self.verification.state.filters.rules
        return (
            [one for one in read if one in self.broken and rules.get(one) == rules[component]]
            if component in rules
            else []
        )

    def add_reasons(self, suspects: Components) -> Components:
        """Add the causes of some suspects to the suspects, and the causes of these: a cause that follows itself is no finding."""
        added, causes = suspects, suspects
        while causes := frozenset(reason for one in causes if (reason := self.find_reason(one))) - added:
            added |= causes
        return added

    def list_successes(self, rows: Sequence[Row]) -> tuple[str, ...]:
        """List the checks that succeed in the pairs of some rows, once for each pair."""
        pairs = list(dict.fromkeys((row.observer, row.target) for row in rows))[:ASKED]
        return tuple(check for pair in pairs for check in self.find_successes(*pair))

    def successes(self, component: Component) -> int:
        """Count successes that need a component, up to a few: first in the pairs that failed with it, then in others.

        At a place where packets end, others that got through say nothing.
        """
        if component in self.shown:
            return 0
        count, enough = 0, ENOUGH if component.fault.hard else MANY
        pairs = chain(self._suspect_pairs(component), self.sample_pairs(component))
        for observer, target in dict.fromkeys(way for one, other in pairs for way in ((one, other), (other, one))):
            count += self.count_needs(observer, target)[component]
            if count >= enough:
                break
        return count

    def count_needs(self, observer: str, target: str) -> Counter[Component]:
        """Count for each component the successes of a pair that need it."""
        if (observer, target) not in self.cleared:
            found = self.cleared[observer, target] = Counter()
            for components in self.find_successes(observer, target).values():
                found.update(components)
        return self.cleared[observer, target]

    def find_successes(self, observer: str, target: str) -> dict[str, Components]:
        """Find the checks that succeed in a pair, with the components that they need."""
        found = {}
        for check in self.verification.select_checks(observer, target):
            if (check.id, observer, target) not in self.bad:
                context = self.verification.make_context(check, observer, target)
                judged = check.look(context)
                if judged is not None and judged.verdict == OK:
                    found[check.id] = context.ways.seal(check.needs(context))
        return found

    def _suspect_pairs(self, component: Component) -> Iterable[tuple[str, str]]:
        """List pairs that failed, and may have because of a component."""
        return islice(((one.row.observer, one.row.target) for one in self.open if component in one.suspects), ASKED)

    def sample_pairs(self, component: Component) -> Iterable[tuple[str, str]]:
        """List other pairs that may need a component: those of the computers at its place, and those of their robot."""
        members = self.verification.fleet.members
        robots = {member.robot for member in members if member.name in component.places}
        near = sorted(
            (member.name for member in members if member.robot in robots), key=lambda name: name not in component.places
        )
        far = [member.name for member in members]
        step = max(1, len(near or far) * len(far) // ASKED)
        pairs = ((one, other) for one in near or far for other in far)
        return chain(zip(component.places, component.places, strict=True), islice(pairs, 0, None, step))
