# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The diagnosis: the smallest set of parts that explains what failed, and that no success contradicts.

Pure: the plan and the observations in, findings out. What a value shows to be broken is a finding. What else failed is
explained by the parts that it needs (cover.py); a success of the same kind clears them.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, islice

from ..._base.sentences import shorten_list
from ..._faults.fault import ALWAYS, CONTROLLER, INVENTORY, Advices
from ..checks.engine import FAILED, OK, UNKNOWN, WARNING, Judgement, Row, Verification
from ..components.parts import ANY, FOLLOWS, HEARSAY, RULED, Component
from ..context import needs
from ..context.check_context import LATELY, Participant
from ..context.errors import find_parts
from ..context.needs import Parts
from ..trace.findings import SeenEnd, find_ends
from ..trace.probes import find_trip, list_trips
from .commands import make_commands
from .cover import Failure, explain
from .effects import Effects
from .offsets import offset
from .onset import describe_onset

SEEN, LOCATED, INFERRED = "seen", "located", "inferred"
WEIGHTS = {FAILED: 1.0, WARNING: 0.9, UNKNOWN: 0.5}
SERIOUS = (FAILED, WARNING, UNKNOWN)
ALL_NODES = ("nodes", "nodes in", "nodes out")  # filters of any port, and so of the others, too
NODES = ("roscore", "discovery", "sync", "registration")  # what others see of these needs the network
CHANCE = 0.3  # what a failure counts where packets are known to get lost
ASKED = 60  # pairs that are looked at for a success that clears a part
MOST = 20_000  # rows that are explained
ENOUGH = 3  # successes that clear it, where it lets nothing pass
MANY = 20  # those that are counted of a part that lets some things pass: their share says how likely it is
UNREAD = 1.0  # what a part costs more that a value would show, if somebody had looked
LOSSES = ("loss", "power_save")  # modes of parts that lose some packets
NOT_FOUND = 2.0  # what a packet filter costs more where the rules were read and none of them drops it
NAMED = 4  # names, networks and the like that a finding names


@dataclass
class Finding:
    """A finding: a part that is broken, the observations that show it, and those that follow from it."""

    part: Component
    verdict: str = FAILED
    rivals: tuple[Component, ...] = ()  # that explain the same: it is one of these
    proof: list[Row] = field(default_factory=list)  # rows with a value that shows it
    rows: list[Row] = field(default_factory=list)  # rows that it explains
    also: tuple[Component, ...] = ()  # the same at the same place: other names, other networks

    passed: tuple[str, ...] = ()  # the checks that succeed in the same pairs, once for each
    followed: tuple[SeenEnd, ...] = ()  # where packets were seen to end
    since: str = ""  # empty where it is not known
    commands: Advices = ()  # that mend it, where what was read gives some
    inventory: str = ""  # of the run, for commands; empty where it is not known

    @property
    def sure(self) -> str:
        """How sure it is: a value showed it, packets were seen to end there, or it is what explains most."""
        return SEEN if self.proof else LOCATED if self.followed else INFERRED

    @property
    def candidates(self) -> tuple[Component, ...]:
        """It is one of these."""
        return (self.part, *self.rivals)

    @property
    def subjects(self) -> str:
        """Name what of the part is concerned: the first names or networks, and how many more. Of packets that end, the first."""
        if self.part.kind == "way":
            return self.part.what  # the report has all of `followed`
        return shorten_list(dict.fromkeys(part.what for part in (self.part, *self.also) if part.what), NAMED)

    def sentence(self) -> str:
        """Say what is wrong."""
        return self.part._replace(what=self.subjects).sentence()

    @property
    def do(self) -> Advices:
        """Say what to do: what was read gives the commands, and the row what lasts. Nothing where it is only inferred."""
        if self.sure == INFERRED:
            return ()
        own = self.part.do(self.inventory)
        if not self.commands:
            return own
        if (
            self.part.kind == "node"
        ):  # they name what has started the node, of which the row can only say what it may be
            return self.commands
        return (*self.commands, *(one for one in own if one.where in (CONTROLLER, INVENTORY)))

    @property
    def look(self) -> Advices:
        """Say what to look at if that does not help, or to tell the candidates apart."""
        ways = (one for end in self.followed[:1] for one in end.look) if self.part.kind == "way" else ()
        return tuple(dict.fromkeys((*ways, *(one for part in self.candidates for one in part.look(self.inventory)))))


