# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A judgement, and as much of it as the report keeps."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._case.pairs import ALL, AUTO
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._checks.engine import Passed, Row, Verification
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._diagnosis.diagnosis import Diagnosis, explain_rows
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._judgement import content, report
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._judgement.matrices import Matrices
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._judgement.run import Run


@dataclass(frozen=True)
class Judged:
    """A judgement, and as much of it as the files keep."""

    summary: report.Summary
    diagnosis: Diagnosis
    rows: Sequence[Row]
    matrices: Matrices | None
    seconds: float

    def document(self) -> dict[str, Any]:
        """The document without what is known of the fleet."""
        return {
            "result": report.verdict_line(self.summary),
            "judged_in": round(self.seconds, 2),
            **report.document(self.summary, self.diagnosis, self.rows),
        }


def judge(verification: Verification, pages: bool, everything: bool) -> Judged:
    """Judge all. Without `pages` only what is not ok is kept; in a large fleet also with them, where not `everything` is wanted."""
    began = time.monotonic()
    fleet, computers = verification.fleet, list(verification.run)
    if not pages:
        summary = report.summarised(verification, computers, len(fleet.computers))
        return Judged(summary, explain_rows(verification, summary.notable), (), None, time.monotonic() - began)
    matrices = Matrices(fleet)
    passed: Passed | None = None if matrices.single or everything else Counter()
    rows = matrices.passing(verification.rows(passed), passed)
    kept = list(rows) if passed is None else []
    summary = report.summarise(kept or rows, computers, len(fleet.computers), verification.pairs, passed)
    diagnosis = explain_rows(verification, summary.notable)
    return Judged(summary, diagnosis, kept or summary.notable, matrices, time.monotonic() - began)


def verdict(run: Run, pages: bool, everything: bool) -> Judged:
    """Judge what a run has seen."""
    pairs = AUTO if run.about.get("pairs") == AUTO else ALL
    least = float(run.about.get("least_mbit_s") or 0)
    return judge(Verification(CHECKS, run.fleet, run.observations, pairs, least), pages, everything)


def document(run: Run, judged: Judged) -> dict[str, Any]:
    """Return all that the report says, as data."""
    return {
        **judged.document(),
        "time": run.about.get("time", ""),
        "collection": run.about.get("collection", ""),
        "ansible": run.about.get("ansible", ""),
        "durations": run.about.get("durations", ""),
        "robots": content.robots(run.fleet, run.observations),
        "throughput": content.throughput(run.observations),
        "machines": {name: {**content.NOTHING, **run.machines.get(name, {})} for name in run.observations},
    }
