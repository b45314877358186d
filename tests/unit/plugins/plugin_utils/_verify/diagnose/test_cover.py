# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The smallest explanation of failures, without any check: parts in, parts out."""

import random
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import Component
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.cover import Failure, explain


def off(place):
    return Component("computer", place, "off")


def wall(place):
    return Component("filter", place, "forward")


def loss(place):
    return Component("link", place, "loss")


def explained(failures, passed, known=()):
    chosen, rest = explain([Failure(frozenset(suspects)) for suspects in failures], set(known), passed.get_number)
    return [(entry.component, entry.rivals) for entry in chosen], rest


class Passed(dict):
    """The number of successes that need a part."""

    def get_number(self, component):
        return self.get(component, 0)


def test_the_component_that_all_failures_share_is_chosen():
    failures = [{off("a"), wall("g")}, {off("b"), wall("g")}, {off("c"), wall("g")}]
    assert explained(failures, passed=Passed()) == ([(wall("g"), ())], [])


def test_a_success_clears_a_component():
    failures = [{off("a"), wall("g")}, {off("b"), wall("g")}]
    assert explained(failures, passed=Passed({wall("g"): 1})) == ([(off("a"), ()), (off("b"), ())], [])


def test_a_component_that_reading_did_not_show_costs_more():
    suspects = [Failure(frozenset({wall("a"), off("b")}))]

    def chosen(costs):
        (entry,), _rest = explain(suspects, set(), lambda component: 0, lambda component: costs.get(component, 0.0))
        return [entry.component, *entry.rivals]

    assert chosen({off("b"): 5.0}) == [wall("a")]
    assert chosen({wall("a"): 5.0}) == chosen({wall("a"): None}) == [off("b")]


def test_two_faults_are_two():
    failures = [{off("a"), wall("g")}, {off("a"), wall("h")}, {off("b"), wall("g")}, {off("b"), wall("h")}]
    passed = Passed({wall("g"): 3, wall("h"): 3})
    assert [component for component, _rivals in explained(failures, passed=passed)[0]] == [off("a"), off("b")]


def test_what_nothing_tells_apart_is_one_of_these():
    clocks = [Component("clock", place, "off") for place in "ab"]
    ((component, rivals),), rest = explained([set(clocks), set(clocks)], passed=Passed())
    assert {component, *rivals} == set(clocks) and rest == []


def test_what_was_read_wins_and_has_no_rival():
    clocks = [Component("clock", place, "off") for place in "ab"]
    assert explained([set(clocks)], known=[clocks[1]], passed=Passed()) == ([(clocks[1], ())], [])


def test_what_only_a_value_shows_is_never_concluded():
    names = Component("names", "a", "old", "b")
    assert explained([{names}], passed=Passed()) == ([], [0])
    assert explained([{names}], known=[names], passed=Passed()) == ([(names, ())], [])


def test_a_failure_stays_unexplained_when_its_components_succeed():
    assert explained([{off("a"), wall("g")}], passed=Passed({off("a"): 2, wall("g"): 5})) == ([], [0])


def test_loss_survives_some_successes():
    failures = [{loss("a")}] * 4
    assert explained(failures, passed=Passed({loss("a"): 3})) == ([(loss("a"), ())], [])


def test_a_component_that_others_make_needless_is_dropped():
    """The first choice covers most, and what is left needs two others, which explain all of it."""
    shared = [{wall("g"), off("a")}, {wall("g"), off("b")}, {wall("g"), off("a")}, {wall("g"), off("b")}]
    alone = [{off("a")}, {off("b")}]
    chosen, rest = explained(shared + alone, passed=Passed())
    assert {component for component, _rivals in chosen} == {off("a"), off("b")} and rest == []


@pytest.mark.slow
def test_a_quarter_of_a_million_failures_take_seconds():
    source = random.Random(1)
    components = [off(f"c{number}") for number in range(400)]
    broken = set(components[:3])
    failures = [Failure({source.choice(components[:3]), *source.sample(components, 8)}) for _number in range(20_000)]
    began = time.process_time()
    chosen, rest = explain(failures, set(), lambda component: 0 if component in broken else 3)
    assert {entry.component for entry in chosen} == broken and rest == []
    assert time.process_time() - began < 5.0
