# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The rules by which a diagnosis decides, in their order: one table, RULES.

Each rule takes the rows that nothing explains yet, and leaves the rest to the next one. The first rules look at rows one by one: what
shows one of them is a finding at once. The later ones look at the remaining failures as a whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..checks.engine import FAILED, UNKNOWN, WARNING
from ..components.component import Component
from ..context import needs
from ..context.needs import Components
from ..trace.probes import find_trip
from .cover import Failure, explain
from .effects import Effects
from .evidence import BLOCKING_RULE, ERRNO, INFERENCE, INFERRED, LOCATED, SEEN, TRACE, VALUE
from .scene import OpenRow, Scene

WEIGHTS = {FAILED: 1.0, WARNING: 0.9, UNKNOWN: 0.5}
NODES = ("roscore", "discovery", "sync", "registration")  # their view by others needs the network
CHANCE = 0.3  # the weight of a failure if packets are known to get lost
LOSSES = ("loss", "power_save")  # modes of components that lose some packets
MOST_ENDS = 4  # places that a finding names
NOTHING: Components = frozenset()


class DecisionRule(NamedTuple):
    """A rule: its id, its sentence, how sure a finding of it is, its evidence, and its change of a scene."""

    id: str
    title: str
    certainty: str
    kind: str
    apply: Callable[[Scene, str], None]
    # The files below _verify where a wrong finding of it is corrected. None: the judge of the check decides.
    decides: tuple[str, ...] = ()


# Rows one by one


def _by_row(find: Callable[[Scene, OpenRow], Components]) -> Callable[[Scene, str], None]:
    """Make a rule of a function that returns the components which a row shows to be broken."""

    def apply(scene: Scene, rule: str) -> None:
        rest = []
        for one in scene.open:
            if components := find(scene, one):
                scene.prove(components, one.row, rule)
            else:
                rest.append(one)
        scene.open = rest

    return apply


def _find_drop(scene: Scene, one: OpenRow) -> Components:
    """Find the packet filter with a rule that drops the failed packets of a check."""
    verification = scene.verification
    trip = find_trip(verification, one.row)
    component = trip and verification.state.filters.find_drop(trip.sender, trip.target, trip.traffic)
    return NOTHING if component is None else frozenset({component})


def _find_sign(scene: Scene, one: OpenRow) -> Components:
    """Find the component that followed packets have shown on the way of a row."""
    end = scene.find_end(one.row)
    if end is None or end.sign is None:
        return NOTHING
    scene.shown[end.sign].append(end)
    return frozenset({end.sign})


def _find_value(_scene: Scene, one: OpenRow) -> Components:
    return one.shown


def _find_error(scene: Scene, one: OpenRow) -> Components:
    """Find the only component that an error leaves."""
    if len(one.left) != 1:
        return NOTHING
    scene.outcomes[one.row] = one.outcome.value
    return one.left


# The remaining failures, as a whole


def _drop_consequences(scene: Scene, rule: str) -> None:
    """Count a component at its cause, if it is broken only because another component of the same place is."""
    scene.order_proofs()
    for component in scene.broken:
        scene.places[component.places].append(component)
    reasons = {component: reason for component in scene.broken if (reason := scene.find_reason(component))}
    for component, reason in reasons.items():
        while reason in reasons:  # which follows from another one
            reason = reasons[reason]
        scene.explain(reason, scene.broken.pop(component).proof, rule)


def _use_effects(scene: Scene, rule: str) -> None:
    """Give the failures that known faults explain to their findings: the packets end in the world as it was read, too."""
    effects, rest = Effects(scene.verification, scene.broken), []
    merged: dict[Component, Component] = {}  # component -> the one that it follows from
    for component in [component for component in scene.broken if component.kind in NODES or component in scene.shown]:
        proof = scene.broken[component].proof
        causes = {effects.find_cause(row, scene.verification.list_suspects(row)) for row in proof}
        if not causes & {None, component} and causes <= scene.broken.keys():
            merged[component], entry = min(filter(None, causes)), scene.broken.pop(component)
            scene.explain(merged[component], entry.proof + entry.rows, rule)
    for one in scene.open:
        cause = effects.find_cause(one.row, one.suspects)
        if cause is None:
            rest.append(one)
            continue
        while cause in merged:
            cause = merged[cause]
        scene.explain(cause, [one.row], rule)
    scene.open = rest


def _use_ends(scene: Scene, rule: str) -> None:
    """Let failures on a traced way suspect only the components that the packets left there."""
    if not scene.ends:
        return
    for one in scene.open:
        one.suspects = _choose_at_end(scene, one, rule)
    places = [end for end in scene.ends if end.component in scene.shown]
    for one in scene.open:
        computers = scene.list_computers(one.row.observer, one.row.target)
        one.suspects |= {end.component for end in places if end.crosses(computers)}


def _choose_at_end(scene: Scene, one: OpenRow, rule: str) -> Components:
    end = scene.find_end(one.row)
    if end is None:
        return one.suspects
    scene.traced[one.row] = rule
    row = one.row
    chosen = end.choose(filter(scene.is_possible, one.suspects))
    both = (row.observer, row.target), (row.target, row.observer)
    # Packets that got through between the two clear a component that lets nothing through, if another one is left.
    chosen = (
        frozenset(component for component in chosen if not any(scene.count_needs(*pair)[component] for pair in both))
        or chosen
    )
    for component in chosen:
        scene.shown[component].append(end)
    return chosen


