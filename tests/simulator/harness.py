# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Trials of the diagnosis: a random fleet, faults, noise, and what is named.

A trial is made anew from its number. Noise are lost packets, now and then `--limit`, and a computer without a login.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field, replace
from random import Random

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import OK, Verification
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.diagnosis import explain_rows

from tests.simulator import faults, inventories
from tests.simulator.observe import observe
from tests.simulator.state import healthy

LIMITED, SHUT = 0.1, 0.1  # the shares of trials with `--limit`, and with a computer without a login
# EQUAL: "one of these", and another one of them leaves the very same observations, so nothing can tell them apart.
FIRST, EQUAL, RIVAL, MISSED = "first", "equal", "one of these", "missed"
AIMS = 8  # ways of injecting a fault at one place that are tried


@dataclass(frozen=True)
class Trial:
    """A run of the verification on a fleet with these faults."""

    number: int
    state: object
    run: tuple
    faults: tuple  # (Fault, place)
    observations: object
    noise: tuple = ()  # computers that nobody could look at
    bases: tuple = ()  # for each fault the state with the others alone


@dataclass
class Score:
    """The parts that were named for one kind of fault."""

    verdicts: Counter = field(default_factory=Counter)
    findings: Counter = field(default_factory=Counter)  # their number -> trials
    misses: list = field(default_factory=list)  # (number of the trial, place, what was named)


def draw(number, rows):
    """A trial with one fault of each of these lists of rows; it is drawn again until each of them can be seen."""
    random = Random(f"{number} {[row.name for of in rows for row in of][:3]} {len(rows)}")
    while True:
        fleet = inventories.plan(random)
        before = healthy(random, fleet)
        run, shut = _run(random, fleet, bool(rows)), ()
        if rows and random.random() < SHUT:
            shut = (random.choice(list(run)),)
            before = replace(before, shut=frozenset(shut))
        trial = _injected(random, number, before, run, rows)
        if trial is not None:
            return replace(trial, noise=shut)


def _run(random, fleet, faulty):
    """The computers of the run: all, or those of some robots."""
    names = list(fleet.computers)
    if random.random() >= LIMITED:
        return tuple(names)
    robots = sorted({plan.robot for plan in fleet.computers.values() if plan.robot})
    chosen = set(random.sample(robots, random.randint(1, len(robots))))
    return tuple(name for name in names if fleet.computers[name].robot in chosen)


def _injected(random, number, state, run, rows):
    """The trial with these faults, or None where one of them cannot be injected, or cannot be seen beside the other."""
    healthy_state, found, bases = state, [], (state,)
    seen = _measured(state, run, number)
    for of in rows:
        row = random.choice(of)
        chance = random.getstate()
        made = row.inject(state, random)
        if made is None or any(place == made[1] for _row, place in found):
            return None
        before, (state, place) = state, made
        now = _measured(state, run, number)
        if now == seen:
            return None
        if found:
            random.setstate(chance)
            alone = row.inject(healthy_state, random)
            if alone is None or alone[1] != place or now == _measured(alone[0], run, number):
                return None  # it hides the one before
            bases = (alone[0], before)
        seen = now
        found.append((row, place))
    return Trial(number, state, run, tuple(found), observe(state, run, number), bases=bases)


def _measured(state, run, number):
    """The observations without the rules that were read: a rule that drops nothing is no fault."""
    return {name: replace(seen, filters=None) for name, seen in observe(state, run, number).items()}


def diagnose(fleet, observations):
    """The diagnosis of the observations of a fleet."""
    verification = Verification(CHECKS, fleet, observations)
    return explain_rows(verification, [row for row in verification.rows() if row.verdict != OK])


def named(trial):
    """The findings in their order, each as the parts that it names: the first one, and its rivals."""
    diagnosis = diagnose(trial.state.fleet, trial.observations)
    found = [(finding.component, *finding.rivals) for finding in diagnosis.findings]
    return [components for components in found if not _is_noise(trial, components)]


def _is_noise(trial, components):
    """Return True if a finding tells only that nobody could log in where nobody could."""
    right = any(is_right(component, row, place) for component in components for row, place in trial.faults)
    return components[0].kind == "computer" and components[0].place in trial.noise and not right


def is_right(component, row, place):
    """Return True if a named part is the one of the row at the place."""
    return (component.kind, component.mode) in row.components and is_at(component.places, place)


def is_at(places, place):
    """Return True if a place is named: a link by its name, or each of two robots."""
    return place == faults.ANYWHERE or any(one in places for one in place.split("|"))


