# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The picture of discovery: robots on a circle, and an arrow from each robot to each robot that it is to discover. Pure.

A point is a complex number: x and y, which grows downwards. Multiplied by 1j it is turned by a right angle.
A fleet of more than MOST robots has no such picture: its matrix `Masters` says the same.
"""

from __future__ import annotations

import cmath
from collections.abc import Collection, Mapping, Sequence
from math import pi
from xml.sax.saxutils import escape

from ..._base.plain_text import plain
from ..checks.engine import FAILED, OK, UNKNOWN
from .picture import SIGNS, shorten, write_svg

MOST = 8  # robots: more arrows are not readable
LETTER, SHOWN = 7.3, 20  # the width of a letter; letters of a name that are shown
HIGH = 26  # of a box
BEND = 0.12  # how far an arrow leaves the straight line, to leave room for the arrow back
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


def draw_arrows(robots: Sequence[str], unseen: Mapping[str, Sequence[str]], read: Collection[str]) -> str:
    """Draw the picture, if there are few robots. `unseen` has the robots that a robot does not discover; `read` are the robots that were asked."""
    if not 2 <= len(robots) <= MOST:
        return ""
    names = {robot: shorten(robot, SHOWN) for robot in robots}
    wide = round(max(map(len, names.values())) * LETTER) + 20
    radius = max(110, round(len(robots) * (HIGH + wide) / 5))
    width, height = 2 * radius + wide + 20, 2 * radius + HIGH + 20
    middle = complex(width / 2, height / 2)
    turns = {robot: number / len(robots) - 1 / 4 for number, robot in enumerate(robots)}  # the first one is at the top
    at = {robot: middle + cmath.rect(radius, 2 * pi * turn) for robot, turn in turns.items()}
    verdicts = {
        (robot, other): FAILED if other in unseen.get(robot, ()) else OK if robot in read else UNKNOWN
        for robot in robots
        for other in robots
        if other != robot
    }
    lines = [
        _arrow(*pair, at[pair[0]], at[pair[1]], wide / 2, verdict)
        for kind in (OK, UNKNOWN, FAILED)  # the worst is on top
        for pair, verdict in verdicts.items()
        if verdict == kind
    ]
    boxes = [_box(robot, names[robot], at[robot], wide) for robot in robots]
    return write_svg(width, height, "img", f"Who discovers whom: {len(robots)} robots", STYLE, [*lines, *boxes])


def _box(robot: str, name: str, middle: complex, wide: int) -> str:
    x, y = middle.real, middle.imag
    return (
        f'<g><title>{escape(plain(robot))}</title><rect class="box" x="{x - wide / 2:.1f}" y="{y - HIGH / 2:.1f}" '
        f'width="{wide}" height="{HIGH}" rx="4"/><text class="who" x="{x:.1f}" y="{y + 4:.1f}">{escape(name)}</text></g>'
    )


def _arrow(robot: str, other: str, begin: complex, end: complex, half: float, verdict: str) -> str:
    """Draw the arrow from a robot to an other, bent to its own side."""
    bend = (begin + end) / 2 + (end - begin) * 1j * BEND
    begin, end = _edge(begin, bend, half), _edge(end, bend, half)
    along = (end - bend) / (abs(end - bend) or 1.0) * HEAD
    head = " ".join(map(_write, (end, end - along - along * 0.5j, end - along + along * 0.5j)))
    kind = "" if verdict == OK else f" {verdict}"
    verb = {OK: "discovers", FAILED: "does not discover", UNKNOWN: "was not asked whether it discovers"}[verdict]
    title = f"{plain(robot)} {verb} {plain(other)}"
    sign = ""
    if verdict != OK:
        middle = (begin + 2 * bend + end) / 4
        sign = f'<text class="sign {verdict}" x="{middle.real:.1f}" y="{middle.imag + 4:.1f}">{SIGNS[verdict]}</text>'
    return (
        f"<g><title>{escape(title)}</title>"
        f'<path class="arrow{kind}" d="M{_write(begin)} Q{_write(bend)} {_write(end)}"/>'
        f'<polygon class="head{kind}" points="{head}"/>{sign}</g>'
    )


def _write(point: complex) -> str:
    return f"{point.real:.1f},{point.imag:.1f}"


def _edge(middle: complex, towards: complex, half: float) -> complex:
    """Return the point where the line to `towards` leaves a box."""
    way = towards - middle
    return middle + way * min(
        half / abs(way.real) if way.real else 1e9, HIGH / 2 / abs(way.imag) if way.imag else 1e9, 1.0
    )
