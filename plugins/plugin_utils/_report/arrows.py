# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The picture of discovery: robots on a circle, and an arrow from each robot to each robot that it is to discover. Pure.

A fleet of more than MOST robots has no such picture: its matrix `Masters` says the same.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from math import cos, hypot, pi, sin
from xml.sax.saxutils import escape, quoteattr

from .._checks.engine import FAILED, OK, UNKNOWN
from .._fleet.plain_text import plain
from .picture import SIGNS, shorten

MOST = 8  # robots: more arrows are not readable
LETTER, SHOWN = 7.3, 20  # the width of a letter; letters of a name that are shown
HIGH = 26  # of a box
BEND = 0.12  # how far an arrow leaves the straight line, to be beside the arrow back
HEAD = 9  # the length of the head of an arrow

STYLE = """
.arrow { stroke: var(--bar, #0969da); stroke-width: 1.5; fill: none }
.head { fill: var(--bar, #0969da) }
.arrow.failed { stroke: var(--failed, #b42318); stroke-width: 2.5; stroke-dasharray: 7 4 }
.head.failed, .sign.failed { fill: var(--failed, #b42318) }
.arrow.unknown { stroke: var(--soft, #57606a); stroke-dasharray: 2 4 }
.head.unknown { fill: var(--soft, #57606a) }
.sign { fill: var(--soft, #57606a); font-weight: 700; text-anchor: middle }
.who { text-anchor: middle }
""".strip()

Point = tuple[float, float]


def draw_arrows(robots: Sequence[str], unseen: Mapping[str, Sequence[str]], read: Collection[str]) -> str:
    """Draw the picture, if there are few robots. `unseen` has the robots that a robot does not discover; `read` are the robots that were asked."""
    if not 2 <= len(robots) <= MOST:
        return ""
    names = {robot: shorten(robot, SHOWN) for robot in robots}
    wide = round(max(map(len, names.values())) * LETTER) + 20
    radius = max(110, round(len(robots) * (HIGH + wide) / 5))
    width, height = 2 * radius + wide + 20, 2 * radius + HIGH + 20
    middle = width / 2, height / 2
    at = {robot: _on_circle(middle, radius, number / len(robots)) for number, robot in enumerate(robots)}
    verdicts = {
        (robot, other): FAILED if other in unseen.get(robot, ()) else OK if robot in read else UNKNOWN
        for robot in robots
        for other in robots
        if other != robot
    }
    lines = [
        _arrow(*pair, at[pair[0]], at[pair[1]], wide / 2, verdict)
        for kind in (OK, UNKNOWN, FAILED)  # the worst lies above
        for pair, verdict in verdicts.items()
        if verdict == kind
    ]
    boxes = [_box(robot, names[robot], at[robot], wide) for robot in robots]
    title = quoteattr(f"Who discovers whom: {len(robots)} robots")
    begin = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" role="img"'
    return "\n".join([f"{begin} aria-label={title}>", f"<style>{STYLE}</style>", *lines, *boxes, "</svg>\n"])


def _box(robot: str, name: str, middle: Point, wide: int) -> str:
    x, y = middle
    return (
        f'<g><title>{escape(plain(robot))}</title><rect class="box" x="{x - wide / 2:.1f}" y="{y - HIGH / 2:.1f}" '
        f'width="{wide}" height="{HIGH}" rx="4"/><text class="who" x="{x:.1f}" y="{y + 4:.1f}">{escape(name)}</text></g>'
    )


def _on_circle(middle: Point, radius: float, share: float) -> Point:
    return middle[0] + radius * sin(2 * pi * share), middle[1] - radius * cos(2 * pi * share)


def _arrow(robot: str, other: str, begin: Point, end: Point, half: float, verdict: str) -> str:
    """Draw the arrow from a robot to an other, bent to its own side."""
    (x1, y1), (x2, y2) = begin, end
    bend_x, bend_y = (x1 + x2) / 2 - (y2 - y1) * BEND, (y1 + y2) / 2 + (x2 - x1) * BEND
    x1, y1 = _edge(begin, (bend_x, bend_y), half)
    x2, y2 = _edge(end, (bend_x, bend_y), half)
    length = hypot(x2 - bend_x, y2 - bend_y) or 1.0
    along_x, along_y = (x2 - bend_x) / length * HEAD, (y2 - bend_y) / length * HEAD
    head = f"{x2:.1f},{y2:.1f} {x2 - along_x + along_y / 2:.1f},{y2 - along_y - along_x / 2:.1f} "
    head += f"{x2 - along_x - along_y / 2:.1f},{y2 - along_y + along_x / 2:.1f}"
    kind = "" if verdict == OK else f" {verdict}"
    verb = {OK: "discovers", FAILED: "does not discover", UNKNOWN: "was not asked whether it discovers"}[verdict]
    title = f"{plain(robot)} {verb} {plain(other)}"
    parts = [
        f"<g><title>{escape(title)}</title>"
        f'<path class="arrow{kind}" d="M{x1:.1f},{y1:.1f} Q{bend_x:.1f},{bend_y:.1f} {x2:.1f},{y2:.1f}"/>'
        f'<polygon class="head{kind}" points="{head}"/>'
    ]
    if verdict != OK:
        middle = (x1 + 2 * bend_x + x2) / 4, (y1 + 2 * bend_y + y2) / 4
        parts.append(
            f'<text class="sign {verdict}" x="{middle[0]:.1f}" y="{middle[1] + 4:.1f}">{SIGNS[verdict]}</text>'
        )
    return "".join([*parts, "</g>"])


def _edge(middle: Point, towards: Point, half: float) -> Point:
    """Return the point where the line to `towards` leaves a box."""
    x, y = towards[0] - middle[0], towards[1] - middle[1]
    share = min(half / abs(x) if x else 1e9, HIGH / 2 / abs(y) if y else 1e9, 1.0)
    return middle[0] + x * share, middle[1] + y * share
