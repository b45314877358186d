# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Reports about the fleets of the tests: judged, explained, and written."""

import pathlib
from typing import NamedTuple

import fleets
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks import engine
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report import content, matrices, nodes, page
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.judgement import judge

ROOT = pathlib.Path(__file__).resolve().parents[3]
TEMPLATE = (ROOT / "plugins/plugin_utils/_verify/report/page.html.j2").read_text(encoding="utf-8")


class Report(NamedTuple):
    document: dict
    matrices: matrices.Matrices
    html: str


def make_report(fleet, change=None, pairs="all", **more):
    """Return the document and the page about a fleet in which all works, after a change of the observations."""
    seen = fleets.observed(fleet)
    if change:
        change(seen)
    verification = engine.Verification(CHECKS, fleet, seen, pairs)
    judgement = judge(verification, pages=True, everything=False)
    document = {
        **judgement.as_data(),
        "time": "2026-11-22 14:02:00",
        "collection": "0.1.0",
        "ansible": "2.19.0",
        "judged_in": 0.1,
        "durations": "measurement 6.1 s; together 6.2 s",
        "file": "/home/operator/report.json",
        "since": "",
        "differences": [],
        "robots": content.list_robots(fleet, seen),
        "traffic": content.list_traffic(fleet, seen),
        "remarks": content.list_remarks(seen),
        "nodes": nodes.list_nodes(fleet, seen),
        "machines": {
            name: {**content.MACHINE, "system": "Debian 12", "ros": "noetic", "provider": "bundled"}
            for name in fleet.computers
        },
        **more,
    }
    html = page.make_page(TEMPLATE, fleet, document, judgement.matrices)
    return Report(document, judgement.matrices, html)
