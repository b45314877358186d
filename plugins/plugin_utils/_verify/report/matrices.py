# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Matrices: one for each kind of result, from each computer to each other one. Rows of the verification in, cells out. Pure.

In a fleet with many computers a cell is for two robots. It has the worst result of all pairs between them.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import log2
from typing import NamedTuple

from ..._base.plain_text import plain
from ..._plan.model import FleetPlan
from ..checks.engine import FAILED, OK, UNKNOWN, WARNING, Passed, Row
from ..checks.table import TITLES

MOST = 40  # computers: beyond, a cell is for two robots
SHOWN = 120  # letters of a result
RESULTS = 6  # results that a cell keeps
ROOM = 1_200_000  # letters of all results: a page stays below 5 MB
WORST = {FAILED: 0, WARNING: 1, UNKNOWN: 2, OK: 3}
ITSELF, OTHERS = "itself", "others"


class MatrixKind(NamedTuple):
    """A matrix: its title, its caption, and the checks whose results it shows."""

    id: str
    title: str
    caption: str
    checks: tuple[str, ...]


KINDS = (
    MatrixKind("names", "Names", "The address of each name there.", ("name", "user_name")),
    MatrixKind(
        "pings",
        "Pings and ways",
        "ICMP echo by address, by name and with large packets, with the time of an answer; the way there.",
        ("ping_address", "ping_name", "ping_large", "ping_loss", "route", "neighbour", "answers_arp"),
    ),
    MatrixKind(
        "udp",
        "UDP",
        "Datagrams of discovery, by multicast and by unicast, with their number or their loss.",
        ("udp_multicast", "udp_unicast", "source", "icmp_rounds"),
    ),
    MatrixKind(
        "tcp",
        "TCP",
        "Connections: to discovery nodes, and to publishers.",
        ("rpc_port", "direct_connection", "tcp_answer", "master_route"),
    ),
    MatrixKind(
        "throughput", "Throughput", "Mbit/s of a short stream, one at a time; the darker, the faster.", ("throughput",)
    ),
    MatrixKind("clocks", "Clocks", "How far the clocks are apart.", ("clock",)),
    MatrixKind("masters", "Masters", "The masters that each lists.", ("list_masters",)),
    MatrixKind("topics", "Topics", "A subscriber hears a talker.", ("topic_heard",)),
    MatrixKind(
        "exchange",
        "Exchange of topics and services",
        "The registrations at the other roscore, compared with the planned ones.",
        ("flow", "names", "types", "copies", "cross_link"),
    ),
)
_KIND_OF = {check: kind.id for kind in KINDS for check in kind.checks}
_MEASURED = {"ping_address", "udp_multicast", "rpc_port", "clock"}  # their result is a number
_STREAM, _MBIT_S = "throughput", re.compile(r"(\d+(?:\.\d+)?) Mbit/s$")  # its cells have the number itself, and a shade
SHADES = 5


@dataclass
class Cell:
    """The results of a pair: the number of each verdict, a short text, and the first results as text."""

    counts: Counter[str] = field(default_factory=Counter)
    text: str = ""
    results: list[str] = field(default_factory=list)
    least: float | None = None  # the slowest stream, in Mbit/s
    shade: int = 0  # of 1 to SHADES, if there is one

    @property
    def verdict(self) -> str:
        """The worst of all."""
        return min(self.counts, key=WORST.__getitem__)

    def add(self, row: Row, result: str) -> None:
        """Count a row, and keep its result as text."""
        self.counts[row.verdict] += 1
        if result and len(self.results) < RESULTS:
            self.results.append(result)


@dataclass
class Matrix:
    """A matrix that has results."""

    kind: MatrixKind
    observers: tuple[str, ...]
    targets: tuple[str, ...]
    cells: Mapping[tuple[str, str], Cell]


class Matrices:
    """All cells of some rows. `passed` counts good results without a row."""

    def __init__(self, fleet: FleetPlan, rows: Iterable[Row], passed: Passed | None = None) -> None:
        self.single = len(fleet.computers) <= MOST
        self.robots = {name: plan.robot or name for name, plan in fleet.computers.items()}
        self.order = tuple(fleet.computers if self.single else dict.fromkeys(self.robots.values()))
        self.room = ROOM
        self.measured = 0  # number of streams
        self._cells: dict[str, dict[tuple[str, str], Cell]] = defaultdict(lambda: defaultdict(Cell))
        for row in rows:
            self._add(row)
        for (own, its, checks), pairs in (passed or {}).items():
            for check in checks:
                self._cells[_KIND_OF.get(check, OTHERS)][own, its].counts[OK] += pairs

    def _add(self, row: Row) -> None:
        kind = _KIND_OF.get(row.check) or (ITSELF if row.observer == row.target else OTHERS)
        if kind == ITSELF:
            cell = self._cells[ITSELF][row.observer, TITLES[row.check]]
        else:
            cell = self._cells[kind][(row.observer, row.target) if self.single else self._robot_pair(row)]
        cell.add(row, self._describe(row) if self.single or row.verdict != OK else "")
        if self.single and row.check in _MEASURED and row.verdict == OK:
            cell.text = plain(row.found, 12)
        if row.check == _STREAM and (number := _MBIT_S.match(row.found)):
            mbit_s = float(number[1])
            cell.least = mbit_s if cell.least is None else min(cell.least, mbit_s)
            cell.text = f"{cell.least:.3g}"
            self.measured += 1

    def _robot_pair(self, row: Row) -> tuple[str, str]:
        return self.robots.get(row.observer, row.observer), self.robots.get(row.target, row.target)

    def _describe(self, row: Row) -> str:
        """Return a result as text; empty if the room is used up."""
        if self.room <= 0:
            return ""
        pair = "" if self.single or row.observer == row.target else f"{row.observer} to {row.target}: "
        expected = "" if row.verdict == OK else f", expected {plain(row.expected, SHOWN)}"
        text = f"{pair}{TITLES[row.check]}: {plain(row.found, SHOWN)}{expected}"
        self.room -= len(text)
        return text

    def tables(self) -> list[Matrix]:
        """Return the matrices that have results, in the order of KINDS."""
        _shade(self._cells[_STREAM].values() if _STREAM in self._cells else ())
        known = (*KINDS, MatrixKind(OTHERS, "Other results between two", "", ()))
        return [self._matrix(kind, self.order) for kind in known if kind.id in self._cells]

    def computer_matrix(self) -> Matrix:
        """Return the matrix of the results about one computer each: computers and checks."""
        checks = [title for title in TITLES.values() if any(key[1] == title for key in self._cells[ITSELF])]
        return self._matrix(MatrixKind(ITSELF, "Computers", "The checks of each computer itself.", ()), checks)

    def _matrix(self, kind: MatrixKind, targets: Sequence[str]) -> Matrix:
        cells = self._cells[kind.id]
        observers = {key[0] for key in cells}
        seen = {key[1] for key in cells}
        order = tuple(self.robots) if kind.id == ITSELF else self.order
        return Matrix(
            kind,
            tuple(name for name in order if name in observers),
            tuple(name for name in targets if name in seen),
            dict(cells),
        )


def _shade(cells: Iterable[Cell]) -> None:
    """Shade streams by their order of magnitude below the fastest one: half as fast is one shade less."""
    known = [cell for cell in cells if cell.least]
    fastest = max((cell.least or 0.0 for cell in known), default=0.0)
    for cell in known:
        cell.shade = max(1, SHADES - int(log2(fastest / (cell.least or fastest))))
