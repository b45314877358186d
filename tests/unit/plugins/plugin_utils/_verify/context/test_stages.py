# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The stages of a call: the first one that lacks it, and the component that is named for it."""

from itertools import takewhile

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.stages import Stage, find_stage
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.diagnosis import SEEN
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    GivenTopics,
    ParameterDifference,
    RefusedName,
    SilentNode,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from fleets import components, diagnosed, drop_import, fig12, of, update, without
from hypothesis import given
from hypothesis import strategies as st

STAGES = tuple(Stage)
OBSERVER, TARGET = "car-ext", "tibi-nav"
FLEET = fig12()
OWN, ITS = (FLEET.master_of[FLEET.computers[name].robot].computer for name in (OBSERVER, TARGET))  # of their roscores
TOPIC = f"/multimaster_verify/{TARGET}"


@given(st.integers(0, len(STAGES) - 1), st.lists(st.sampled_from([False, None]), min_size=8, max_size=8))
def test_the_stage_that_lacks_it_is_told(number, later):
    seen = {stage: at < number or (False if at == number else later[at]) for at, stage in enumerate(STAGES)}
    assert find_stage(seen) == STAGES[number]


@given(st.lists(st.sampled_from([True, False, None]), min_size=8, max_size=8))
def test_nothing_is_told_beyond_what_is_known(values):
    told = find_stage(dict(zip(STAGES, values, strict=True)))
    after_last = list(takewhile(lambda value: value is not True, reversed(values)))[::-1]
    first = len(values) - len(after_last)
    expected = STAGES[first] if after_last and after_last[0] is False else None
    assert told == expected


def test_nothing_is_told_where_nothing_was_asked():
    assert find_stage({}) is None and find_stage({Stage.READ: True}) is None


def _drop_registrations(seen, *computers):
    """The topic is at none of these roscores, and their robots do not hear it."""
    robots = {FLEET.computers[name].robot for name in computers}
    for name in computers:
        exchange = seen[name].probe.exchange
        update(exchange, topics=without(exchange.topics, TOPIC))
        drop_import(seen, name, TOPIC)
    for name, one in seen.items():
        if FLEET.computers[name].robot in robots:
            for entry in _entries(one):
                update(entry, heard=False, text="", publishers=(), error="the topic is not registered")


def _entries(one):
    return [entry for entry in one.probe.topics if entry.computer == TARGET]


def _masters(seen):
    return [master.computer for master in FLEET.masters]


def _tell(seen, asker, *given):
    """The discovery node of the target's master has told what it has."""
    own = () if asker == ITS else seen[asker].probe.sources
    update(seen[asker].probe, sources=[*own, GivenTopics(ITS, (TOPIC,), given, outcome=Outcome.ANSWERED)])


def _unregistered(seen):
    _drop_registrations(seen, *_masters(seen))
    update(seen[ITS].probe, sources=())


def _undiscovered(seen):
    here = [name for name in _masters(seen) if name != ITS]
    _drop_registrations(seen, *here)
    for name in _masters(seen):
        _tell(seen, name)


def _withheld(seen):
    _undiscovered(seen)
    _tell(seen, ITS, TOPIC)


def _lagging(seen):
    """Only the robot of the observer lacks it, and it is given to it."""
    _drop_registrations(seen, OWN)
    _tell(seen, OWN, TOPIC)


def _refused(seen):
    _lagging(seen)
    update(of(seen[OWN].probe.services, "sync"), refused=[TOPIC])


def _objected(seen):
    _refused(seen)
    refusal = RefusedName(TOPIC, "type", "std_msgs/String", "tibi", "std_msgs/Header")
    update(of(seen[OWN].probe.services, "sync"), refusals=[refusal])


def _filtered(seen):
    _lagging(seen)
    update(seen[OWN].probe.parameters, differing=[ParameterDifference("master_sync", "ignore_topics", "[]", '["/m*"]')])


def _unheard(step, outcome=Outcome.OPEN):
    def change(seen):
        for one in seen.values():
            for entry in _entries(one):
                update(entry, heard=False, text="", error="nothing", step=step, reached_outcome=outcome)

    return change


def _untold(seen):
    for entry in _entries(seen[OBSERVER]):
        update(entry, heard=False, text="", error="nothing", reached_outcome=Outcome.OPEN)


def _mute(seen):
    _unheard("told")(seen)
    silence = SilentNode("/multimaster_verify_talker_tibi_nav_run", TARGET, "timed out", Outcome.NO_ANSWER)
    update(seen[ITS].probe.exchange, silent=[silence.node], silences=[silence])


FIRST = [
    (_unregistered, "registration", TARGET, "talker"),
    (_undiscovered, "discovery", ITS, "stale"),
    (_withheld, "discovery", ITS, "configuration"),
    (_refused, "sync", OWN, "refuses"),
    (_objected, "sync", OWN, "objects"),
    (_filtered, "sync", OWN, "configuration"),
    (_lagging, "sync", OWN, "stale"),
    (_untold, "registration", OBSERVER, "untold"),
    (_unheard("answered"), "registration", TARGET, "closed"),
    (_mute, "registration", TARGET, "mute"),
]


@pytest.mark.parametrize(("change", "kind", "place", "mode"), FIRST)
def test_who_lacks_the_call_first_is_the_finding(change, kind, place, mode):
    found = diagnosed(change, FLEET)
    assert components(found) == [(kind, place, mode)] and not found.unexplained, found
    assert found.findings[0].sure == SEEN


@pytest.mark.parametrize("service", ["roscore", "discovery", "sync"])
@pytest.mark.parametrize("change", [_undiscovered, _withheld])
def test_a_stopped_process_is_why_its_neighbours_know_little(change, service):
    """systemd ends it and starts it again in the same run, and its neighbours with it."""

    def stopped(seen):
        change(seen)
        for entry in seen[ITS].probe.services:
            update(entry, restarts=4, age_s=20.0)
        update(of(seen[ITS].probe.services, service), stopped=True)

    found = diagnosed(stopped, FLEET)
    assert components(found) == [("service", ITS, "stopped")] and not found.unexplained, found


def _unasked(seen):
    _lagging(seen)
    update(seen[OWN].probe, sources=seen[OWN].probe.sources[:1])


def _silent_source(seen):
    _lagging(seen)
    update(seen[OWN].probe.sources[-1], given=(), error="late", outcome=Outcome.NO_ANSWER)


@pytest.mark.parametrize("change", [_unasked, _silent_source])
def test_who_was_not_asked_is_not_accused_of_lagging(change):
    told = {(entry.component.kind, entry.component.mode) for entry in diagnosed(change, FLEET).findings}
    assert not told & {("sync", "stale"), ("discovery", "stale"), ("sync", "refuses")}, told
