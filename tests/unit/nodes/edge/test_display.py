# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The times at which a node publishes and writes."""

import pytest
from fleet_of_one import TIBI, URI
from rosfleet_multimaster.edge import display
from rosfleet_multimaster.edge.loop import Loop
from rosfleet_multimaster.edge.process import program
from rosfleet_multimaster.protocol import metrics, parameters
from rosfleet_multimaster.protocol.messages import DiagnosticEntry


class Topic:
    """/diagnostics, with or without listeners."""

    def __init__(self):
        self.listened, self.published = False, []

    def has_listeners(self):
        return self.listened

    def publish(self, entries, now, robot):
        self.published.append((robot, [entry.name for entry in entries]))


@pytest.fixture(name="at")
def _at(monkeypatch):
    """The clock."""
    time = [100.0]
    monkeypatch.setattr(display, "monotonic", lambda: time[0])
    return time


def shown(**values):
    given, _warnings = parameters.overlay(parameters.SYNC, {"members": [TIBI], **values})
    return display.Display(
        given,
        URI,
        "/master_sync",
        Loop(),
        program.LimitedLog(),
        lambda: [DiagnosticEntry("multimaster: x", "OK", [])],
        lambda: metrics.scalar_samples(round_seconds=0.25),
    )


def looks(it, topic, at, seconds):
    it.open(lambda: topic)
    for _second in range(seconds):
        at[0] += 1.0
        it.look()
    return len(topic.published)


def test_without_listeners_only_what_is_new_is_published(at):
    it, topic = shown(), Topic()
    assert looks(it, topic, at, 10) == 1 and topic.published == [("tibi", ["multimaster: x"])]
    it.mark_stale()
    assert looks(it, topic, at, 10) == 2


def test_diagnostics_are_published_at_1_hz_at_most(at):
    it, topic = shown(), Topic()
    topic.listened = True
    assert 20 / 4 <= looks(it, topic, at, 20) <= 20 / 2 + 1


def test_switched_off_nothing_is_published_or_written(at, tmp_path):
    it, topic = shown(diagnostics=False), Topic()
    assert not it.diagnoses and not it.has_outputs
    it.open(lambda: topic)
    it.look()
    it.end()
    assert topic.published == []


def test_the_file_is_written_now_and_then_and_goes_at_the_end(at, tmp_path):
    path = tmp_path / "metrics.prom"
    it = shown(metrics=str(path), diagnostics=False)
    assert it.has_outputs
    times = []
    for _second in range(60):
        at[0] += 1.0
        it.look()
        if not times or path.stat().st_ino != times[-1][1]:
            times.append((at[0], path.stat().st_ino))
    assert 3 <= len(times) <= 5
    text = path.read_text()
    assert (
        "\nmultimaster_round_seconds 0.25\n" in text and 'multimaster_build_info{node="master_sync",version="' in text
    )
    it.end()
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_cannot_be_written_is_one_line_of_the_log(at, tmp_path, caplog, monkeypatch):
    monkeypatch.setattr(program.LOG, "propagate", True)
    it = shown(metrics=str(tmp_path / "not-there" / "metrics.prom"))
    for _try in range(5):
        at[0] += 100.0
        it.look()
    assert len({id(record) for record in caplog.records if "metrics cannot be written" in record.getMessage()}) == 1