@dataclass(frozen=True)
class Diagnosis:
    """The findings, the most important first, and the rows that none of them explains."""

    findings: tuple[Finding, ...] = ()
    unexplained: tuple[Row, ...] = ()
    looked_at: int = 0  # rows of them that were explained or tried
    total: int = 0  # all rows that are not ok


def explain_rows(verification: Verification, rows: Sequence[Row]) -> Diagnosis:
    """Explain the rows that are not ok; of very many, some out of all of them, since they say the same again and again."""
    if not rows:
        return Diagnosis()
    some = rows if len(rows) <= MOST else _sample(rows)
    return replace(_Diagnosis(verification, some).result(), looked_at=len(some), total=len(rows))


def list_unshown(verification: Verification) -> list[Sequence[Row]]:
    """List what failed and no value shows: the rows of each finding without a proof, and those that nothing explains."""
    diagnosis = explain_rows(verification, [row for row in verification.rows(Counter()) if row.verdict != OK])
    unshown = [
        entry for entry in diagnosis.findings if not entry.proof or (entry.part.kind, entry.part.mode) in HEARSAY
    ]
    return [*((*entry.proof, *entry.rows) for entry in unshown), diagnosis.unexplained]


def _sample(rows: Sequence[Row]) -> list[Row]:
    """Take every so many of the rows, and all that are of one computer."""
    step = -(-len(rows) // MOST)
    return [row for number, row in enumerate(rows) if number % step == 0 or row.observer == row.target]


class _Diagnosis:
    def __init__(self, verification: Verification, rows: Sequence[Row]) -> None:
        self.verification = verification
        self.bad = {(row.check, row.observer, row.target) for row in rows}
        self.broken: dict[Component, Finding] = {}  # a finding for each part, at first
        self.places: dict[tuple[str, ...], list[Component]] = defaultdict(list)  # what was read to be broken, by place
        self.cleared: dict[tuple[str, str], Counter[Component]] = {}
        self.open: list[tuple[Row, Parts]] = []
        self.ends = [
            replace(end, sign=None) if self._is_disproved(end.sign) else end for end in find_ends(verification)
        ]
        self.shown: dict[Component, list[SeenEnd]] = defaultdict(list)  # what packets have shown at the place of a part
        for row in rows:
            self._read(row)

    def _read(self, row: Row) -> None:
        """Note what a row shows to be broken, or whom it lets suspect."""
        check = self.verification.checks[row.check]
        context = self.verification.make_context(check, row.observer, row.target)
        judged = check.look(context) or Judgement(row.verdict)
        told = context.ways.seal(find_parts(context, judged.outcome, check.carries))
        shown = told if len(told) == 1 else frozenset()
        if evidence := self._find_drop(row) or self._read_end(row) or context.ways.seal(judged.broken) or shown:
            for part in sorted(evidence):  # a set of texts has another order in each run
                self._finding(part).proof.append(row)
        else:
            self.open.append((row, told or self.verification.list_suspects(row)))

    def _read_end(self, row: Row) -> Parts:
        """Return the part that followed packets have shown on the way of a row."""
        end = self._find_end(row)
        if end is None or end.sign is None:
            return frozenset()
        self.shown[end.sign].append(end)
        return frozenset({end.sign})

    def _find_end(self, row: Row) -> SeenEnd | None:
        """Find the place where packets of the same kind were seen to end on the way of a row."""
        for trip in list_trips(self.verification, row) if self.ends else ():
            own = [end for end in self.ends if end.trip == trip]
            computers = self._list_computers(trip.sender, trip.target)
            same = [end for end in self.ends if end.trip.traffic == trip.traffic and end.crosses(computers)]
            if own or same:
                return (own or same)[0]
        return None

    def _finding(self, part: Component) -> Finding:
        return self.broken.setdefault(part, Finding(part))

    def _find_drop(self, row: Row) -> Parts:
        """Find the packet filter with a rule that drops what a check has sent in vain."""
        trip = find_trip(self.verification, row) if self.verification.checks[row.check].carries else None
        part = trip and self.verification.state.filters.find_drop(trip.sender, trip.target, trip.traffic)
        return frozenset() if part is None else frozenset({part})

    def result(self) -> Diagnosis:
        """Explain what no value explains."""
        self._drop_consequences()
        self._use_effects()
        self._use_ends()
        lost = self._explain_loss()
        by_chance = [lost & self._loss_suspects(row) if lost else frozenset() for row, _suspects in self.open]
        failures = [
            Failure(self._add_reasons(suspects), WEIGHTS[row.verdict] * (CHANCE if maybe - suspects else 1.0))
            for (row, suspects), maybe in zip(self.open, by_chance, strict=True)
        ]
        rest = self._choose_parts(failures)
        for number in rest:
            if by_chance[number]:
                self._finding(min(by_chance[number])).rows.append(self.open[number][0])
        for part, entry in self.broken.items():
            places = {end.place.step: end for end in self.shown.get(part, ())}
            entry.followed = tuple(places.values())[:NAMED]
        unexplained = tuple(self.open[number][0] for number in rest if not by_chance[number])
        findings = sorted(_merge_parts(self.broken.values()), key=self._weigh)
        return Diagnosis(tuple(map(self._add_details, findings)), unexplained)

    def _choose_parts(self, failures: Sequence[Failure]) -> Sequence[int]:
        """Choose the parts that explain the failures; return the numbers of the rest."""
        # what was read may have a text that says more; a row suspects the part without it
        told = {part._replace(what=""): part for part in self.broken}
        ends = {end.part for end in self.ends}
        chosen, rest = explain(failures, {*self.broken, *told, *ends}, self.successes, self._doubt)
        for entry in chosen:
            broken = self._finding(entry.part if entry.part in self.broken else told.get(entry.part, entry.part))
            broken.rows += [self.open[number][0] for number in entry.failures]
            broken.rivals = broken.rivals or entry.rivals
            broken.passed = self._list_successes(broken.rows)
        return rest

    def _use_effects(self) -> None:
        """Give what known faults explain to their findings: what was sent ends in the world as it was read, too."""
        effects, rest = Effects(self.verification, self.broken), []
        merged: dict[Component, Component] = {}  # part -> the part that it follows from
        for part in [part for part in self.broken if part.kind in NODES or part in self.shown]:
            proof = self.broken[part].proof
            causes = {effects.find_cause(row, self.verification.list_suspects(row)) for row in proof}
            if not causes & {None, part} and causes <= self.broken.keys():
                merged[part], entry = min(filter(None, causes)), self.broken.pop(part)
                self.broken[merged[part]].rows += entry.proof + entry.rows
        for row, suspects in self.open:
            cause = effects.find_cause(row, suspects)
            if cause is None:
                rest.append((row, suspects))
                continue
            while cause in merged:
                cause = merged[cause]
            self.broken[cause].rows.append(row)
        self.open = rest

    def _use_ends(self) -> None:
        """Let what failed on a way that was followed suspect only what the packets left there."""
        if not self.ends:
            return
        self.open = [(row, self._choose_at_end(row, suspects)) for row, suspects in self.open]
        places = [end for end in self.ends if end.part in self.shown]
        self.open = [
            (
                row,
                suspects | {end.part for end in places if end.crosses(self._list_computers(row.observer, row.target))},
            )
            for row, suspects in self.open
        ]

    def _choose_at_end(self, row: Row, suspects: Parts) -> Parts:
        end = self._find_end(row)
        if end is None:
            return suspects
        chosen = end.choose(filter(self._is_possible, suspects))
        both = (row.observer, row.target), (row.target, row.observer)
        # What got through between the two clears what lets nothing through, where another part is left.
        chosen = (
            frozenset(part for part in chosen if not any(self._count_needs(*pair)[part] for pair in both)) or chosen
        )
        for part in chosen:
            self.shown[part].append(end)
        return chosen

    def _is_disproved(self, sign: Component | None) -> bool:
        """Return True if a setting that was read right is blamed by a counter of the whole machine, which spoofed packets count up, too."""
        return sign is not None and sign.kind == "reverse_path" and self._is_cleared(sign)

    def _is_cleared(self, part: Component) -> bool:
        return any(self._count_needs(place, place)[part] for place in part.places)

    def _is_possible(self, part: Component) -> bool:
        """Return True if a part may be broken by what was read at its own place: a setting that is right, or a filter without a rule."""
        if part in self.broken:
            return True
        return not self._is_cleared(part) and self._doubt(part) in (0.0, UNREAD)

    def _list_computers(self, one: str, other: str) -> set[str]:
        """Name the planned computers on the way between two."""
        return {one, other, *(place for place, _network in self.verification.ways.list_links(one, other))}

    def _weigh(self, entry: Finding) -> tuple[int, float, bool, int, Component]:
        """Order findings: the serious ones first; of these what is so now; of these what a value shows; of these what most follows from."""
        return (
            SERIOUS.index(entry.verdict),
            self._count_seconds(entry),
            not entry.proof,
            -len(entry.rows) - len(entry.proof),
            entry.part,
        )

    def _count_seconds(self, entry: Finding) -> float:
        """Count the seconds since the last start of a unit that ended and runs again; 0 for what is so now."""
        computer = self._computer(entry.part)
        if computer is None or entry.verdict != WARNING or entry.part.mode != "restarting":
            return 0.0
        units = {part.what for part in (entry.part, *entry.also)}
        return min(
            (LATELY if one.age_s is None else one.age_s for one in computer.probe.services if one.unit in units),
            default=LATELY,
        )

    def _add_details(self, entry: Finding) -> Finding:
        """Add what the machine at its place tells: since when, by how much, and what mends it."""
        computer = self._computer(entry.part)
        return replace(
            _add_clock_offset(entry),
            since=describe_onset(entry.part, computer, self.verification.state),
            commands=make_commands((entry.part, *entry.also), computer, self.verification.state),
            inventory=self.verification.inventory,
        )

    def _explain_loss(self) -> Parts:
        """Explain the measured loss first. Where packets are known to get lost, something else may fail by chance.

        So it counts less there, and what nothing else explains is the loss.
        """
        measured = [entry for entry in self.open if entry[1] and all(part.mode in LOSSES for part in entry[1])]
        if not measured:
            return frozenset()
        chosen, _rest = explain([Failure(suspects) for _row, suspects in measured], set(self.broken), self.successes)
        for entry in chosen:
            self._finding(entry.part).rivals = entry.rivals
        return frozenset(entry.part for entry in chosen)

    def _loss_suspects(self, row: Row) -> Parts:
        context = self.verification.make_context(self.verification.checks[row.check], row.observer, row.target)
        return needs.loss_parts(context, row.observer, row.target) | needs.loss_parts(context, *context.masters)

    def _doubt(self, part: Component) -> float | None:
        """Say what it costs more to conclude a part that reading did not show; None where it would have shown it."""
        if part.fault.read:
            computer = self._computer(part)
            is_read = part.fault.read == ALWAYS or (computer is not None and computer.seen.probe is not None)
            return None if is_read else UNREAD
        return NOT_FOUND if (part.kind, part.mode) in RULED and self.verification.state.filters.lets_pass(part) else 0.0

    def _computer(self, part: Component) -> Participant | None:
        """The computer of the run that a part is on; None for a part between two."""
        return None if part.other else self.verification.run.get(part.place)

    def _drop_consequences(self) -> None:
        """Leave out what is broken only because another part of the same place is."""
        for part in self.broken:
            self.places[part.places].append(part)
        reasons = {part: reason for part in self.broken if (reason := self._find_reason(part))}
        for part, reason in reasons.items():
            while reason in reasons:  # which follows from another one
                reason = reasons[reason]
            self.broken[reason].rows += self.broken.pop(part).proof

    def _find_reason(self, part: Component) -> Component | None:
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

    def _add_reasons(self, suspects: Parts) -> Parts:
        """Add to the suspects what some of them follow from."""
        return suspects | {reason for part in suspects if (reason := self._find_reason(part))}

    def _list_successes(self, rows: Sequence[Row]) -> tuple[str, ...]:
        """List the checks that succeed in the pairs of some rows, once for each pair."""
        pairs = list(dict.fromkeys((row.observer, row.target) for row in rows))[:ASKED]
        return tuple(check for pair in pairs for check in self._find_successes(*pair))

    def successes(self, part: Component) -> int:
        """Count successes that need a part, up to a few: first in the pairs that failed with it, then in others.

        Where packets were seen to end, others that got through say nothing.
        """
        if part in self.shown:
            return 0
        count, enough = 0, ENOUGH if part.fault.hard else MANY
        pairs = chain(self._suspect_pairs(part), self._sample_pairs(part))
        for observer, target in dict.fromkeys(way for one, other in pairs for way in ((one, other), (other, one))):
            count += self._count_needs(observer, target)[part]
            if count >= enough:
                break
        return count

    def _count_needs(self, observer: str, target: str) -> Counter[Component]:
        """Count for each part the successes of a pair that need it."""
        if (observer, target) not in self.cleared:
            found = self.cleared[observer, target] = Counter()
            for parts in self._find_successes(observer, target).values():
                found.update(parts)
        return self.cleared[observer, target]

    def _find_successes(self, observer: str, target: str) -> dict[str, Parts]:
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
        return islice(((row.observer, row.target) for row, suspects in self.open if part in suspects), ASKED)

    def _sample_pairs(self, part: Component) -> Iterable[tuple[str, str]]:
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


def _merge_parts(broken: Iterable[Finding]) -> Iterable[Finding]:
    """Make one finding of the parts that are one for a person."""
    groups: dict[Component, list[Finding]] = defaultdict(list)
    for entry in broken:
        groups[entry.part._replace(what="")].append(entry)
    return map(_merge, groups.values())


def _add_clock_offset(entry: Finding) -> Finding:
    """Say of clocks by how much they are off."""
    parts = [
        part._replace(what=offset(part, (*entry.proof, *entry.rows)) or part.what) if part.kind == "clock" else part
        for part in entry.candidates
    ]
    return replace(entry, part=parts[0], rivals=tuple(parts[1:]))


def _merge(group: Sequence[Finding]) -> Finding:
    first = min(group, key=lambda entry: (-len(entry.proof) - len(entry.rows), entry.part))
    proof, rows = [row for entry in group for row in entry.proof], [row for entry in group for row in entry.rows]
    verdicts = {row.verdict for row in (*proof, *rows)}
    worst = next((verdict for verdict in SERIOUS if verdict in verdicts), UNKNOWN)
    also = tuple(sorted(entry.part for entry in group if entry is not first))
    followed = tuple(end for entry in group for end in entry.followed)[:NAMED]
    return replace(first, verdict=worst, proof=proof, rows=rows, also=also, followed=followed)
