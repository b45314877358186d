# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The figures of the network: what is asked for, and the table. Pure."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

Samples = Sequence[float]
Found = Mapping[str, Mapping[str, Samples]]  # system -> measurement -> samples


def share(per_cent: float) -> Callable[[Samples], float]:
    """The value below which so many per cent of the samples are (nearest rank)."""
    return lambda samples: sorted(samples)[max(0, math.ceil(len(samples) * per_cent / 100) - 1)]


STATISTICS: Mapping[str, Callable[[Samples], float]] = {
    "median": statistics.median,
    "p99": share(99),
    "worst": max,
}
#: unit -> factor, digits
UNITS = {"ms": (1000.0, 1), "s": (1.0, 2), "kB": (0.001, 1), "MB": (1e-6, 1), "%": (100.0, 2)}


class Figure(NamedTuple):
    """One row: what was measured, and how much it may be."""

    text: str
    measurement: str
    statistic: str
    unit: str
    limits: Mapping[str, float] = {}  # system -> at most, in the unit


FIGURES = (
    Figure("new publisher -> registered on the other roscore", "new", "median", "ms", {"managed": 10, "existing": 60}),
    Figure("", "new", "p99", "ms", {"managed": 50, "existing": 200}),
    Figure("", "new", "worst", "ms"),
    Figure("the same with 3,000 topics", "new_full", "median", "ms", {"managed": 15}),
    Figure("", "new_full", "p99", "ms", {"managed": 60}),
    Figure("the same with 30 % of UDP lost", "new_udp", "p99", "s", {"managed": 1}),
    Figure("the same with 30 % of all packets lost", "new_all", "median", "s"),
    Figure("", "new_all", "p99", "s"),
    Figure("publisher created -> first message on the other robot", "first", "median", "ms", {"managed": 50}),
    Figure("", "first", "worst", "ms"),
    Figure("clean stop -> gone elsewhere", "gone", "median", "ms"),
    Figure("", "gone", "p99", "ms", {"managed": 100}),
    Figure("robot without power -> gone elsewhere", "lost", "worst", "s", {"managed": 5}),
    Figure("robot back -> messages flow", "back", "worst", "s", {"managed": 2}),
    Figure("one new topic at 3,000 topics, both directions", "bytes", "median", "kB", {"managed": 4}),
    Figure("3,000 topics at once -> all are there", "fill", "median", "s"),
    Figure("20 robots of 100 topics, links open at once -> all see all", "meet", "median", "s", {"managed": 5}),
    Figure("", "meet", "worst", "s", {"managed": 5}),
    Figure("CPU idle, nodes and what they cause in the roscore", "cpu", "median", "%", {"managed": 0.5}),
    Figure("the same with 3,000 topics", "cpu_full", "median", "%", {"managed": 1}),
    Figure("memory of both nodes and the roscore", "memory", "median", "MB"),
    Figure("the same with 3,000 topics", "memory_full", "median", "MB"),
)
#: of the same robot: at most what upstream's takes
NOT_ABOVE_UPSTREAM = ("memory", "memory_full")


class Cell(NamedTuple):
    """One value, in its unit; `limit` is None where nothing is asked for."""

    value: float
    samples: int
    limit: float | None

    @property
    def good(self) -> bool:
        """True where it is as asked for."""
        return self.limit is None or self.value <= self.limit


def cell(figure: Figure, system: str, found: Found) -> Cell | None:
    """The value of a figure; None where it was not measured."""
    samples = found[system].get(figure.measurement)
    if not samples:
        return None
    factor, _digits = UNITS[figure.unit]
    limit = figure.limits.get(system)
    others = found.get("upstream", {}).get(figure.measurement)
    if system == "managed" and figure.measurement in NOT_ABOVE_UPSTREAM and others:
        limit = STATISTICS[figure.statistic](others) * factor
    return Cell(STATISTICS[figure.statistic](samples) * factor, len(samples), limit)


def merged(before: Mapping[str, Any], now: Mapping[str, Any], titles: Mapping[str, str]) -> dict[str, Any]:
    """A report with what an earlier one has of other systems; each system has the machine of its own run.

    `titles`: of all systems, in their order.
    """
    kept = {name: samples for name, samples in before.get("systems", {}).items() if name not in now["systems"]}
    machines = {name: before.get("machines", {}).get(name) or before.get("machine", {}) for name in kept}
    systems, machines = {**kept, **now["systems"]}, {**machines, **now["machines"]}
    order = [name for name in titles if name in systems]
    return {
        "machines": {name: machines[name] for name in order},
        "titles": {name: titles[name] for name in order},
        "systems": {name: systems[name] for name in order},
        "crowd": now.get("crowd") or before.get("crowd", []),
    }


def missed(found: Found) -> list[str]:
    """The figures that fall short, in words."""
    lines, text = [], ""
    for figure in FIGURES:
        text = figure.text or text
        for system in found:
            value = cell(figure, system, found)
            if value is not None and not value.good:
                lines.append(
                    f"{text}, {figure.statistic}, {system}: {written(value.value, figure.unit)},"
                    f" at most {written(value.limit or 0.0, figure.unit)} asked for"
                )
    return lines


def written(value: float, unit: str) -> str:
    """A value with its unit; a second and more in seconds."""
    if unit == "ms" and value >= 1000:
        value, unit = value / 1000, "s"
    return f"{value:,.{UNITS[unit][1]}f} {unit}"


def table(found: Found, titles: Mapping[str, str]) -> str:
    """All figures as a table of Markdown: a column per system; what falls short is marked."""
    rows = [["figure", "", *(titles[system] for system in found), "at most"], ["---"] * (len(found) + 3)]
    rows += [list(row) for row in _rows(found)]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _rows(found: Found) -> Iterator[list[str]]:
    for figure in FIGURES:
        cells = [cell(figure, system, found) for system in found]
        if not any(cells):
            continue
        limits = [
            f"{written(value.limit, figure.unit)} ({system})"
            for system, value in zip(found, cells, strict=True)
            if value is not None and value.limit is not None
        ]
        shown = ["" if value is None else _shown(value, figure.unit) for value in cells]
        yield [figure.text, figure.statistic if _many(cells) else "", *shown, ", ".join(limits)]


def _many(cells: Sequence[Cell | None]) -> bool:
    return any(value is not None and value.samples > 1 for value in cells)


def _shown(value: Cell, unit: str) -> str:
    return written(value.value, unit) if value.good else f"**{written(value.value, unit)}**"


def crowd_table(rows: Sequence[Mapping[str, float]]) -> str:
    """The costs of one robot beside many simulated masters, as a table of Markdown; nothing where it was not measured."""
    if not rows:
        return ""
    lines = [
        "| masters | all topics are there after | CPU of both nodes | memory of both nodes | packets per master and second |\n"
    ]
    lines.append("| --- | --- | --- | --- | --- |\n")
    for row in rows:
        cells = [f"{row['masters']:.0f}", written(row["there"], "s"), written(100 * row["cpu"], "%")]
        cells += [written(row["memory"] / 1e6, "MB"), f"{row['packets']:.1f}"]
        lines.append(f"| {' | '.join(cells)} |\n")
    return "".join(lines)
