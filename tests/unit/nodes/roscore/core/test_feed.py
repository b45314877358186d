# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The history of changes: what somebody gets who knows a revision."""

import pytest
from rosfleet_multimaster.roscore.core.feed import Feed


def feed(*revisions, most=100):
    found = Feed("now", most)
    for records in revisions:
        found.add([[word] for word in records])
    return found


@pytest.mark.parametrize(("revision", "words"), [(0, "abc"), (1, "c"), (2, "")])
def test_what_came_after_a_revision_in_order(revision, words):
    assert feed("ab", "c").records_since("now", revision) == [[word] for word in words]


@pytest.mark.parametrize(("epoch", "revision"), [("", 0), ("earlier", 2), ("now", 3), ("now", -1)])
def test_who_knows_nothing_of_this_epoch_needs_all(epoch, revision):
    assert feed("ab", "c").records_since(epoch, revision) is None


def test_a_revision_is_whole_or_not_there():
    found = feed("ab", "cd", "ef", most=4)
    assert found.records_since("now", 0) is None and found.records_since("now", 1) == [["c"], ["d"], ["e"], ["f"]]


def test_a_revision_larger_than_the_history_needs_all():
    found = feed("abcdef", most=4)
    assert found.records_since("now", 0) is None and found.records_since("now", 1) == []


def test_who_follows_has_what_is_there_whatever_the_steps(most=7):
    source, seen, known = Feed("now", most), [], 0
    for number in range(200):
        source.add([[number, part] for part in range(number % 4 + 1)])
        if number % 3 == 0:
            records = source.records_since("now", known)
            seen = (
                [[n, part] for n in range(number + 1) for part in range(n % 4 + 1)]
                if records is None
                else seen + records
            )
            known = source.revision
            assert seen == [[n, part] for n in range(number + 1) for part in range(n % 4 + 1)]
