# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The report as one HTML page that needs nothing else: the template is page.html.j2, beside this file. Pure: text out.

All that the network said is a text in the template, which escapes it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._checks.engine import FAILED, OK, UNKNOWN, WARNING
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._checks.table import TITLES
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.plain_text import (
    LINE,
    LONGEST,
    plain,
    plain_data,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._judgement.matrices import Matrices
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import FleetPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._report.arrows import arrows
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._report.picture import SIGNS, Mark, picture
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

TEMPLATE = Path(__file__).with_name("page.html.j2")  # the doors read it
ROWS = 20  # results that are listed below a finding
FINDINGS = 50
PAIRS = 100  # pairs of robots whose data flow is listed
NAMES = 12  # names in a cell; with more it is folded
LISTED = 40  # names in a folded one
WORDS = {OK: "ok", FAILED: "failed", WARNING: "warning", UNKNOWN: "not judged"}
SHORT = {OK: "o", FAILED: "f", WARNING: "w", UNKNOWN: "u"}  # classes of cells: there are many


def page(
    template: str, fleet: FleetPlan, document: Mapping[str, Any], matrices: Matrices, since: Mapping[str, Any]
) -> str:
    """Write the page. `since` has the `time` of the run before and the `differences`; both are empty where there is none."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    findings = [_shown(entry) for entry in document["findings"][:FINDINGS]]
    left_out: dict[str, Any] = {"rows": [], "robots": [], "findings": [], "unexplained": []}
    not_seen = unseen(fleet, document["rows"])
    drawn = picture(fleet, marks(findings), not_seen)
    read = {entry["robot"] for entry in document["robots"] if entry["read"]}
    return environment.from_string(template).render(
        document=plain_data({**document, **left_out}, LINE),
        findings=findings,
        left_out=len(document["findings"]) - len(findings),
        unexplained=_rows(document["unexplained"]),
        picture=Markup(drawn),  # noqa: S704  # its texts are escaped there
        arrows=Markup(arrows(list(fleet.master_of), not_seen, read)),  # noqa: S704  # so are these
        own=matrices.own(),
        matrices=matrices.tables(),
        single=matrices.single,
        measured=matrices.measured,
        robots=len(document["robots"]),
        flows=list(islice(flows(document["robots"]), PAIRS)),
        not_judged=not_judged(document["rows"]),
        absent=[name for name in fleet.computers if name not in set(document["computers"])],
        since=plain_data(dict(since)),
        signs=SIGNS,
        words=WORDS,
        short=SHORT,
        titles=TITLES,
        names=NAMES,
        listed=LISTED,
    )


def _shown(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parts of a finding that are shown: of what follows from it, the first ones."""
    parts = plain_data({**entry, "seen": (), "follows": ()}, LINE)
    return {**parts, "seen": _rows(entry["seen"]), "follows": _rows(entry["follows"])}


def _rows(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {"first": plain_data(rows[:ROWS], LONGEST), "number": len(rows)}


def marks(findings: Sequence[Mapping[str, Any]]) -> Iterator[Mark]:
    """Place a mark for each finding, and for each of the parts that it may be instead."""
    for number, entry in enumerate(findings, 1):
        for place in dict.fromkeys([entry["place"], *(rival["place"] for rival in entry["rivals"])]):
            yield Mark(number, place, entry["verdict"], entry["sentence"])


def unseen(fleet: FleetPlan, rows: Iterable[Mapping[str, Any]]) -> dict[str, list[str]]:
    """Find the masters that a robot's own master does not list."""
    robots = {master.computer: master.robot for master in fleet.masters}
    found: dict[str, list[str]] = {}
    for row in rows:
        one, other = robots.get(row["observer"]), robots.get(row["target"])
        if row["check"] == "list_masters" and row["verdict"] == FAILED and one and other and one != other:
            found.setdefault(one, []).append(other)
    return found


def flows(robots: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Put what a robot is to give to another one beside what that one holds."""
    for giver in robots:
        for taker in robots:
            if giver is taker:
                continue
            held = [entry for entry in taker["takes"] if entry["robot"] == giver["robot"]]
            declared = [flow for flow in giver["gives"] if taker["robot"] in flow["to"]]
            yield {
                "from": giver["robot"],
                "to": taker["robot"],
                "everything": not giver["declares"],
                "declared": _joined(declared),
                "held": _joined(held),
                "read": taker["read"],
            }


def _joined(entries: Iterable[Mapping[str, Any]]) -> list[str]:
    listed = list(entries)
    topics = [name for entry in listed for name in entry["topics"]]
    services = [f"{name} (service)" for entry in listed for name in entry["services"]]
    return [plain(name) for name in (*topics, *services)]


def not_judged(rows: Iterable[Mapping[str, Any]]) -> list[tuple[str, str, int]]:
    """Count what was left out, by check and reason."""
    found: dict[tuple[str, str], int] = {}
    for row in rows:
        if row["verdict"] == UNKNOWN:
            key = TITLES[row["check"]], plain_data(row["found"], 200)
            found[key] = found.get(key, 0) + 1
    return [(*key, number) for key, number in list(found.items())[:PAIRS]]
