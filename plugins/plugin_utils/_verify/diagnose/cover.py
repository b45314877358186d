# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The smallest explanation: few components that explain all failures, and that no success contradicts.

Pure, and without any knowledge of checks: failures with their suspects in, the chosen components out. A greedy weighted cover
with a lazy heap, as in network tomography (SCORE, NSDI 2005).
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import NamedTuple

from ..components.component import Component

GAIN = 4.0  # of a failure that a component explains, in the measure of Fault.cost
KNOWN = 2.0  # the bonus of a component that was read to be broken
MOST = 5  # of these, with the component itself: a longer list does not help
MARGIN = 1.0  # components that are as good as the best one, but for this: it is one of these


class Failure(NamedTuple):
    """An observation that is not as expected, with the components that may be the reason, and its weight."""

    suspects: Set[Component]
    weight: float = 1.0


@dataclass
class Explanation:
    """A component that explains failures, by their numbers; `rivals` explain the same, and nothing distinguishes them."""

    component: Component
    failures: list[int] = field(default_factory=list)
    rivals: tuple[Component, ...] = ()


def explain(
    failures: Sequence[Failure],
    known: Set[Component],
    passed: Callable[[Component], int],
    doubt: Callable[[Component], float | None] = lambda component: None if component.fault.read else 0.0,
) -> tuple[list[Explanation], list[int]]:
    """Choose components until nothing is left that any component explains; return them, and the numbers of the rest.

    `known` are broken for sure. `passed` counts the successes that need a component; it is asked only about the best ones.
    `doubt` gives the extra cost of a component that was not read; None if it is not concluded at all.
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
            for component in failure.suspects:
                if component not in self.doubts:
                    self.doubts[component] = 0.0 if component in known else doubt(component)
                if self.doubts[component] is not None:
                    self.covers[component].append(number)
        self.counted: dict[Component, int] = {}
        # (smaller is better, the component); a score is never better than when it was put here
        self.heap = [(self._cost(component) - GAIN * self._weight(component), component) for component in self.covers]
        heapq.heapify(self.heap)

    def best(self) -> Component | None:
        """Return the component with the best score, if it is worth its cost."""
        while self.heap:
            _hoped, component = heapq.heappop(self.heap)
            score = self.score(component)
            if score <= 0:
                continue
            if not self.heap or score >= -self.heap[0][0]:
                return component
            heapq.heappush(self.heap, (-score, component))
        return None

    def take(self, component: Component) -> list[int]:
        """Note the failures that a component explains; return the numbers of those that nothing has explained before."""
        taken = [number for number in self.covers[component] if number in self.open]
        self.open.difference_update(taken)
        return taken

    def score(self, component: Component, numbers: Set[int] | None = None) -> float:
        """Weigh a component by the open failures that it explains, or by some numbers.

        Successes that need it clear a `hard` component, which lets nothing pass. Any other one is worth its share: failures of all results.
        """
        if component not in self.counted:
            self.counted[component] = self.passed(component)
        successes, hits = self.counted[component], len(self.covers[component])
        if successes and component.fault.hard:
            return -self._cost(component)
        return GAIN * self._weight(component, numbers) * hits / (hits + successes) - self._cost(component)

    def _weight(self, component: Component, numbers: Set[int] | None = None) -> float:
        wanted = self.open if numbers is None else numbers
        return sum(self.failures[number].weight for number in self.covers[component] if number in wanted)

    def _cost(self, component: Component) -> float:
        if component in self.known:
            return -KNOWN
        return component.fault.cost + (self.doubts.get(component) or 0.0)

    def equals(self, best: Component, numbers: Set[int]) -> list[Component]:
        """List the components that explain all of these failures nearly as well as the one with the best score, which is the first.

        With equal scores, `best` is the first. Of components that are one for a person, only the first is listed.
        """
        shared = frozenset.intersection(*(frozenset(self.failures[number].suspects) for number in numbers))
        scores = {component: self.score(component, numbers) for component in shared & self.covers.keys()}
        limit = max(scores.values()) - MARGIN
        found: list[Component] = []
        for component in sorted(
            (component for component in scores if scores[component] >= limit),
            key=lambda component: (-scores[component], component != best, component),
        ):
            if not any(_is_alike(component, other) for other in found):
                found.append(component)
        return found[:MOST]


def _is_alike(one: Component, other: Component) -> bool:
    """Return True if two components are one for a person: the same kind at the same place, broken in the same way or in one direction."""
    return (one.kind, one.places) == (other.kind, other.places) and one.mode.partition(" ")[0] == other.mode.partition(
        " "
    )[0]


def _weigh_again(entry: Explanation, kept: Sequence[Explanation], cover: _Cover) -> None:
    """Weigh a component by the failures that no other chosen one explains: another one may explain that better, or as well.

    A component that was read needs no rival.
    """
    if entry.component in cover.known or not entry.failures:
        return
    others = {number for other in kept if other is not entry for number in cover.covers[other.component]}
    single = {number for number in cover.covers[entry.component] if number not in others}
    best, *rivals = cover.equals(entry.component, single or set(entry.failures))
    if cover.score(best, single) > cover.score(entry.component, single):
        entry.component = best
    entry.rivals = tuple(component for component in (best, *rivals) if not _is_alike(component, entry.component))


def _drop_redundant(
    chosen: list[Explanation], covers: Mapping[Component, Sequence[int]], known: Set[Component]
) -> list[Explanation]:
    """Drop a component that was only concluded if the others explain all that it explains."""
    kept = list(chosen)
    for entry in reversed(chosen):
        others = [other for other in kept if other is not entry]
        elsewhere = {number for other in others for number in covers[other.component]}
        if entry.component not in known and elsewhere.issuperset(entry.failures):
            kept = others
            for number in entry.failures:
                next(other for other in kept if number in covers[other.component]).failures.append(number)
    return kept
