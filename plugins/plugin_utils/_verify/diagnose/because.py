# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The reasons for a finding: its evidence, the rows that it explains, and the rivals with the successes that cleared them.

It asks the scene of a diagnosis after all is decided, and changes nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain

from ..._network.model import Rule
from ..checks.engine import Row
from ..components.component import Component
from ..trace.findings import SeenEnd
from ..trace.steps import make_trace
from ..trace.suspects import is_consistent
from . import evidence
from .evidence import BLOCKING_RULE, ERRNO, INFERRED, SEEN, TRACE, Because, Evidence, ExplainedRows, WeighedRival
from .finding import Finding
from .rules import BY_ID, RULES, DecisionRule
from .scene import NOT_FOUND, Scene

ASKED = 60  # rows of a finding whose suspects are rivals
RIVALS = 5  # that are weighed
SHOWN = 4  # rows that are kept as evidence, one for each rule and check
EXPLAINED = 12  # checks of the rows that it explains
ORDER = {rule.id: number for number, rule in enumerate(RULES, 1)}


def make_because(scene: Scene, entry: Finding) -> Because:
    """Say why a finding was made."""
    rule = find_winner(scene.winners, entry)
    looked_at = [*entry.proof, *entry.rows][:ASKED]
    return Because(
        rule=rule.id,
        title=rule.title,
        place=ORDER[rule.id],
        rules=len(RULES),
        certainty=rule.certainty,
        cost=entry.component.fault.cost,
        looked_at=len(looked_at),
        shown_by=tuple(_list_evidence(scene, entry, rule)),
        explains=tuple(_count_explained(scene.winners, entry)),
        rivals=tuple(_weigh_rivals(scene, entry, looked_at)),
    )


def find_winner(winners: Mapping[Row, str], entry: Finding) -> DecisionRule:
    """Find the rule that has made a finding: the first of those that have shown it, or that which has concluded it."""
    shown = [BY_ID[winners[row]] for row in entry.proof]
    if shown:
        return min(shown, key=RULES.index)
    return BY_ID["trace-end"] if entry.followed else _only_inferred(entry.rule)


def _only_inferred(rule: str) -> DecisionRule:
    """Return the rule of a finding without evidence. A finding whose evidence went to another finding was kept since it covers failures."""
    found = BY_ID.get(rule, BY_ID["cover"])
    return found if found.certainty == INFERRED else BY_ID["cover"]


def _list_evidence(scene: Scene, entry: Finding, rule: DecisionRule) -> Iterable[Evidence]:
    """List the evidence of a finding: a row for each rule and check; of an inferred one, the first row that it explains."""
    if not entry.proof:
        ends = entry.followed[:SHOWN] or (None,)
        row = entry.rows[0] if entry.rows else None
        yield from (_describe(scene, row, rule, end=end) for end in ends if row)
        return
    kept = {(scene.winners[row], row.check): row for row in reversed(entry.proof)}
    for (winner, _check), row in list(kept.items())[::-1][:SHOWN]:
        component = next(
            (
                component
                for component in (entry.component, *entry.also)
                if component in scene.verification.state.filters.rules
            ),
            None,
        )
        yield _describe(scene, row, BY_ID[winner], component, _find_end(entry, BY_ID[winner]))


def _find_end(entry: Finding, rule: DecisionRule) -> SeenEnd | None:
    return entry.followed[0] if rule.kind == TRACE and entry.followed else None


def _describe(
    scene: Scene, row: Row, rule: DecisionRule, component: Component | None = None, end: SeenEnd | None = None
) -> Evidence:
    details = {
        BLOCKING_RULE: describe_rule(scene.verification.state.filters.rules[component]) if component else "",
        ERRNO: scene.outcomes.get(row, ""),
    }
    judge = scene.verification.checks[row.check].judge
    return Evidence(
        kind=rule.kind,
        rule=rule.id,
        check=row.check,
        observer=row.observer,
        target=row.target,
        expected=row.expected,
        found=row.found,
        source="/".join(judge.__module__.split(".")[-2:]) + ".py",
        detail=details.get(rule.kind, ""),
        trace=make_trace(end) if end else None,
    )


