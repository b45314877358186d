# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The relay as people are shown it."""

from rosfleet_multimaster.protocol import metrics
from rosfleet_multimaster.protocol.messages import OK, WARN
from rosfleet_multimaster.relay.core.report import TopicCount, add_up, make_entry, make_samples

PASSED = [TopicCount("/scan", 10, 1000, 0), TopicCount("/camera", 5, 9000, 2), TopicCount("/scan", 1, 100, 3)]


def test_a_topic_is_one_row_and_the_busiest_is_first():
    assert add_up(PASSED) == [TopicCount("/camera", 5, 9000, 2), TopicCount("/scan", 11, 1100, 3)]


def test_the_entry_names_who_is_away_and_what_was_dropped():
    entry = make_entry(["kobuki2"], 3, add_up(PASSED), {})
    assert entry.level == WARN and entry.message == "2 of 3 robots answer; 5 messages were dropped"
    assert entry.values[0] == ("kobuki2", "its relay does not answer")
    assert entry.values[1] == ("/camera", "5 messages, 9000 bytes, 2 messages dropped")
    assert make_entry([], 3, [], {}).level == OK


def test_a_topic_that_stays_away_is_a_warning_with_its_reason():
    entry = make_entry([], 3, [], {"/odom": "its frames cannot be renamed: some/Odometry has a line that is no field"})
    assert entry.level == WARN and entry.values[0][0] == "/odom" and "some/Odometry" in entry.values[0][1]


def test_the_metrics_have_a_line_for_each_topic():
    text = metrics.text(make_samples(2, add_up(PASSED)))
    assert 'multimaster_relay_dropped_total{topic="/scan"} 3' in text and "multimaster_relay_robots 2" in text
