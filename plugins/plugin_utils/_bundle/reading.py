# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The reader of a bundle: only the files of the judgement are read. Pure.

Each verification imports this for its report, so it needs none of the patterns by which a bundle is written (`bundle.py`).
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

from .._base.plain import Mismatch, from_plain, to_plain
from .._base.plain_text import LINE, plain, plain_data
from .._plan.model import FleetPlan
from .._verify.observe.observations import Observation
from .._verify.observe.task_results import list_plan_names, quote_texts
from .._verify.report.run import Run
from .archive import UnreadableBundle

FORMAT = 1
ABOUT, PLAN, OBSERVATIONS = "about.json", "plan.json", "observations.json"
JUDGED = (ABOUT, PLAN, OBSERVATIONS)  # the files that are read
COMPUTERS = 2000


def read_bundle(texts: Mapping[str, str]) -> Run:
    """Read a bundle, which may be hostile. Raises UnreadableBundle."""
    about, plan, observations = (_load(name, texts[name]) for name in JUDGED)
    if about.get("format") != FORMAT:
        raise UnreadableBundle(f"has the format {plain(about.get('format'), 20)}; this version reads {FORMAT}")
    if len(observations) > COMPUTERS or len(plan.get("computers", ())) > COMPUTERS:
        raise UnreadableBundle(f"has more than {COMPUTERS} computers")
    try:
        fleet = from_plain(FleetPlan, plan)
        read = {name: from_plain(Observation, entry) for name, entry in observations.items()}
    except (Mismatch, RecursionError) as problem:
        raise UnreadableBundle(f"does not fit: {plain(problem, LINE)}") from None
    machines = about.get("computers")
    return Run(
        fleet,
        {name: entry for name, entry in read.items() if name in fleet.computers},
        {name: _strings(entry) for name, entry in machines.items()} if isinstance(machines, dict) else {},
        {name: text for name, text in about.items() if isinstance(text, str)},
    )


def quote_run(run: Run) -> Run:
    """Return a run whose texts may be in sentences, as `_verify/observe/task_results.py` makes them for robots."""
    names = list_plan_names(run.fleet)
    quoted = {name: quote_texts(to_plain(entry), names=names) for name, entry in run.observations.items()}
    return dataclasses.replace(
        run, observations={name: from_plain(Observation, entry) for name, entry in quoted.items()}
    )


def _strings(entry: Any) -> dict[str, str]:
    return {name: text for name, text in entry.items() if isinstance(text, str)} if isinstance(entry, dict) else {}


def _load(name: str, text: str) -> dict[str, Any]:
    try:
        data = plain_data(json.loads(text, parse_constant=_refuse_number))
    except (ValueError, RecursionError):
        raise UnreadableBundle(f"has a {name} that is no JSON, or too deep") from None
    if not isinstance(data, dict):
        raise UnreadableBundle(f"has a {name} that is no mapping")
    return data


def _refuse_number(text: str) -> float:
    raise ValueError(text)