class Aimed(Random):
    """Chance that takes one place wherever it can."""

    def __init__(self, number, place, machines):
        super().__init__(number)
        self.place, self.machines = place, machines

    def choice(self, seq):
        """Also a device without an account may be it: no fault is injected there otherwise."""
        aimed = self.place in seq or (self.place in self.machines and all(one in self.machines for one in seq))
        return self.place if aimed else super().choice(seq)


def is_equal(trial, base, component):
    """Return True if another part at its place, instead of the fault that was injected, leaves the very same observations."""
    rows = [row for row in faults.FAULTS if (component.kind, component.mode) in row.components]
    made = (_aimed(base, row, component.place_text, number) for row in rows for number in range(AIMS))
    return any(state and observe(state, trial.run, trial.number) == trial.observations for state in made)


def _aimed(base, row, place, number):
    """The state with a fault at a place; None where it cannot be there, as on a device that has no plan."""
    try:
        made = row.inject(base, Aimed(number, place, base.world.machines))
    except KeyError:
        return None
    return made[0] if made and is_at((place,), made[1]) else None


def judged(trial, most):
    """For each fault of a trial whether it is among the first findings, or a rival there."""
    found = named(trial)
    answers = []
    for (row, place), base in zip(trial.faults, trial.bases, strict=True):
        verdict = MISSED
        for components in found[:most]:
            if is_right(components[0], row, place):
                verdict = FIRST
            elif verdict == MISSED and any(is_right(component, row, place) for component in components[1:]):
                verdict = EQUAL if is_equal(trial, base, components[0]) else RIVAL
        answers.append((row, place, verdict))
    return answers, found


def single_faults(numbers, rows=faults.FAULTS):
    """One fault for each number, the rows in turn."""
    for number in numbers:
        row = rows[number % len(rows)]
        yield from _tried(draw(number, [[row]]), 1)


def pairs_of_faults(numbers, rows=faults.FAULTS):
    """Two faults at two places for each number."""
    for number in numbers:
        yield from _tried(draw(number, [rows, rows]), 3)


def _tried(trial, most):
    answers, found = judged(trial, most)
    yield trial, answers, found


def scores(trials):
    """The scores by kind of fault."""
    table = defaultdict(Score)
    for trial, answers, found in trials:
        for row, place, verdict in answers:
            score = table[row.name]
            score.verdicts[verdict] += 1
            score.findings[len(found)] += 1
            if verdict not in (FIRST, EQUAL):
                score.misses.append((trial.number, place + _unseen(trial, place), _said(found)))
    return table


def _unseen(trial, place):
    """The reason why the run could look neither at a place itself nor at the fault from another one."""
    outside = " (not in the run)" if place in trial.state.fleet.computers and place not in trial.run else ""
    return outside + (f" (no login on {', '.join(trial.noise)})" if trial.noise else "")


def _said(found):
    first = [
        " or ".join(f"{component.kind} {component.mode} of {component.place_text}" for component in components)
        for components in found[:3]
    ]
    return "; ".join(first) or "nothing"


def false_alarms(numbers):
    """The false findings on healthy fleets: (number, named parts) for each fleet with one."""
    for number in numbers:
        trial = draw(number, [])
        found = named(trial)
        if found:
            yield number, _said(found)


def render(table):
    """A table of scores."""
    width = max(len(name) for name in table)
    lines = [f"{'fault':<{width}} {FIRST:>7} {EQUAL:>7} {RIVAL:>13} {MISSED:>7}"]
    total = Counter()
    for name, score in sorted(
        table.items(), key=lambda item: (item[1].verdicts[FIRST] / item[1].verdicts.total(), item[0])
    ):
        total.update(score.verdicts)
        counts = score.verdicts
        lines.append(_line(name, width, counts))
    right = (total[FIRST] + total[EQUAL]) / total.total()
    lines.append(
        _line("all", width, total) + f"  first in {total[FIRST] / total.total():.1%}, with the equal ones {right:.1%}"
    )
    return "\n".join(lines)


def render_findings(table):
    """The share of trials by the number of their findings."""
    total = sum((score.findings for score in table.values()), Counter())
    return ", ".join(f"{count / total.total():.1%} with {number}" for number, count in sorted(total.items()))


def _line(name, width, counts):
    return f"{name:<{width}} {counts[FIRST]:>7} {counts[EQUAL]:>7} {counts[RIVAL]:>13} {counts[MISSED]:>7}"


def render_misses(table, most=3):
    """Some misses of each kind of fault."""
    return "\n".join(
        f"{name}: trial {number}, at {place}; named: {said}"
        for name, score in sorted(table.items())
        for number, place, said in score.misses[:most]
    )
