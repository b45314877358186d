# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The state of a diagnosis: the rows that nothing explains yet, the findings so far, and what successes and values say of a part.

The rules of rules.py change it, in their order. It knows none of them.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain, islice

from ..._faults.fault import ALWAYS
from ..checks.engine import OK, Judgement, Row, Verification
from ..components.parts import ANY, FOLLOWS, RULED, Component
from ..context.check_context import Participant
from ..context.errors import find_parts
from ..context.needs import Parts
from ..trace.findings import SeenEnd, find_ends
from ..trace.probes import list_trips
from .finding import Finding

ALL_NODES = ("nodes", "nodes in", "nodes out")  # filters of any port, and so of the others, too
ASKED = 60  # pairs that are looked at for a success that clears a part
ENOUGH = 3  # successes that clear it, where it lets nothing pass
MANY = 20  # those that are counted of a part that lets some things pass: their share says how likely it is
UNREAD = 1.0  # what a part costs more that a value would show, if somebody had looked
NOT_FOUND = 2.0  # what a packet filter costs more where the rules were read and none of them drops it


class OpenRow:
    """A row that is not ok, as its check has judged it, and the parts that may be its reason."""

    def __init__(self, number: int, row: Row, verification: Verification) -> None:
        self.number, self.row = number, row
        check = verification.checks[row.check]
        context = verification.make_context(check, row.observer, row.target)
        judged = check.look(context) or Judgement(row.verdict)
        self.outcome = judged.outcome
        self.shown = context.ways.seal(judged.broken)  # by a value
        self.left = context.ways.seal(find_parts(context, judged.outcome, check.carries))  # by an error
        self._verification = verification
        self._suspects: Parts | None = None

    @property
    def suspects(self) -> Parts:
        """The parts that may be its reason: what an error leaves, or else all that the check names."""
        if self._suspects is None:
            self._suspects = self.left or self._verification.list_suspects(self.row)
        return self._suspects

    @suspects.setter
    def suspects(self, parts: Parts) -> None:
        self._suspects = parts


