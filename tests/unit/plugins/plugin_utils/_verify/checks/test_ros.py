# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of ROS between two computers: talkers that are not heard, for two robots and between three robot networks."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import FAILED, UNKNOWN
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import Publisher
from fleets import (
    ONE,
    TWO,
    assert_told,
    diagnosed,
    evaluate,
    fig12,
    notable,
    of,
    parts,
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
        _topic(publishers=[Publisher("/n", "http://localhost:1/")]),
        "direct_connection",
        FAILED,
        "environment",
        TWO,
        "shell",
    ),
    (
        _topic(publishers=[Publisher("/n", "http://kobuki1computer:1/")]),
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
        update(entry, heard=False, error="the listener failed: ImportError")


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
    told = parts(diagnosed(_topic(heard=False, publishers=(), error="not registered"), fleet))
    assert (told == [("declaration", "kobuki1", "narrow")]) == left_out
