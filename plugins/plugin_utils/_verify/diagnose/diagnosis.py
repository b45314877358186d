# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The diagnosis: the smallest set of components that explains the failures, and that no success contradicts.

Pure: the plan and the observations in, findings out. The rules in rules.py decide. A success of the same kind clears a component.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace

from ..._plan.model import FleetPlan
from ..checks.engine import FAILED, OK, UNKNOWN, WARNING, Row, Verification
from ..components.component import HEARSAY, Component
from ..context.advised_values import name_values
from ..context.check_context import LATELY
from .because import make_because
from .commands import make_commands
from .evidence import INFERRED, LOCATED, SEEN
from .finding import NAMED, Diagnosis, Finding
from .offsets import offset
from .onset import describe_onset
from .ports import find_port
from .rules import decide
from .scene import Scene

__all__ = ("INFERRED", "LOCATED", "SEEN", "Diagnosis", "Finding", "explain_rows", "list_unshown")

SERIOUS = (FAILED, WARNING, UNKNOWN)
MOST = 20_000  # rows that are explained
EXPLAINED = 50  # findings of which the rivals are weighed: as many as the page has


def explain_rows(verification: Verification, rows: Sequence[Row]) -> Diagnosis:
    """Explain the rows that are not ok; of very many, some out of all of them, since they say the same again and again."""
    if not rows:
        return Diagnosis()
    some = rows if len(rows) <= MOST else _sample(rows)
    scene = Scene(verification, some)
    decide(scene)
    findings = sorted(_merge_components(scene.broken.values()), key=lambda entry: _weigh(scene, entry))
    detailed = tuple(_add_details(scene, entry, number < EXPLAINED) for number, entry in enumerate(findings))
    return Diagnosis(detailed, tuple(one.row for one in scene.open), looked_at=len(some), total=len(rows))


def list_unshown(verification: Verification) -> list[Sequence[Row]]:
    """List failures that no value shows: the rows of each finding without a proof, and those that nothing explains."""
    diagnosis = explain_rows(verification, [row for row in verification.rows(Counter()) if row.verdict != OK])
    unshown = [
        entry
        for entry in diagnosis.findings
        if not entry.proof or (entry.component.kind, entry.component.mode) in HEARSAY
    ]
    return [*((*entry.proof, *entry.rows) for entry in unshown), diagnosis.unexplained]


def _sample(rows: Sequence[Row]) -> list[Row]:
    """Take every so many of the rows, and all that are of one computer."""
    step = -(-len(rows) // MOST)
    return [row for number, row in enumerate(rows) if number % step == 0 or row.observer == row.target]


def _weigh(scene: Scene, entry: Finding) -> tuple[int, float, int, bool, int, Component]:
    """Order findings: the serious ones first; of these the faults of now, those from which about ten times as much follows, those that a value shows."""
    results = len(entry.rows) + len(entry.proof)
    return (
        SERIOUS.index(entry.verdict),
        _count_seconds(scene, entry),
        -len(str(results)),
        not entry.proof,
        -results,
        entry.component,
    )


def _count_seconds(scene: Scene, entry: Finding) -> float:
    """Count the seconds since the last start of a unit that ended and runs again; 0 for a fault of now."""
    computer = scene.find_computer(entry.component)
    if computer is None or entry.verdict != WARNING or entry.component.mode != "restarting":
        return 0.0
    units = {component.what for component in (entry.component, *entry.also)}
    return min(
        (LATELY if one.age_s is None else one.age_s for one in computer.probe.services if one.unit in units),
        default=LATELY,
    )


def _add_details(scene: Scene, entry: Finding, is_explained: bool) -> Finding:
    """Add the facts of the machine at its place: since when, by how much, and the commands against it."""
    computer = scene.find_computer(entry.component)
    told = _add_port(_add_clock_offset(entry), scene.verification.fleet)
    return replace(
        told,
        because=make_because(scene, entry) if is_explained else None,
        since=describe_onset(entry.component, computer, scene.verification.state),
        commands=make_commands((told.component, *entry.also), computer, scene.verification.state),
        known={one: name_values(one, scene.verification.state) for one in told.candidates},
        inventory=scene.verification.inventory,
    )


def _merge_components(broken: Iterable[Finding]) -> Iterable[Finding]:
    """Make one finding of the components that are one for a person."""
    groups: dict[Component, list[Finding]] = defaultdict(list)
    for entry in broken:
        groups[entry.component._replace(what="")].append(entry)
    return map(_merge, groups.values())


def _add_clock_offset(entry: Finding) -> Finding:
    """Say of clocks by how much they are off."""
    components = [
        component._replace(what=offset(component, (*entry.proof, *entry.rows)) or component.what)
        if component.kind == "clock"
        else component
        for component in entry.candidates
    ]
    return replace(entry, component=components[0], rivals=tuple(components[1:]))


def _add_port(entry: Finding, fleet: FleetPlan) -> Finding:
    """Say of a packet filter which port it closes in this fleet."""
    rows = (*entry.proof, *entry.rows)
    components = [
        component if component.what else component._replace(what=find_port(component, rows, fleet))
        for component in entry.candidates
    ]
    return replace(entry, component=components[0], rivals=tuple(components[1:]))


def _merge(group: Sequence[Finding]) -> Finding:
    first = min(group, key=lambda entry: (-len(entry.proof) - len(entry.rows), entry.component))
    proof, rows = [row for entry in group for row in entry.proof], [row for entry in group for row in entry.rows]
    verdicts = {row.verdict for row in (*proof, *rows)}
    worst = next((verdict for verdict in SERIOUS if verdict in verdicts), UNKNOWN)
    also = tuple(sorted(entry.component for entry in group if entry is not first))
    followed = tuple(end for entry in group for end in entry.followed)[:NAMED]
    return replace(first, verdict=worst, proof=proof, rows=rows, also=also, followed=followed)
