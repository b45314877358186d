# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Reports of the fleets of the tests of the verification: judged, explained, and written."""

import pathlib
from typing import NamedTuple

import fleets
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._checks import engine
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._diagnosis import diagnosis
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._judgement import content, matrices, report
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._report import page

ROOT = pathlib.Path(__file__).resolve().parents[4]
TEMPLATE = (ROOT / "plugins/plugin_utils/_report/page.html.j2").read_text(encoding="utf-8")


class Report(NamedTuple):
    document: dict
    matrices: matrices.Matrices
    html: str


def reported(fleet, change=None, pairs="all", since=None, **more):
    """The document and the page about a fleet in which all works, after a change of what was seen."""
    seen = fleets.observed(fleet)
    if change:
        change(seen)
    verification = engine.Verification(CHECKS, fleet, seen, pairs)
    cells = matrices.Matrices(fleet)
    rows = list(cells.passing(verification.rows()))
    summary = report.summarise(rows, list(seen), len(fleet.computers), verification.pairs)
    found = diagnosis.explain_rows(verification, summary.notable)
    kept = rows if cells.single else summary.notable
    document = {
        **report.document(summary, found, kept),
        "time": "2026-11-22 14:02:00",
        "result": report.verdict_line(summary),
        "collection": "0.1.0",
        "ansible": "2.19.0",
        "judged_in": 0.1,
        "durations": "measurement 6.1 s; together 6.2 s",
        "file": "/home/operator/report.json",
        "robots": content.robots(fleet, seen),
        "machines": {
            name: {**content.NOTHING, "system": "Debian 12", "ros": "noetic", "provider": "bundled"}
            for name in fleet.computers
        },
        **more,
    }
    html = page.page(TEMPLATE, fleet, document, cells, since or {"time": "", "differences": []})
    return Report(document, cells, html)
