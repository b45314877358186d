# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of ROS between two computers: talkers that are not heard, for two robots and between three robot networks."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks import ros
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import FAILED, UNKNOWN
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import Publisher
from fleets import (
    ONE,
    TWO,
    assert_told,
    assert_told_between_networks,
    evaluate,
    notable,
    of,
    plan,
    unheard,
    untold,
    update,
)


def _topic(**values):
    return lambda seen: update(of(seen[ONE].probe.topics, TWO, "computer"), **values)


def _talker_ended(seen):
    update(seen[TWO].probe.talker, running=False, error="killed")
    unheard(seen, error="the topic is not registered")


CAUSES = [
    (_talker_ended, "topic_heard", FAILED, "verify_lifetime"),
    (unheard, "topic_heard", FAILED, "sync node"),
    (_topic(heard=False), "topic_heard", FAILED, "TCP ports of nodes"),
    (_topic(publishers=[Publisher("/n", "http://localhost:1/")]), "direct_connection", FAILED, "localhost"),
    (_topic(publishers=[Publisher("/n", "http://kobuki1computer:1/")]), "direct_connection", FAILED, "elsewhere"),
]


@pytest.mark.parametrize(("change", "check", "verdict", "part"), CAUSES)
def test_each_cause_is_told(change, check, verdict, part):
    assert_told(change, check, verdict, part)


def _upstream(seen):
    """car-visio takes over what tibi-visio's nodes publish, but not what those of tibi-nav do."""
    entry = of(seen["car-nav"].probe.topics, "tibi-nav", "computer")
    update(entry, heard=False, publishers=(), error="not registered")


def _talker_at_home(seen):
    entry = of(seen["tibi-nav"].probe.topics, "tibi-monitor", "computer")
    update(entry, heard=False, publishers=(), error="no")


def _listener(seen):
    for entry in seen["tibi-nav"].probe.topics:
        update(entry, heard=False, error="the listener failed: ImportError")


# The change, the only check that fails by itself, its verdict, the predicate that tells it, whom and a part of the texts.
BETWEEN_NETWORKS = [
    (_upstream, "topic_heard", FAILED, ros._only_the_master, {"car-nav"}, "sync_remote_nodes"),
    (_talker_at_home, "topic_heard", FAILED, ros._not_registered_at_home, {"tibi-nav"}, "roscore on tibi-visio"),
    (_listener, "topic_heard", FAILED, ros._listener_failed, {"tibi-nav"}, "overloaded"),
]


@pytest.mark.parametrize(("change", "check", "verdict", "when", "observers", "part"), BETWEEN_NETWORKS)
def test_each_cause_between_networks_is_told(change, check, verdict, when, observers, part):
    assert_told_between_networks(change, check, verdict, when, observers, part)


def test_every_cause_has_a_row():
    assert untold(ros.CHECKS, CAUSES, BETWEEN_NETWORKS, [("topic_heard", ros._left_out)]) == []


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
    assert ("multimaster_filters" in found["topic_heard", ONE, TWO].cause) == left_out
