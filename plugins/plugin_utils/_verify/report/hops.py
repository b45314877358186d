# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The way of followed packets as a picture: a column for each computer, a row for each step, a cross where they end. Pure.

A way is an entry of `findings[].ways` in the data of the report. Its texts are words of other computers: they are made plain, cut and escaped.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any
from xml.sax.saxutils import escape

from ..._base.plain_text import plain
from ..checks.engine import FAILED
from .picture import SIGNS, shorten, write_svg

COLUMN, LEAST = 96, 300  # the width of a column, and of a picture
ROW, BOX, LINE, EDGE = 48, 40, 15, 6  # heights and distances
LETTER, NAME = 6.4, 7.3  # the width of a letter, and of a letter of a name
ARM = 7  # half of the cross
WORDS = 500  # letters about the end
SMALLEST = 0.8  # a narrow window may shrink a picture so far; then it is scrolled

STYLE = """
.way text { font: 11px system-ui, sans-serif; fill: var(--ink, #1b1f24); text-anchor: middle }
.way text { paint-order: stroke; stroke: var(--paper, #fff); stroke-width: 3px }
.way .who { font-size: 12px; font-weight: 700; stroke: none }
.way .soft { fill: var(--soft, #57606a) }
.way .box { fill: var(--pale, #f6f8fa); stroke: var(--ink, #1b1f24) }
.way .missed { stroke: var(--soft, #57606a); stroke-dasharray: 6 3 }
.way .life { stroke: var(--soft, #57606a); stroke-dasharray: 1 4 }
.way .hop { stroke: var(--bar, #0969da); stroke-width: 2 }
.way .head { fill: var(--bar, #0969da) }
.way .lost { stroke: var(--failed, #b42318); stroke-dasharray: 6 4 }
.way .cross { stroke: var(--failed, #b42318); stroke-width: 4; stroke-linecap: round }
.way .end { fill: var(--failed, #b42318); text-anchor: start }
""".strip()


def draw_way(way: Mapping[str, Any]) -> str:
    """Draw a way. It fits a narrow window as long as its letters can be read."""
    drawn = _Sheet(way)
    svg = write_svg(drawn.width, drawn.y, "img", "; ".join([*drawn.spoken, drawn.words]), STYLE, drawn.list_elements())
    return f'<div class="way" style="width:{drawn.width}px;max-width:100%;min-width:{drawn.width * SMALLEST:.0f}px">{svg}</div>'


def list_columns(way: Mapping[str, Any]) -> list[str]:
    """List the computers from the left to the right: those that sent the packets, the planned ones, and the target."""
    *planned, target = way["computers"]
    seen = [name for hop in way["hops"] for name in (hop["sender"], hop["receiver"]) if name]
    return [*(name for name in dict.fromkeys([*planned[:1], *seen, *planned]) if name != target), target]


class _Sheet:
    """The elements of a picture; `y` is how far they reach, and `spoken` the same in words."""

    def __init__(self, way: Mapping[str, Any]) -> None:
        names = list_columns(way)
        self.words = plain(way["words"], WORDS)
        self.width = max(LEAST, COLUMN * len(names))
        self.step = self.width / len(names)
        self.x = {name: self.step * (number + 0.5) for number, name in enumerate(names)}
        self.reached = {names[0], way["at"]}
        self.rows: list[str] = []
        self.spoken: list[str] = []
        self.most = int((self.width - 2 * EDGE) / LETTER)  # letters of a line
        self.y = BOX + 2 * EDGE
        for hop in way["hops"]:
            self._draw_hop(hop)
        last = way["hops"][-1] if way["hops"] else None
        if last is None or last["arrived"]:  # they end in a computer
            self._cross(self.x.get(way["at"], self.x[last["receiver"] if last else names[0]]), self.y + ARM + EDGE)
            self.y += 2 * (ARM + EDGE)
        self.bottom = self.y
        for line in textwrap.wrap(f"{SIGNS[FAILED]} {self.words}", self.most, break_on_hyphens=False):
            self.y += LINE
            self.rows.append(f'<text class="end" x="{EDGE}" y="{self.y}">{escape(line)}</text>')
        self.y += EDGE

    def list_elements(self) -> Iterator[str]:
        """Yield all elements, the first one at the back."""
        for x in self.x.values():
            yield f'<line class="life" x1="{x:.1f}" y1="{BOX + EDGE}" x2="{x:.1f}" y2="{self.bottom}"/>'
        yield from self.rows
        for name, x in self.x.items():
            kind = "box" if name in self.reached else "box missed"
            lines = textwrap.wrap(plain(name), int((self.step - 2 * EDGE) / NAME), max_lines=2, placeholder="\u2026")
            top = EDGE + BOX / 2 + 4 - LINE / 2 * (len(lines) - 1)
            texts = (
                f'<text class="who" x="{x:.1f}" y="{top + LINE * n:.1f}">{escape(line)}</text>'
                for n, line in enumerate(lines)
            )
            yield (
                f'<g><title>{escape(plain(name))}</title><rect class="{kind}" x="{x - self.step / 2 + 4:.1f}" y="{EDGE}" '
                f'width="{self.step - 8:.1f}" height="{BOX}" rx="4"/>{"".join(texts)}</g>'
            )

    def _draw_hop(self, hop: Mapping[str, Any]) -> None:
        """Draw a step as an arrow; one that no computer saw come in as a broken line with the cross."""
        begin, y = self.x[hop["sender"]], self.y + 22
        ahead = -self.step / 2 if hop["answer"] else self.step / 2
        end = self.x.get(hop["receiver"], begin + ahead)
        self.reached |= {hop["sender"], hop["receiver"] if hop["arrived"] else hop["sender"]}
        came = f"; in {shorten(hop['came'])}" if hop["arrived"] else ""
        seen = f"{'answer ' if hop['answer'] else ''}out {shorten(hop['left'])}, TTL {hop['ttl']}{came}"
        to = f"to {shorten(hop['target_mac'])}" if hop["target_mac"] else ""
        where = " in ".join(filter(None, (to, plain(hop["network"]))))
        words = f"{plain(hop['sender'])} to {plain(hop['receiver']) or 'an unknown computer'}: {seen}; {where}"
        self.spoken.append(words)
        kind = "hop" if hop["arrived"] else "hop lost"
        self.rows.append(
            f'<g><title>{escape(words)}</title><line class="{kind}" x1="{begin:.1f}" y1="{y}" x2="{end:.1f}" y2="{y}"/></g>'
        )
        if hop["arrived"]:
            back = 9 if end < begin else -9
            self.rows.append(
                f'<polygon class="head" points="{end:.1f},{y} {end + back:.1f},{y - 5} {end + back:.1f},{y + 5}"/>'
            )
        else:
            self._cross((begin + end) / 2, y)
        self._text((begin + end) / 2, y - 10, seen, "")
        self._text((begin + end) / 2, y + 18, where, "soft")
        self.y += ROW

    def _cross(self, x: float, y: int) -> None:
        arms = f"M{x - ARM:.1f},{y - ARM} l{2 * ARM},{2 * ARM} m0,{-2 * ARM} l{-2 * ARM},{2 * ARM}"
        self.rows.append(f'<path class="cross" d="{arms}"/>')

    def _text(self, x: float, y: int, text: str, kind: str) -> None:
        """Write a text in the middle of its arrow, and within the picture."""
        shown = shorten(text, self.most)
        half = min(len(shown) * LETTER / 2 + EDGE, self.width / 2)
        self.rows.append(
            f'<text class="{kind}" x="{min(max(x, half), self.width - half):.1f}" y="{y}">{escape(shown)}</text>'
        )