def _explain_loss(scene: Scene, rule: str) -> None:
    """Explain the measured loss first. If packets are known to get lost, something else may fail by chance.

    So it counts less there, and a failure that nothing else explains is of the loss.
    """
    measured = [
        one.suspects
        for one in scene.open
        if one.suspects and all(component.mode in LOSSES for component in one.suspects)
    ]
    if not measured:
        return
    chosen, _rest = explain([Failure(suspects) for suspects in measured], set(scene.broken), scene.successes)
    for entry in chosen:
        scene.find(entry.component, rule).rivals = entry.rivals
    lost = frozenset(entry.component for entry in chosen)
    scene.by_chance = {one.number: lost & _list_loss_suspects(scene, one) for one in scene.open}


def _list_loss_suspects(scene: Scene, one: OpenRow) -> Components:
    row = one.row
    context = scene.verification.make_context(scene.verification.checks[row.check], row.observer, row.target)
    return needs.loss_components(context, row.observer, row.target) | needs.loss_components(context, *context.masters)


def _choose_components(scene: Scene, rule: str) -> None:
    """Choose few components that explain the remaining failures."""
    failures = [_weigh_failure(scene, one) for one in scene.open]
    # a component that was read may have a text that says more; a row suspects it without that text
    texts = {component._replace(what=""): component for component in scene.broken}
    ends = {end.component for end in scene.ends}
    chosen, rest = explain(failures, {*scene.broken, *texts, *ends}, scene.successes, scene.doubt)
    for entry in chosen:
        component = entry.component if entry.component in scene.broken else texts.get(entry.component, entry.component)
        for number in entry.failures:
            row = scene.open[number].row
            scene.explain(component, [row], scene.traced.get(row, rule))
        broken = scene.find(component, rule)
        broken.rivals = broken.rivals or entry.rivals
        broken.passed = scene.list_successes(broken.rows)
    scene.open = [scene.open[number] for number in rest]


def _weigh_failure(scene: Scene, one: OpenRow) -> Failure:
    maybe = scene.by_chance.get(one.number, NOTHING)
    return Failure(
        scene.add_reasons(one.suspects), WEIGHTS[one.row.verdict] * (CHANCE if maybe - one.suspects else 1.0)
    )


def _take_chance(scene: Scene, rule: str) -> None:
    """Give a failure that nothing else explains to a loss on its way."""
    rest = []
    for one in scene.open:
        if losses := scene.by_chance.get(one.number):
            scene.explain(min(losses), [one.row], rule)
        else:
            rest.append(one)
    scene.open = rest


def _name_ends(scene: Scene) -> None:
    """Add the places where packets ended to their findings."""
    for component, entry in scene.broken.items():
        places = {end.place.step: end for end in scene.shown.get(component, ())}
        entry.followed = tuple(places.values())[:MOST_ENDS]


RULES: Sequence[DecisionRule] = (
    DecisionRule(
        "rule-drops",
        "a rule of a packet filter that was read drops the packets of the check",
        SEEN,
        BLOCKING_RULE,
        _by_row(_find_drop),
        ("context/packet_filters.py", "../_network/facts.py"),
    ),
    DecisionRule(
        "trace-sign",
        "a packet trace shows the end of the packets, and an errno, an ICMP error or a counter there names the component",
        SEEN,
        TRACE,
        _by_row(_find_sign),
        ("trace/suspects.py",),
    ),
    DecisionRule("value", "a value that was read is not the expected one", SEEN, VALUE, _by_row(_find_value)),
    DecisionRule(
        "errno",
        "an error of a packet of the check leaves only one component",
        SEEN,
        ERRNO,
        _by_row(_find_error),
        ("context/errors.py",),
    ),
    DecisionRule(
        "consequence",
        "another fault of the same place brings it about",
        SEEN,
        VALUE,
        _drop_consequences,
        ("components/component.py",),
    ),
    DecisionRule(
        "effect",
        "with the known faults, the packets end at one of them",
        SEEN,
        VALUE,
        _use_effects,
        ("diagnose/effects.py", "context/actual_world.py"),
    ),
    DecisionRule(
        "trace-end",
        "packets were followed to their end, which leaves this component",
        LOCATED,
        TRACE,
        _use_ends,
        ("trace/suspects.py", "trace/findings.py"),
    ),
    DecisionRule(
        "loss",
        "lost packets were measured, and this component explains most of them",
        INFERRED,
        INFERENCE,
        _explain_loss,
        ("diagnose/cover.py", "context/needs.py"),
    ),
    DecisionRule(
        "cover",
        "it explains most of the remaining failures, and no success clears it",
        INFERRED,
        INFERENCE,
        _choose_components,
        ("diagnose/cover.py", "context/needs.py"),
    ),
    DecisionRule(
        "chance",
        "packets are known to get lost on its way",
        INFERRED,
        INFERENCE,
        _take_chance,
        ("context/needs.py",),
    ),
)
BY_ID = {rule.id: rule for rule in RULES}


def decide(scene: Scene) -> None:
    """Let each rule take the rows that it explains."""
    for rule in RULES:
        rule.apply(scene, rule.id)
    _name_ends(scene)
