# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A judgement keeps the rows that its files need; as data it has every row and finding."""

import json

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import (
    FAILED,
    OK,
    Row,
    Verification,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import Component
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.diagnosis import Diagnosis, Finding
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.judgement import FleetJudgement, judge
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.summary import summarise


def judge_fleet(fleet, pages, everything, change=None):
    seen = fleets.observed(fleet)
    if change:
        change(seen)
    return judge(Verification(CHECKS, fleet, seen), pages, everything)


@pytest.mark.costly
def test_the_findings_are_the_same_whatever_is_kept():
    small = [judge_fleet(fleets.fig12(), pages, False, fleets.wall) for pages in (False, True)]
    large = [
        judge_fleet(
            fleets.plan(21, 2), pages, everything, lambda seen: fleets.silent(seen, list(seen), ["kobuki7computer"])
        )
        for pages, everything in ((False, False), (True, False), (True, True))
    ]
    for results in (small, large):
        assert len({str(entry.diagnosis.findings) for entry in results}) == 1
        assert len({str(sorted(entry.summary.counts.items())) for entry in results}) == 1
        assert results[0].matrices is None and results[0].rows == ()
    assert len(small[1].rows) == small[1].summary.total
    assert large[1].rows == large[1].summary.notable and len(large[2].rows) == large[2].summary.total


@pytest.mark.slow
def test_a_small_run_of_a_large_fleet_has_the_whole_matrix():
    fleet = fleets.plan(21, 2)
    seen = {name: one for name, one in fleets.observed(fleet).items() if name in (fleets.ONE, fleets.TWO)}
    assert judge(Verification(CHECKS, fleet, seen), True, False).summary.cells[fleets.ONE, fleets.TWO][OK]


def test_the_data_has_every_row_and_finding():
    one, two = fleets.ONE, fleets.TWO
    rows = [
        Row("name", one, two, FAILED, "192.168.1.239", "127.0.1.1"),
        Row("ping_name", one, two, FAILED, f"an answer of {two}", "no answer"),
        Row("ping_name", two, one, OK, f"an answer of {one}", "0.4 ms"),
        Row("rpc_port", two, one, FAILED, "TCP port 11611 opens", "no answer"),
    ]
    rival = Component("clock", two, "off")
    finding = Finding(Component("names", one, "loopback", two), proof=(rows[0],), rows=(rows[1],), rivals=(rival,))
    diagnosis = Diagnosis((finding,), unexplained=(rows[3],))
    data = json.loads(json.dumps(FleetJudgement(summarise(rows, [one, two], 2), diagnosis, rows, None, 0.0).as_data()))
    assert (data["verdict"], data["computers"], len(data["rows"])) == (FAILED, [one, two], 4)
    assert data["result"] == "FAILED: 3 of 4 checks failed; the list has 1 finding, 1 not explained."
    (entry,) = data["findings"]
    assert (entry["kind"], entry["place"], entry["mode"], entry["what"]) == ("names", one, "loopback", two)
    assert entry["seen"] == [rows[0]._asdict()] and entry["follows"] == [rows[1]._asdict()]
    assert entry["rivals"][0]["place"] == two and data["unexplained"] == [rows[3]._asdict()]
    check = next(check for check in data["checks"] if check["check"] == "ping_name")
    assert check == {"check": "ping_name", "title": "ping by name", "ok": 1, "warning": 0, "failed": 1, "unknown": 0}
