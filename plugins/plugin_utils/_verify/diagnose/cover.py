# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The smallest explanation: few parts that explain all failures, and that no success contradicts.

Pure, and without any knowledge of checks: failures with their suspects in, the chosen parts out. A greedy weighted cover
with a lazy heap, as in network tomography (SCORE, NSDI 2005).
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import NamedTuple

from ..components.parts import Component

GAIN = 4.0  # of a failure that a part explains, in the measure of Fault.cost
KNOWN = 2.0  # what a part gains that was read to be broken
MOST = 5  # of these, with the part itself: a longer list does not help
MARGIN = 1.0  # parts that are as good as the best one, but for this: it is one of these


class Failure(NamedTuple):
    """An observation that is not as expected, with the parts that may be the reason, and what it counts."""

    suspects: Set[Component]
    weight: float = 1.0


@dataclass
class Explanation:
    """A part that explains failures, by their numbers; `rivals` explain the same, and nothing tells them apart."""

    part: Component
    failures: list[int] = field(default_factory=list)
    rivals: tuple[Component, ...] = ()


def explain(
    failures: Sequence[Failure],
    known: Set[Component],
    passed: Callable[[Component], int],
    doubt: Callable[[Component], float | None] = lambda part: None if part.fault.read else 0.0,
) -> tuple[list[Explanation], list[int]]:
    """Choose parts until nothing is left that any part explains; return them, and the numbers of the rest.

    `known` are broken for sure. `passed` counts the successes that need a part; it is asked only about the best ones.
    `doubt` says what a part costs more since it was not read; None where it is not concluded at all.
    """
    cover = _Cover(failures, known, passed, doubt)
    chosen = []
    while (best := cover.best()) is not None:
        chosen.append(Explanation(best, cover.take(best)))
    kept = _drop_redundant(chosen, cover.covers, known)
    for entry in kept:
        _weigh_again(entry, kept, cover)
    return kept, sorted(cover.open)


class _Cover:
    def __init__(
        self,
        failures: Sequence[Failure],
        known: Set[Component],
        passed: Callable[[Component], int],
        doubt: Callable[[Component], float | None],
    ) -> None:
        self.failures, self.known, self.passed = failures, known, passed
        self.open = set(range(len(failures)))
        self.covers: dict[Component, list[int]] = defaultdict(list)
        self.doubts: dict[Component, float | None] = {}
        for number, failure in enumerate(failures):
            for part in failure.suspects:
                if part not in self.doubts:
                    self.doubts[part] = 0.0 if part in known else doubt(part)
                if self.doubts[part] is not None:
                    self.covers[part].append(number)
        self.counted: dict[Component, int] = {}
        # (smaller is better, the part); a score is never better than when it was put here
        self.heap = [(self._cost(part) - GAIN * self._weight(part), part) for part in self.covers]
        heapq.heapify(self.heap)

    def best(self) -> Component | None:
        """Return the part with the best score, if it is worth its cost."""
        while self.heap:
            _hoped, part = heapq.heappop(self.heap)
            score = self.score(part)
            if score <= 0:
                continue
            if not self.heap or score >= -self.heap[0][0]:
                return part
            heapq.heappush(self.heap, (-score, part))
        return None

    def take(self, part: Component) -> list[int]:
        """Note that a part explains what it can; return the numbers of what nothing has explained before."""
        taken = [number for number in self.covers[part] if number in self.open]
        self.open.difference_update(taken)
        return taken

    def score(self, part: Component, numbers: Set[int] | None = None) -> float:
        """Weigh a part by what it explains of what is open, or of some numbers.

        Successes that need it clear a part that lets nothing pass. A different part is worth its share of failures.
        """
        if part not in self.counted:
            self.counted[part] = self.passed(part)
        successes, hits = self.counted[part], len(self.covers[part])
        if successes and part.fault.hard:
            return -self._cost(part)
        return GAIN * self._weight(part, numbers) * hits / (hits + successes) - self._cost(part)

    def _weight(self, part: Component, numbers: Set[int] | None = None) -> float:
        wanted = self.open if numbers is None else numbers
        return sum(self.failures[number].weight for number in self.covers[part] if number in wanted)

    def _cost(self, part: Component) -> float:
        if part in self.known:
            return -KNOWN
        return part.fault.cost + (self.doubts.get(part) or 0.0)

    def equals(self, best: Component, numbers: Set[int]) -> list[Component]:
        """List the parts that explain the same failures nearly as well as the best one, and better ones before."""
        shared = frozenset.intersection(*(frozenset(self.failures[number].suspects) for number in numbers))
        scores = {part: self.score(part, numbers) for part in shared & self.covers.keys()}
        limit = max(scores.values()) - MARGIN
        found: list[Component] = []
        for part in sorted(
            (part for part in scores if scores[part] >= limit), key=lambda part: (-scores[part], part != best, part)
        ):
            if not any(_is_alike(part, other) for other in found):
                found.append(part)
        return found[:MOST]


def _is_alike(one: Component, other: Component) -> bool:
    """Return True if two parts are one for a person: the same kind at the same place, broken in the same way or in one direction."""
    return (one.kind, one.places) == (other.kind, other.places) and one.mode.partition(" ")[0] == other.mode.partition(
        " "
    )[0]


def _weigh_again(entry: Explanation, kept: Sequence[Explanation], cover: _Cover) -> None:
    """Weigh a part by what no other chosen one explains: another one may explain that better, or as well.

    What was read needs no rival.
    """
    if entry.part in cover.known or not entry.failures:
        return
    others = {number for other in kept if other is not entry for number in cover.covers[other.part]}
    alone = {number for number in cover.covers[entry.part] if number not in others}
    best, *rivals = cover.equals(entry.part, alone or set(entry.failures))
    if cover.score(best, alone) > cover.score(entry.part, alone):
        entry.part = best
    entry.rivals = tuple(part for part in (best, *rivals) if not _is_alike(part, entry.part))


def _drop_redundant(
    chosen: list[Explanation], covers: Mapping[Component, Sequence[int]], known: Set[Component]
) -> list[Explanation]:
    """Drop a part that was only concluded where the others explain all that it explains."""
    kept = list(chosen)
    for entry in reversed(chosen):
        others = [other for other in kept if other is not entry]
        elsewhere = {number for other in others for number in covers[other.part]}
        if entry.part not in known and elsewhere.issuperset(entry.failures):
            kept = others
            for number in entry.failures:
                next(other for other in kept if number in covers[other.part]).failures.append(number)
    return kept