def describe_rule(rule: Rule) -> str:
    """Write a rule of a packet filter with its chain."""
    ports = f"port {rule.ports[0]}" + (f" to {rule.ports[1]}" if rule.ports[1] != rule.ports[0] else "")
    words = (
        rule.origins[0] if rule.origins else rule.table,
        f"(hook {rule.chain}):",
        f"by {rule.incoming}" if rule.incoming else "",
        rule.protocol or "all packets",
        ports if rule.ports[1] - rule.ports[0] < 65535 else "",
        f"from {', '.join(map(str, rule.sources[:2]))}" if rule.sources else "",
        f"to {', '.join(map(str, rule.destinations[:2]))}" if rule.destinations else "",
        rule.verdict,
    )
    return " ".join(filter(None, words))


def _count_explained(winners: Mapping[Row, str], entry: Finding) -> Iterable[ExplainedRows]:
    """Count the rows of a finding by check and rule, the most frequent first."""
    counts = Counter((row.check, winners.get(row, "")) for row in (*entry.proof, *entry.rows))
    return (ExplainedRows(check, rule, number) for (check, rule), number in counts.most_common(EXPLAINED))


# Rivals


def _weigh_rivals(scene: Scene, entry: Finding, rows: Sequence[Row]) -> list[WeighedRival]:
    """Weigh the components that could be the reason of the same rows, those that explain most first."""
    counts: Counter[Component] = Counter()
    for row in rows:
        counts.update(scene.verification.list_suspects(row))
    own = {(component.kind, component.places, component.mode) for component in (entry.component, *entry.also)}
    others = [component for component in counts if (component.kind, component.places, component.mode) not in own]
    chosen = [component for component in entry.rivals if component in others]
    order = sorted(others, key=lambda component: (-counts[component], component.fault.cost, component))
    kinds = {
        (component.kind, component.mode): component for component in reversed(order)
    }.values()  # one of each kind first
    places = {
        (component.kind, component.mode, component.places): component for component in reversed(order)
    }.values()  # then one of each place
    kept = list(
        dict.fromkeys(
            (
                *chosen,
                *(component for component in order if component in kinds),
                *(component for component in order if component in places),
            )
        )
    )[:RIVALS]
    return [_weigh_rival(scene, entry, component, counts[component], rows) for component in kept]


def _weigh_rival(scene: Scene, entry: Finding, component: Component, number: int, rows: Sequence[Row]) -> WeighedRival:
    success = _find_success(scene, component, rows)
    reason = _find_reason(scene, entry, component, number < len(rows), success is not None)
    check, observer, target = success if success and reason == evidence.SUCCESS else ("", "", "")
    return WeighedRival(
        id=component.fault.id,
        kind=component.kind,
        mode=component.mode,
        place=component.place_text,
        what=component.what,
        rows=number,
        cost=component.fault.cost,
        cleared=reason in evidence.CLEARED,
        reason=reason,
        check=check,
        observer=observer,
        target=target,
    )


def _find_success(scene: Scene, component: Component, rows: Sequence[Row]) -> tuple[str, str, str] | None:
    """Find a success that needs a component: in the pairs that failed, then in others, in both directions."""
    pairs = chain(((row.observer, row.target) for row in rows), scene.sample_pairs(component))
    for observer, target in dict.fromkeys(way for one, other in pairs for way in ((one, other), (other, one))):
        if scene.count_needs(observer, target)[component]:
            found = scene.find_successes(observer, target)
            return next((check, observer, target) for check, components in found.items() if component in components)
    return None


def _find_reason(scene: Scene, entry: Finding, component: Component, explains_fewer: bool, has_success: bool) -> str:
    """Name the success that cleared a component, or the reason why it was not named though nothing cleared it."""
    if component in scene.broken:
        return evidence.OWN_FINDING
    if has_success and component.fault.hard:
        return evidence.SUCCESS
    doubt = scene.doubt(component)
    if doubt is None:
        return evidence.GOOD_VALUE
    if doubt == NOT_FOUND:
        return evidence.PASSING_RULES
    if entry.followed and not any(is_consistent(component, end.place) for end in entry.followed):
        return evidence.PASSED_TRACE
    if entry.sure == SEEN:
        return evidence.OUTWEIGHED
    if explains_fewer:
        return evidence.FEWER
    if component in entry.rivals:
        return evidence.EQUAL
    return evidence.RARER if component.fault.cost > entry.component.fault.cost else evidence.LESS
