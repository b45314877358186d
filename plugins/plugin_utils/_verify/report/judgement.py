# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The judgement of a run, and the document about it. Pure."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..checks.engine import FAILED, OK, Passed, Row, Verification
from ..checks.table import CHECKS
from ..context.pairs import ALL, AUTO
from ..diagnose.diagnosis import Diagnosis, explain_rows
from . import content, nodes
from .matrices import MOST, Matrices
from .run import Run
from .summary import Summary, is_small, summarise, write_result


@dataclass(frozen=True)
class FleetJudgement:
    """A judgement, with the rows and matrices that the files of the report need."""

    summary: Summary
    diagnosis: Diagnosis
    rows: Sequence[Row]
    matrices: Matrices | None
    seconds: float

    def as_data(self) -> dict[str, Any]:
        """Return the judgement as plain data."""
        summary = self.summary
        return {
            "result": write_result(summary, self.diagnosis),
            "judged_in": round(self.seconds, 2),
            "computers": list(summary.computers),
            "pairs": dict(zip(("tried", "of"), summary.pairs, strict=True)),
            "verdict": FAILED if summary.count(FAILED) else OK,
            "checks": content.list_checks(summary),
            "findings": content.list_findings(self.diagnosis),
            "unexplained": [row._asdict() for row in self.diagnosis.unexplained],
            "rows": [row._asdict() for row in self.rows],
        }


def judge(verification: Verification, pages: bool, everything: bool) -> FleetJudgement:
    """Judge all rows, and keep no row without `pages`. Those of a large fleet that are ok are kept only with `everything`."""
    began = time.monotonic()
    fleet, computers = verification.fleet, list(verification.run)
    whole = is_small(computers) or (pages and (len(fleet.computers) <= MOST or everything))
    passed: Passed | None = None if whole else Counter()
    rows = list(verification.rows(passed))
    matrices = Matrices(fleet, rows, passed) if pages else None
    reached = sum(not plan.sealed for plan in fleet.computers.values())
    summary = summarise(rows, computers, reached, verification.pairs, passed)
    diagnosis = explain_rows(verification, summary.notable)
    kept = (rows if whole else summary.notable) if pages else ()
    return FleetJudgement(summary, diagnosis, kept, matrices, time.monotonic() - began)


def judge_run(run: Run, pages: bool, everything: bool) -> FleetJudgement:
    """Judge the observations of a run."""
    return judge(make_verification(run), pages, everything)


def make_verification(run: Run) -> Verification:
    """Apply the table of checks to the observations of a run."""
    pairs = AUTO if run.about.get("pairs") == AUTO else ALL
    least, since_last = (float(run.about.get(key) or 0) for key in ("least_mbit_s", "since_last_s"))
    return Verification(CHECKS, run.fleet, run.observations, pairs, least, since_last, run.inventory)


def make_document(run: Run, judgement: FleetJudgement) -> dict[str, Any]:
    """Return the whole content of the report as plain data."""
    return {
        **judgement.as_data(),
        **{key: run.about.get(key, "") for key in ("time", "collection", "ansible", "durations")},
        "planned": sorted(run.fleet.computers),
        "robots": content.list_robots(run.fleet, run.observations),
        "throughput": content.list_streams(run.observations),
        "traffic": content.list_traffic(run.fleet, run.observations),
        "remarks": content.list_remarks(run.observations),
        "nodes": nodes.list_nodes(run.fleet, run.observations),
        "machines": {name: {**content.MACHINE, **run.machines.get(name, {})} for name in run.observations},
    }
