# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The check of the time that a computer follows."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import TimeSource
from fleets import ONE, TWO, components, diagnosed, of, plan, update

SERVER = "192.168.1.1"
GOOD = TimeSource(SERVER, selected=True, reachable=True, offset_s=0.0001)


def tell(change=lambda seen: None):
    """The diagnosis of two robots of which the second one follows the first."""

    def seen_so(seen):
        update(seen[ONE].probe.clock, answers=True, service="chrony")
        update(seen[TWO].probe.clock, answers=True, service="chrony", sources=(GOOD,))
        change(seen)

    return diagnosed(seen_so, plan(multimaster_clock="kobuki1"))


def sources(*found):
    return lambda seen: update(seen[TWO].probe.clock, sources=found)


def clocks_apart(change):
    """As seen by the masters, too."""

    def seen_so(seen):
        change(seen)
        update(of(seen[ONE].probe.masters, TWO, "computer"), clock_offset_s=2.0)
        update(of(seen[TWO].probe.masters, ONE, "computer"), clock_offset_s=-2.0)

    return seen_so


NONE = ("time_source", TWO, "none")
WRONG = ("time_source", TWO, "wrong")
MUTE = ("time_source", ONE, "mute")
OFF = ("clock", TWO, "off")


def stopped(name):
    return lambda seen: update(seen[name].probe.clock, answers=False, service="", sources=())


@pytest.mark.parametrize(
    ("change", "component"),
    [
        (stopped(TWO), NONE),
        (clocks_apart(stopped(TWO)), NONE),
        (stopped(ONE), ("time_source", ONE, "none")),
        (sources(TimeSource("192.168.9.9", True, True, 0.0)), WRONG),
        (sources(GOOD, TimeSource("192.168.9.9", True, True, 0.0)), WRONG),
        (sources(), WRONG),
        (clocks_apart(sources(TimeSource("192.168.9.9", True, True, 0.0))), WRONG),
        (sources(TimeSource(SERVER)), MUTE),
        (sources(TimeSource(SERVER, reachable=True)), MUTE),
        (sources(TimeSource(SERVER, True, True, 2.0)), OFF),
        (clocks_apart(sources(TimeSource(SERVER, True, True, 2.0))), OFF),
    ],
)
def test_each_fault_is_one_finding(change, component):
    assert components(tell(change)) == [component]


def test_all_is_well_without_a_fault():
    assert not tell().findings


def test_a_dead_source_explains_its_silence():
    def dead(seen):
        stopped(ONE)(seen)
        sources(TimeSource(SERVER))(seen)

    assert components(tell(dead)) == [("time_source", ONE, "none")]


def test_a_clock_is_told_by_how_much_its_source_says():
    (found,) = tell(sources(TimeSource(SERVER, True, True, -2.0))).findings
    assert found.sentence() == f"the clock of {TWO} is 2.0 s behind its source"


def test_what_was_not_asked_is_not_judged():
    assert not tell(lambda seen: update(seen[TWO].probe.clock, answers=None, sources=())).findings
