# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The report as one HTML page without other files. Its template is page.html.j2, in this folder. Pure: text out.

The template escapes each text from the network.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from ..._base.plain_text import LINE, LONGEST, plain, plain_data
from ..._base.sentences import join_causes
from ..._plan.model import FleetPlan
from ..checks.engine import FAILED, OK, UNKNOWN, WARNING
from ..checks.table import TITLES
from ..diagnose.explanation import list_lines
from .arrows import draw_arrows
from .hops import draw_way
from .matrices import Matrices
from .nodes import HEADINGS as NODE_HEADINGS
from .nodes import describe_nodes, list_cells
from .picture import SIGNS, draw_fleet, list_robots
from .traffic import HEADINGS, describe_measurement, list_dearest

TEMPLATE = Path(__file__).with_name("page.html.j2")  # the doors read it
ROWS = 20  # results that are listed below a finding
FINDINGS = 50
PAIRS = 100  # pairs of robots whose data flow is listed
NAMES = 12  # names in a cell; with more it is folded
LISTED = 40  # names in a folded cell
HUNG = 12  # robots in the small picture above the findings
WORDS = {OK: "ok", FAILED: "failed", WARNING: "warning", UNKNOWN: "not judged"}
SHORT = {OK: "o", FAILED: "f", WARNING: "w", UNKNOWN: "u"}  # classes of cells: there are many


def make_page(template: str, fleet: FleetPlan, document: Mapping[str, Any], matrices: Matrices) -> str:
    """Return the page. The document also has `file`, and `since` and `differences` of the run before, which may be empty."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    findings = [_shorten(entry) for entry in document["findings"][:FINDINGS]]
    empty: dict[str, Any] = {"rows": [], "robots": [], "findings": [], "unexplained": []}
    unseen = find_unseen(fleet, document["rows"])
    picture = draw_fleet(fleet, findings, unseen)
    read = {entry["robot"] for entry in document["robots"] if entry["read"]}
    return environment.from_string(template).render(
        document=plain_data({**document, **empty}, LINE),
        findings=findings,
        left_out=len(document["findings"]) - len(findings),
        unexplained=_rows(document["unexplained"]),
        hanging=plain_data(
            [entry._asdict() for entry in list_robots(fleet, document["findings"], document["computers"])], LINE
        ),
        hung=HUNG,
        picture=Markup(picture),  # noqa: S704  # its texts are escaped there
        arrows=Markup(draw_arrows(list(fleet.master_of), unseen, read)),  # noqa: S704  # so are these
        own=matrices.computer_matrix(),
        matrices=matrices.tables(),
        single=matrices.single,
        measured=matrices.measured,
        robots=len(document["robots"]),
        flows=list(islice(list_flows(document["robots"]), PAIRS)),
        headings=HEADINGS,
        nodes=describe_nodes(document["nodes"]),
        node_headings=NODE_HEADINGS,
        odd_nodes=plain_data(list(list_cells(document["nodes"])), LINE),
        remarks=plain_data(document.get("remarks", []), LINE),
        dearest=plain_data(list_dearest(document["traffic"]), LINE),
        measurement=describe_measurement(document["traffic"]),
        not_judged=count_unknown(document["rows"]),
        absent=[name for name in fleet.computers if name not in set(document["computers"])],
        signs=SIGNS,
        words=WORDS,
        short=SHORT,
        titles=TITLES,
        names=NAMES,
        listed=LISTED,
    )


def _shorten(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return a finding with the first of its rows, and its ways as pictures."""
    components = plain_data({**entry, "seen": (), "follows": (), "ways": (), "because": {}}, LINE)
    why = [(label, plain(text, LINE)) for label, text in list_lines(entry)]
    drawn = [Markup(draw_way(way)) for way in entry["ways"]]  # noqa: S704  # its texts are escaped there
    causes = join_causes([cause["sentence"] for cause in (components, *components["rivals"])])
    rows = {"seen": _rows(entry["seen"]), "follows": _rows(entry["follows"])}
    return {**components, **rows, "causes": causes, "ways": drawn, "why": why}


def _rows(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {"first": plain_data(rows[:ROWS], LONGEST), "number": len(rows)}


def find_unseen(fleet: FleetPlan, rows: Iterable[Mapping[str, Any]]) -> dict[str, list[str]]:
    """Return the robots that a robot does not discover, by robot."""
    robots = {master.computer: master.robot for master in fleet.masters}
    unseen: dict[str, list[str]] = {}
    for row in rows:
        one, other = robots.get(row["observer"]), robots.get(row["target"])
        if row["check"] == "list_masters" and row["verdict"] == FAILED and one and other and one != other:
            unseen.setdefault(one, []).append(other)
    return unseen


def list_flows(robots: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield for each two robots the names that flow between them: as declared, and as registered there."""
    for giver in robots:
        for taker in robots:
            if giver is taker:
                continue
            imports = [entry for entry in taker["takes"] if entry["robot"] == giver["robot"]]
            declared = [flow for flow in giver["gives"] if taker["robot"] in flow["to"]]
            yield {
                "from": giver["robot"],
                "to": taker["robot"],
                "everything": not giver["declares"],
                "declared": _list_names(declared),
                "held": _list_names(imports),
                "read": taker["read"],
            }


def _list_names(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    topics = [_name_with_change(entry, name) for entry in entries for name in entry["topics"]]
    services = [f"{_name_with_change(entry, name)} (service)" for entry in entries for name in entry["services"]]
    return [plain(name) for name in (*topics, *services)]


def _name_with_change(entry: Mapping[str, Any], name: str) -> str:
    """Return a name with the changes by a relay: its other name, and the rate."""
    change = entry.get("changed", {}).get(name)
    return f"{name} ({change})" if change else name


def count_unknown(rows: Iterable[Mapping[str, Any]]) -> list[tuple[str, str, int]]:
    """Count the rows that were not judged, by title of the check and reason."""
    unknown = [row for row in rows if row["verdict"] == UNKNOWN]
    counts = Counter((TITLES[row["check"]], plain_data(row["found"], 200)) for row in unknown)
    return [(*key, number) for key, number in islice(counts.items(), PAIRS)]
