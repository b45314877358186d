# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Recordings of faults (--record), judged by the code of now: what would be named first, without a lab.

PYTHONPATH=.work/collections python tests/faults/judge_again.py [--rows] FILE...
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "lab")]

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import OK  # noqa: E402
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.judgement import (  # noqa: E402
    FleetJudgement,
    judge_run,
    make_document,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.run import Run, gather_run  # noqa: E402
from catalogue import Fault  # noqa: E402
from fuzz import grade  # noqa: E402
from judge import named  # noqa: E402

ONCE = "verify_ways"  # registered on one computer, as by run_once, where Ansible gives it to all


def read_run(recorded: dict[str, Any]) -> Run:
    """Make a run of what a verification has registered."""
    once = [results[ONCE] for results in recorded["registered"].values() if ONCE in results]
    hostvars = {
        host: {**results, **({ONCE: once[0]} if once else {})} for host, results in recorded["registered"].items()
    }
    return gather_run({"fleet": recorded["fleet"], **recorded["report"]}, hostvars, list(hostvars), {"pairs": "auto"})


def judge(recorded: dict[str, Any]) -> tuple[str, str, FleetJudgement]:
    """Return the grade, the sentence of the first finding, and the judgement."""
    run = read_run(recorded)
    judgement = judge_run(run, True, False)
    found = named(make_document(run, judgement))
    parts = tuple((kind, mode) for kind, mode in recorded["parts"])
    fault = Fault(recorded["fault"], recorded["title"], (), (), (), parts, tuple(recorded["at"]), False)
    return grade(fault, found), found.text, judgement


def main() -> int:
    """Print a line or two for each recording."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", metavar="FILE", nargs="+", type=Path)
    parser.add_argument("--rows", action="store_true", help="print what failed, too")
    options = parser.parse_args()
    for path in options.files:
        recorded = json.loads(path.read_text())
        result, text, judgement = judge(recorded)
        print(f"{path.stem}: {result}: {recorded['title']}\n    named: {text}", flush=True)
        for row in judgement.rows if options.rows else ():
            if row.verdict != OK:
                print(
                    f"        {row.verdict} {row.check} {row.observer} {row.target}: {row.expected}; found {row.found}"
                )
    return 0


if __name__ == "__main__":
    sys.exit(main())