class Scene:
    """The state of a diagnosis."""

    def __init__(self, verification: Verification, rows: Sequence[Row]) -> None:
        self.verification = verification
        self.bad = {(row.check, row.observer, row.target) for row in rows}
        self.broken: dict[Component, Finding] = {}  # a finding for each part, at first
        self.winners: dict[Row, str] = {}  # row -> the rule that has explained it
        self.traced: dict[Row, str] = {}  # row on a way that was followed -> the rule that has followed it
        self.outcomes: dict[Row, str] = {}  # row -> the outcome of what its check has sent, where an error shows a part
        self.places: dict[tuple[str, ...], list[Component]] = defaultdict(list)  # what was read to be broken, by place
        self.cleared: dict[tuple[str, str], Counter[Component]] = {}
        self.by_chance: dict[int, Parts] = {}  # number of a row -> the losses that it may be by chance
        self.open = [OpenRow(number, row, verification) for number, row in enumerate(rows)]
        self.numbers = {row: number for number, row in enumerate(rows)}
        self.shown: dict[Component, list[SeenEnd]] = defaultdict(list)  # what packets have shown at the place of a part
        self.ends = [
            replace(end, sign=None) if self._is_disproved(end.sign) else end for end in find_ends(verification)
        ]

    def find(self, part: Component, rule: str) -> Finding:
        """Return the finding of a part; a new one is of this rule."""
        return self.broken.setdefault(part, Finding(part, rule=rule))

    def prove(self, parts: Parts, row: Row, rule: str) -> None:
        """Note that a row shows parts to be broken."""
        for part in parts:
            self.find(part, rule).proof.append(row)
        self.winners[row] = rule

    def explain(self, part: Component, rows: Iterable[Row], rule: str) -> None:
        """Note that the finding of a part explains rows."""
        for row in rows:
            self.find(part, rule).rows.append(row)
            self.winners[row] = rule

    def order_proofs(self) -> None:
        """Bring the findings and their rows into the order of the rows: each rule has looked at all of them."""
        for entry in self.broken.values():
            entry.proof.sort(key=self.numbers.__getitem__)
        first = {part: self.numbers[entry.proof[0]] for part, entry in self.broken.items()}
        self.broken = dict(sorted(self.broken.items(), key=lambda item: (first[item[0]], item[0])))

    def find_end(self, row: Row) -> SeenEnd | None:
        """Find the place where packets of the same kind were seen to end on the way of a row."""
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

    def is_cleared(self, part: Component) -> bool:
        return any(self.count_needs(place, place)[part] for place in part.places)

    def is_possible(self, part: Component) -> bool:
        """Return True if a part may be broken by what was read at its own place: a setting that is right, or a filter without a rule."""
        if part in self.broken:
            return True
        return not self.is_cleared(part) and self.doubt(part) in (0.0, UNREAD)

    def list_computers(self, one: str, other: str) -> set[str]:
        """Name the planned computers on the way between two."""
        return {one, other, *(place for place, _network in self.verification.ways.list_links(one, other))}

    def doubt(self, part: Component) -> float | None:
        """Say what it costs more to conclude a part that reading did not show; None where it would have shown it."""
        if part.fault.read:
            computer = self.find_computer(part)
            is_read = part.fault.read == ALWAYS or (computer is not None and computer.seen.probe is not None)
            return None if is_read else UNREAD
        return NOT_FOUND if (part.kind, part.mode) in RULED and self.verification.state.filters.lets_pass(part) else 0.0

    def find_computer(self, part: Component) -> Participant | None:
        """The computer of the run that a part is on; None for a part between two."""
        return None if part.other else self.verification.run.get(part.place)

    def find_reason(self, part: Component) -> Component | None:
        """Find the part that was read, and from which another one of the same place follows."""
        kinds = FOLLOWS.get((part.kind, part.mode), ())
        read = [*self.places[part.places], *self.places[ANY,]]
        same = self._list_same_rule(part, read)
        first = max(same, key=lambda one: (one.mode in ALL_NODES, len(self.broken[one].proof), one), default=part)
        if first != part:
            return first
        return next((one for one in read if (one.kind, one.mode) in kinds and one not in same), None)

    def _list_same_rule(self, part: Component, read: Sequence[Component]) -> Sequence[Component]:
        """List the packet filters that one rule has shown: it drops several kinds of packets."""
        rules = self.verification.state.filters.rules
        return [one for one in read if one in self.broken and rules.get(one) == rules[part]] if part in rules else []

    def add_reasons(self, suspects: Parts) -> Parts:
        """Add to the suspects what some of them follow from."""
        return suspects | {reason for part in suspects if (reason := self.find_reason(part))}

    def list_successes(self, rows: Sequence[Row]) -> tuple[str, ...]:
        """List the checks that succeed in the pairs of some rows, once for each pair."""
        pairs = list(dict.fromkeys((row.observer, row.target) for row in rows))[:ASKED]
        return tuple(check for pair in pairs for check in self.find_successes(*pair))

    def successes(self, part: Component) -> int:
        """Count successes that need a part, up to a few: first in the pairs that failed with it, then in others.

        Where packets were seen to end, others that got through say nothing.
        """
        if part in self.shown:
            return 0
        count, enough = 0, ENOUGH if part.fault.hard else MANY
        pairs = chain(self._suspect_pairs(part), self.sample_pairs(part))
        for observer, target in dict.fromkeys(way for one, other in pairs for way in ((one, other), (other, one))):
            count += self.count_needs(observer, target)[part]
            if count >= enough:
                break
        return count

    def count_needs(self, observer: str, target: str) -> Counter[Component]:
        """Count for each part the successes of a pair that need it."""
        if (observer, target) not in self.cleared:
            found = self.cleared[observer, target] = Counter()
            for parts in self.find_successes(observer, target).values():
                found.update(parts)
        return self.cleared[observer, target]

    def find_successes(self, observer: str, target: str) -> dict[str, Parts]:
        """Find the checks that succeed in a pair, with the parts that they need."""
        found = {}
        for check in self.verification.select_checks(observer, target):
            if (check.id, observer, target) not in self.bad:
                context = self.verification.make_context(check, observer, target)
                judged = check.look(context)
                if judged is not None and judged.verdict == OK:
                    found[check.id] = context.ways.seal(check.needs(context))
        return found

    def _suspect_pairs(self, part: Component) -> Iterable[tuple[str, str]]:
        """List pairs that failed, and may have because of a part."""
        return islice(((one.row.observer, one.row.target) for one in self.open if part in one.suspects), ASKED)

    def sample_pairs(self, part: Component) -> Iterable[tuple[str, str]]:
        """List other pairs that may need a part: those of the computers at its place, and those of their robot."""
        members = self.verification.fleet.members
        robots = {member.robot for member in members if member.name in part.places}
        near = sorted(
            (member.name for member in members if member.robot in robots), key=lambda name: name not in part.places
        )
        far = [member.name for member in members]
        step = max(1, len(near or far) * len(far) // ASKED)
        pairs = ((one, other) for one in near or far for other in far)
        return chain(zip(part.places, part.places, strict=True), islice(pairs, 0, None, step))
