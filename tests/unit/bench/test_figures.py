# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of the network's figures: values, limits, and what falls short."""

import pytest

from tests.bench.network import figures

TITLES = {"managed": "ours", "upstream": "theirs"}
FOUND = {
    "managed": {"new": [0.004, 0.006, 0.02], "memory": [95e6]},
    "upstream": {"new": [1.5, 4.0], "memory": [90e6]},
}


def test_a_system_that_is_not_measured_again_keeps_its_figures():
    before = {
        "machine": {"date": "then"},
        "systems": {"managed": {"new": [9.0]}, "upstream": {"new": [1.5]}},
        "crowd": [1],
    }
    now = {"machines": {"managed": {"date": "now"}}, "systems": {"managed": {"new": [0.004]}}}
    found = figures.merged(before, now, {"managed": "ours", "existing": "polled", "upstream": "theirs"})
    assert found["systems"] == {"managed": {"new": [0.004]}, "upstream": {"new": [1.5]}}
    assert found["machines"] == {"managed": {"date": "now"}, "upstream": {"date": "then"}}
    assert found["titles"] == {"managed": "ours", "upstream": "theirs"} and found["crowd"] == [1]
    assert figures.merged(found, {"machines": {}, "systems": {}}, TITLES) == found
    assert figures.merged({}, now, TITLES)["crowd"] == []


def test_a_share_is_a_sample():
    samples = [float(number) for number in range(1, 101)]
    assert figures.share(99)(samples) == 99 and figures.share(50)(samples) == 50
    assert figures.share(99)([3.0]) == 3.0


def test_the_table_has_a_column_for_each_system():
    table = figures.table(FOUND, TITLES)
    first = next(line for line in table.splitlines() if line.startswith("| new publisher"))
    assert "| median | 6.0 ms | 2.75 s | 10.0 ms (managed) |" in first
    assert "**95.0 MB**" in table and "first message" not in table


def test_what_falls_short_is_named_with_its_figure_and_its_limit():
    assert figures.missed(FOUND) == [
        "memory of both nodes and the roscore, median, managed: 95.0 MB, at most 90.0 MB asked for"
    ]
    late = {"managed": {"new": [0.02, 0.06]}}
    assert [line.split(",")[1].strip() for line in figures.missed(late)] == ["median", "p99"]


@pytest.mark.parametrize("figure", figures.FIGURES)
def test_each_figure_has_a_unit_and_a_statistic_that_there_are(figure):
    assert figure.unit in figures.UNITS and figure.statistic in figures.STATISTICS
    assert set(figure.limits) <= {"managed", "existing"}
