# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The report of a watch over the fleet: progress, and the moment and place of the first loss."""

from dataclasses import replace

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.watch import watch
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.watch import progress
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.watch.progress import (
    Event,
    LostValue,
    WatchAnswer,
)
from hypothesis import given
from hypothesis import strategies as st
from mentioned import mentions


def event(kind, name, after, well=False, expected="heard", found="silent"):
    return Event(kind, name, well, expected, found, 1_730_000_000.0 + after, after)


def test_durations_are_read_with_and_without_a_unit():
    assert [progress.plan_rounds(text)[-1] for text in ("90", "90s", "15m", " 2h ", "1d")] == [
        90,
        90,
        900,
        7200,
        86400,
    ]


@pytest.mark.parametrize("text", ["", "0", "5s", "1w", "8d", "-3m", "15 min", "1e3"])
def test_another_text_is_refused_in_one_sentence(text):
    with pytest.raises(progress.UnreadableDuration, match="10s.*7d.*90s.*15m.*2h"):
        progress.plan_rounds(text)


@given(st.integers(progress.LEAST, progress.MOST))
def test_rounds_end_with_the_watch_and_grow_with_it(seconds):
    ends = progress.plan_rounds(str(seconds))
    lengths = [end - begin for begin, end in zip((0, *ends), ends, strict=False)]
    assert ends[-1] == seconds
    assert all(0 < length <= progress.LONGEST for length in lengths)
    assert len(ends) <= max(progress.ROUNDS + 1, seconds // progress.LONGEST + 1)


def test_progress_tells_only_what_is_new():
    told = {
        "a": WatchAnswer(
            20,
            200.0,
            (event("link", "eth0", 60.0, expected="up", found="down"), event("group", "b", 64.0)),
            (LostValue("group", "b"),),
        ),
        "b": WatchAnswer(22, 199.0),
    }
    text = progress.describe_progress(told, 900, {"a": 1})
    head, line = text.splitlines()
    assert mentions(head, "3:20", "15:00", "42", "2", "1")
    assert mentions(line, "1:04", "a", "b", "heartbeat")
    assert "\n" not in progress.describe_progress(told, 900, {"a": 2})


def test_events_that_a_computer_does_not_list_are_counted():
    told = {"a": WatchAnswer(3, 30.0, dropped=7), "b": WatchAnswer(3, 30.0, dropped=2)}
    assert progress.describe_progress(told, 60, {}).splitlines()[1:] == [
        "  9 events are not listed, since a computer lists 500 at most"
    ]
    assert progress.MOST_EVENTS == watch.EVENTS


def test_what_returned_is_told():
    told = {"a": WatchAnswer(3, 30.0, (event("port", "b", 9.0, well=True, expected="open", found="open"),))}
    assert mentions(progress.describe_progress(told, 60, {}), "a", "b", "discovery")


def loss(*entries):
    return progress.describe_first_loss(sorted(entries, key=lambda entry: entry[1].time))


def test_nothing_lost_is_no_loss():
    assert not progress.describe_first_loss([])
    assert not loss(("a", event("group", "b", 9.0, well=True)))


def test_a_network_that_forgets_the_group_differs_from_silence():
    pairs = [("a", "b"), ("a", "c"), ("b", "a"), ("b", "c"), ("c", "a"), ("c", "b")]
    text = loss(
        *((observer, event("group", name, 261.0 + number / 10)) for number, (observer, name) in enumerate(pairs))
    )
    assert "4:21 after the start" in text
    assert mentions(text, "3", "heartbeat")
    assert "[RF-821]" in text
    text = loss(*((observer, event("group", "c", 20.0)) for observer in ("a", "b")))
    assert "2 computers hear nothing of c [RF-813]" in text


@pytest.mark.parametrize("time", [1e20, -1e20])
def test_a_time_that_no_clock_has_does_not_end_the_watch(time):
    odd = replace(event("link", "eth0", 20.0), time=time)
    assert "a time that no clock has" in progress.describe_event("a", odd)


def test_one_who_hears_nobody_is_named():
    text = loss(("a", event("group", "b", 20.0)), ("a", event("group", "c", 20.5)), ("a", event("master", "c", 20.5)))
    assert text.endswith("a hears nothing of 2 masters.") or "a hears no heartbeat" in text


def test_the_component_that_is_nearest_to_the_reason_is_named():
    text = loss(
        ("b", event("group", "a", 30.0)),
        ("c", event("master", "a", 30.2)),
        ("a", event("link", "eth0", 31.0, expected="up", found="down")),
    )
    assert mentions(text, "0:30", "eth0", "a", "2", "10 s", "RF-803")


def test_a_computer_that_does_not_answer_any_more():
    text = loss(
        ("a", event("computer", "", 0.0, expected="an answer", found="ssh: no route")), ("b", event("group", "a", 4.0))
    )
    assert "a does not answer: ssh: no route" in text


def test_every_kind_has_a_sentence_without_gaps():
    for kind in progress.RANKS:
        text = progress.describe_event("pc", event(kind, "name", 3.0))
        assert "{" not in text
        assert "pc" in text


def test_a_computer_that_reads_nothing_any_more_is_named():
    text = loss(
        ("a", event("readings", "readings", 3.0, expected="read", found="no look")), ("a", event("group", "b", 4.0))
    )
    assert mentions(text, "a", "1")


def test_all_kinds_that_have_one_good_value_have_a_sentence():
    assert set(watch.GOOD) <= set(progress.RANKS)
