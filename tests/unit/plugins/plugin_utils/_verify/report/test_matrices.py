# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Cells: the worst result, a short number, and robots instead of computers in a large fleet."""

from collections import Counter

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import (
    FAILED,
    OK,
    UNKNOWN,
    Row,
    Verification,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import Stream, Streams
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.matrices import KINDS, Matrices
from reports import make_report


def cells(report, kind):
    return next(matrix for matrix in report.matrices.tables() if matrix.kind.id == kind).cells


def test_each_check_is_in_one_matrix_at_most():
    checks = [check for kind in KINDS for check in kind.checks]
    assert len(checks) == len(set(checks)) and set(checks) <= {check.id for check in CHECKS}


def test_a_cell_has_the_worst_of_its_results_and_the_number():
    found = cells(make_report(fleets.fig12(), fleets.wall), "pings")
    bad, good = found["tibi-nav", "dabo-nav"], found["tibi-nav", "tibi-visio"]
    assert (bad.verdict, bad.text) == (FAILED, "") and any("ping by name: " in text for text in bad.results)
    assert (good.verdict, good.text) == (OK, "0.4 ms")


def test_every_row_is_in_a_cell():
    fleet = fleets.fig12()
    rows = fleets.judged(fleet, fleets.observed(fleet))
    found = Matrices(fleet, rows)
    counted = sum(cell.counts.total() for matrix in found.tables() for cell in matrix.cells.values())
    assert counted + sum(cell.counts.total() for cell in found.computer_matrix().cells.values()) == len(rows)


def test_in_a_large_fleet_a_cell_is_two_robots():
    fleet = fleets.plan(21, 2)
    bad = Row("ping_address", "kobuki1computer-1", "kobuki2computer", FAILED, "an answer", "none")
    found = Matrices(fleet, [bad._replace(verdict=OK), bad])
    (matrix,) = found.tables()
    cell = matrix.cells["kobuki1", "kobuki2"]
    assert (cell.verdict, cell.counts.total()) == (FAILED, 2)
    assert cell.results == ["kobuki1computer-1 to kobuki2computer: ping by address: none, expected an answer"]


def test_throughput_is_a_number_and_a_shade():
    rows = [Row("throughput", "tibi-nav", to, OK, "any", f"{mbit_s:.1f} Mbit/s") for to, mbit_s in SPEEDS.items()]
    rows.append(Row("throughput", "tibi-nav", "car-nav", UNKNOWN, "any", "not measured: refused"))
    found = Matrices(fleets.fig12(), rows)
    (matrix,) = found.tables()
    shown = {to: (cell.text, cell.shade) for (_from, to), cell in matrix.cells.items()}
    assert shown == {"dabo-nav": ("941", 5), "dabo-visio": ("400", 4), "car-visio": ("0.3", 1), "car-nav": ("", 0)}
    assert found.measured == 3


SPEEDS = {"dabo-nav": 941.0, "dabo-visio": 400.0, "car-visio": 0.3}


def test_the_slowest_stream_is_shown_in_a_large_fleet():
    row = Row("throughput", "kobuki1computer", "kobuki2computer", OK, "any", "90 Mbit/s")
    found = Matrices(fleets.plan(21, 2), [row, row._replace(observer="kobuki1computer-1", found="11.5 Mbit/s")])
    (matrix,) = found.tables()
    assert matrix.cells["kobuki1", "kobuki2"].text == "11.5"


@pytest.mark.slow
def test_what_is_only_counted_fills_the_same_cells():
    fleet = fleets.plan(21, 2)
    seen = fleets.observed(fleet)
    fleets.silent(seen, list(seen), ["kobuki7computer"])
    fleets.update(seen[fleets.ONE], streams=Streams((Stream(fleets.TWO, 90.0),)))  # a number that is shown
    verification, passed = Verification(CHECKS, fleet, seen), Counter()
    rows, made = list(verification.rows()), list(verification.rows(passed))
    whole, quick = Matrices(fleet, rows), Matrices(fleet, made, passed)
    assert len(made) < len(rows) / 3
    for one, other in [
        (whole.computer_matrix(), quick.computer_matrix()),
        *zip(whole.tables(), quick.tables(), strict=True),
    ]:
        assert one.cells == other.cells and set(one.observers) == set(other.observers)
    assert whole.measured == quick.measured == 1
