# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The relay as people are shown it: an entry of /diagnostics, and metrics."""

from typing import Dict, Iterable, List, Mapping, NamedTuple, Sequence

from ...protocol.messages import OK, PREFIX, VALUES, WARN, DiagnosticEntry
from ...protocol.metrics import Samples


class TopicCount(NamedTuple):
    """Messages of a topic that have crossed since the node started."""

    topic: str
    messages: int
    size: int  # bytes
    dropped: int  # messages that did not get to a listener


def add_up(passed: Iterable[TopicCount]) -> List[TopicCount]:
    """Return one row for each topic, the busiest first."""
    rows: Dict[str, TopicCount] = {}
    for row in passed:
        before = rows.get(row.topic, TopicCount(row.topic, 0, 0, 0))
        rows[row.topic] = TopicCount(row.topic, *(one + other for one, other in zip(before[1:], row[1:])))
    return sorted(rows.values(), key=lambda row: (-row.size, row.topic))


def make_entry(
    away: Sequence[str], robots: int, passed: Sequence[TopicCount], kept_back: Mapping[str, str]
) -> DiagnosticEntry:
    """Return the entry of /diagnostics. `away`: the robots whose relay does not answer, of so many; `kept_back`: topics, and why."""
    dropped = sum(row.dropped for row in passed)
    values = [(robot, "its relay does not answer") for robot in away] + list(kept_back.items())
    values += [
        (row.topic, f"{row.messages} messages, {row.size} bytes, {row.dropped} messages dropped") for row in passed
    ]
    message = f"{robots - len(away)} of {robots} robots answer; {dropped} messages were dropped"
    return DiagnosticEntry(f"{PREFIX}relay", message, values[:VALUES], WARN if away or kept_back else OK)


def make_samples(answering: int, passed: Sequence[TopicCount]) -> Samples:
    """Return the metrics."""
    return {
        "relay_robots": {(): answering},
        "relay_messages_total": {(row.topic,): row.messages for row in passed},
        "relay_bytes_total": {(row.topic,): row.size for row in passed},
        "relay_dropped_total": {(row.topic,): row.dropped for row in passed},
    }
