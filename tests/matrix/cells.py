# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The cells of the matrix: what is kept of them, and their table in docs/start/machines.md. Pure, but for the two files."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

PAGE = Path(__file__).resolve().parents[2] / "docs" / "start" / "machines.md"
BEGIN, END = "<!-- matrix: written by `make test-matrix` -->", "<!-- end of matrix -->"
OK, UNTRIED = "works", "not tried"
_CONDA = "/opt/miniforge3/envs/ros"


@dataclass(frozen=True)
class Robots:
    """The robots of a column."""

    title: str
    suite: str = "bookworm"
    shape: str = ""  # what make-opt-ros makes of Debian's ROS
    variables: Mapping[str, str] = field(default_factory=dict)  # what their inventory says then


ROBOTS = {
    "bullseye": Robots("Debian 11", "bullseye"),
    "bookworm": Robots("Debian 12"),
    "trixie": Robots("Debian 13", "trixie"),
    "one": Robots("ROS One (shaped)", shape="one"),
    "noetic": Robots("Noetic below /opt (shaped)", shape="noetic"),
    "conda": Robots("RoboStack (shaped)", shape=f"--conda {_CONDA}", variables={"multimaster_ros_setup": _CONDA}),
}

Row = dict[str, str]  # version, python, and the end of each column
Kept = dict[str, Row]  # line of ansible-core -> its row

_RECAP = re.compile(r"^[\w.-]+ +: ok=\d+ +changed=(\d+) ", re.MULTILINE)


def find_problem(status: int, output: str, *, unchanged: bool = False) -> str:
    """Return what is wrong with the end of a playbook, or an empty text."""
    changed = sum(map(int, _RECAP.findall(output)))
    if status:
        return f"ends with {status}"
    if not _RECAP.search(output):
        return "ran on no computer"
    return f"changes {changed} things" if unchanged and changed else ""


def read(path: Path) -> Kept:
    """Return what is kept of earlier runs."""
    kept: Kept = json.loads(path.read_text()) if path.exists() else {}
    return kept


def write(path: Path, kept: Kept) -> None:
    """Keep the ends for later runs."""
    path.write_text(json.dumps(kept, indent=1) + "\n")


def note(kept: Kept, line: str, version: str, python: str, robots: str, end: str) -> None:
    """Note the end of a cell. Cells of another version of the same line are forgotten."""
    row = kept.get(line, {})
    kept[line] = {**(row if row.get("version") == version else {}), "version": version, "python": python, robots: end}


def table(lines: Sequence[str], kept: Mapping[str, Row]) -> str:
    """Return a row for each version of ansible-core, and a column for each kind of robots."""
    head = ["ansible-core", "its Python", *(robots.title for robots in ROBOTS.values())]
    rows = [head, ["---"] * len(head)]
    for line in lines:
        row = kept.get(line, {})
        ends = [row.get(name, UNTRIED) for name in ROBOTS]
        rows.append([row.get("version", line), row.get("python", ""), *ends])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def fill(text: str, content: str) -> str:
    """Return the page with the table between its marks."""
    before, begin, rest = text.partition(BEGIN)
    _old, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{PAGE.name} has no pair of lines {BEGIN} and {END}; restore them.")
    return f"{before}{BEGIN}\n\n{content}\n\n{END}{after}"
