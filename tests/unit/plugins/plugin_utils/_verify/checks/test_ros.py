# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of ROS between two computers: talkers that are not heard, for two robots and between three robot networks."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import (
    FAILED,
    OK,
    UNKNOWN,
    WARNING,
    Verification,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.diagnosis import explain_rows
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    Stream,
    Streams,
    TopicPublisher,
)
from fleets import (
    ONE,
    TWO,
    assert_told,
    components,
    diagnosed,
    evaluate,
    fig12,
    notable,
    observed,
    of,
    plan,
    unheard,
    update,
)


def _topic(**values):
    return lambda seen: update(of(seen[ONE].probe.topics, TWO, "computer"), **values)


def _talker_ended(seen):
    update(seen[TWO].probe.talker, running=False, error="killed")
    unheard(seen, error="the topic is not registered")


def _nothing_registered(seen):
    """The sync node of the first robot hangs, and registers nothing."""
    unheard(seen, error="the topic is not registered")
    update(seen[ONE].probe.exchange, imports=(), silent=["/master_sync"])


# The change, a check that tells it, its verdict, and the part that is named.
FAULTS = [
    (_talker_ended, "topic_heard", FAILED, "registration", TWO, "talker"),
    (_nothing_registered, "topic_heard", FAILED, "sync", ONE, "hung"),
    (_topic(heard=False), "topic_heard", FAILED, "filter", TWO, "nodes in"),
    (
        _topic(publishers=[TopicPublisher("/n", "http://localhost:1/")]),
        "direct_connection",
        FAILED,
        "environment",
        TWO,
        "shell",
    ),
    (
        _topic(publishers=[TopicPublisher("/n", "http://kobuki1computer:1/")]),
        "direct_connection",
        FAILED,
        "environment",
        TWO,
        "shell",
    ),
]


@pytest.mark.parametrize(("change", "check", "verdict", "kind", "place", "mode"), FAULTS)
def test_each_fault_is_named(change, check, verdict, kind, place, mode):
    assert_told(change, check, verdict, kind, place, mode)


def _unregistered(seen):
    """The talker of tibi-nav has not registered with its roscore."""
    for one in seen.values():
        for entry in one.probe.topics:
            if entry.computer == "tibi-nav":
                update(entry, heard=False, publishers=(), error="the topic is not registered")


def _listener(seen):
    for entry in seen["tibi-nav"].probe.topics:
        update(entry, heard=False, listened=False, error="the listener failed: ImportError")


def _no_nodes(seen):
    """A packet filter on tibi-nav lets nobody in to its nodes."""
    for one in seen.values():
        for entry in one.probe.topics:
            if entry.computer == "tibi-nav":
                update(entry, heard=False, error="nothing")


BETWEEN_NETWORKS = [
    (_unregistered, "topic_heard", FAILED, "registration", "tibi-nav", "talker"),
    (_listener, "topic_heard", FAILED, "registration", "tibi-nav", "listener"),
    (_no_nodes, "topic_heard", FAILED, "filter", "tibi-nav", "nodes in"),
]


@pytest.mark.parametrize(("change", "check", "verdict", "kind", "place", "mode"), BETWEEN_NETWORKS)
def test_each_fault_between_networks_is_named(change, check, verdict, kind, place, mode):
    assert_told(change, check, verdict, kind, place, mode, fleet=fig12())


@pytest.mark.parametrize(
    ("filters", "left_out"),
    [
        ({}, False),
        ({"sync_topics": ["/odom"]}, False),
        ({"ignore_topics": ["/MULTI*"]}, True),
        ({"ignore_types": ["std_msgs/*"]}, True),
        ({"ignore_topics": ["/tf"]}, False),
    ],
)
def test_a_topic_that_the_filters_leave_out_is_no_failure(filters, left_out):
    fleet = plan(multimaster_filters=filters)
    found = notable(evaluate(_topic(heard=False, publishers=(), error="not registered"), fleet))
    assert found["topic_heard", ONE, TWO].verdict == (UNKNOWN if left_out else FAILED)
    told = components(diagnosed(_topic(heard=False, publishers=(), error="not registered"), fleet))
    assert (told == [("declaration", "kobuki1", "narrow")]) == left_out


def streamed(mbit_s, slow=None, error="", ways="both"):
    """All computers have sent streams, those to one of them, from it, or both, at another speed."""

    def speed(one, other):
        return 5.0 if (slow == one and ways != "in") or (slow == other and ways != "out") else mbit_s

    def change(seen):
        for name, entry in seen.items():
            others = [other for other in seen if other != name]
            update(entry, streams=Streams(tuple(Stream(other, speed(name, other), error) for other in others)))

    return change


def test_a_stream_of_any_speed_is_good_where_nothing_is_expected():
    found = [row for row in evaluate(streamed(90.0, slow=ONE)) if row.check == "throughput"]
    assert {(row.verdict, row.found) for row in found} == {(OK, "5.0 Mbit/s")} and not notable(found)


def test_a_stream_that_was_not_measured_is_not_judged():
    rows = notable(evaluate(streamed(None, error="it takes another stream"))).values()
    assert {(row.verdict, row.found) for row in rows} == {(UNKNOWN, "not measured: it takes another stream")}


@pytest.mark.parametrize(
    ("robots", "ways", "mode"),
    [(5, "both", "slow"), (5, "out", "slow out"), (5, "in", "slow in"), (2, "out", "slow out")],
)
def test_a_link_slower_than_expected_is_a_warning_with_its_place(robots, ways, mode):
    fleet = plan(robots)
    seen = observed(fleet)
    streamed(90.0, slow=ONE, ways=ways)(seen)
    checked = Verification(CHECKS, fleet, seen, least=20.0)
    rows = [row for row in checked.rows() if row.verdict != OK]
    assert {(row.check, row.verdict) for row in rows} == {("throughput", WARNING)}
    assert len(rows) == (robots - 1) * (2 if ways == "both" else 1)
    (found,) = explain_rows(checked, rows).findings
    assert found.component[:3] == ("link", ONE, mode) and found.verdict == WARNING
    assert [component[:3] for component in found.rivals] == ([("link", TWO, "slow in")] if robots == 2 else [])
