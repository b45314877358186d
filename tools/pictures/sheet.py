# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A sheet on which a picture for the pages is drawn, in the style of the report's pictures.

GitHub shows a picture as <img>: it sees no style of the page, so it has its own colours, for light and dark. It is as wide as
a telephone shows it in letters that can be read.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.sax.saxutils import escape

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report import picture

WIDTH = 440  # pixels: a telephone of 390 shows this at four fifths of its size
EDGE = 10  # the empty margin
LINE = 17  # height of a line of text
PAD = 10  # between the edge of a box and its text
HEAD = 8  # length of the head of an arrow

STYLE = """
:root { --ink: #1b1f24; --soft: #57606a; --paper: #fff; --pale: #f6f8fa; --bar: #0969da; --failed: #b42318; --warning: #8a5a00 }
@media (prefers-color-scheme: dark) { :root { --ink: #e6edf3; --soft: #9aa4af; --paper: #0d1117; --pale: #161b22; --bar: #58a6ff;
  --failed: #ff8b7e; --warning: #e3b341 } }
.sheet { fill: var(--paper, #fff) }
""".strip()
OWN_STYLE = """
text { font: 13px system-ui, sans-serif; fill: var(--ink, #1b1f24) }
.strong { font-weight: 700 }
.soft { fill: var(--soft, #57606a) }
.on { paint-order: stroke; stroke: var(--paper, #fff); stroke-width: 5px; stroke-linejoin: round }
.onpale { paint-order: stroke; stroke: var(--pale, #f6f8fa); stroke-width: 5px; stroke-linejoin: round }
.middle { text-anchor: middle }
.end { text-anchor: end }
.box { fill: var(--paper, #fff); stroke: var(--ink, #1b1f24); stroke-width: 1.2 }
.frame { fill: var(--pale, #f6f8fa); stroke: var(--soft, #57606a); stroke-dasharray: 2 3 }
.bar { fill: var(--bar, #0969da) }
.off { fill: none; stroke: var(--failed, #b42318); stroke-width: 1.5; stroke-dasharray: 5 4 }
.line { stroke: var(--bar, #0969da); stroke-width: 1.6; fill: none }
.data { stroke-width: 4 }
.life { stroke: var(--soft, #57606a); stroke-dasharray: 2 4 }
.head { fill: var(--bar, #0969da) }
""".strip()

_BEGIN = re.compile(r'role="\w+" aria-label="[^"]*">\n')
_NARROW, _WIDE = frozenset("iljftrI.,:;'|()[]/-* "), frozenset("mwMW@")


def measure(words: str, size: float = 13) -> float:
    """Return the width of a text in pixels, as a wide font draws it."""
    return sum(0.4 if letter in _NARROW else 0.95 if letter in _WIDE else 0.62 for letter in words) * size


def complete(svg: str, title: str, description: str) -> str:
    """Return a picture with its title and description for readers that hear it, its colours, and a ground."""
    head = f'role="img" aria-labelledby="title description">\n<title id="title">{escape(title)}</title>\n'
    head += f'<desc id="description">{escape(description)}</desc>\n<style>{STYLE}</style>\n'
    ground = '</style>\n<rect class="sheet" width="100%" height="100%" rx="6"/>'
    begin, rest = _BEGIN.split(svg, 1)
    return begin + head + rest.replace("</style>", ground, 1)


class Sheet:
    """The elements of a picture, in the order in which they are drawn."""

    def __init__(self, width: int = WIDTH) -> None:
        self.width = width
        self.below: list[str] = []  # frames
        self.lines: list[str] = []
        self.elements: list[str] = []

    def finish(self, height: int, title: str, description: str) -> str:
        """Return the picture of this height."""
        elements = [*self.below, *self.lines, *self.elements]
        svg = picture.write_svg(self.width, height, "img", title, OWN_STYLE, elements)
        return complete(svg, title, description)

    def text(self, x: float, y: float, words: str, kind: str = "") -> None:
        """Write a text at a baseline; `kind` has classes of the style. ValueError: it leaves the sheet."""
        wide = measure(words)
        left = x - wide if "end" in kind else x - wide / 2 if "middle" in kind else x
        if left < 0 or left + wide > self.width:
            raise ValueError(f"{words!r} leaves the sheet: {left:.0f} to {left + wide:.0f} of {self.width}")
        self.elements.append(f'<text class="{kind}" x="{x:g}" y="{y:g}">{escape(words)}</text>')

    def box(self, x: float, y: float, wide: float, lines: Sequence[str], kind: str = "box") -> float:
        """Draw a box with a strong first line; return its height."""
        high = LINE * len(lines) + PAD
        self.elements.append(_rect(x, y, wide, high, kind))
        for number, line in enumerate(lines):
            if measure(line) > wide - PAD:
                raise ValueError(f"{line!r} leaves its box")
            self.text(x + PAD, y + LINE * (number + 1) - 1, line, "soft" if number else "strong")
        return high

    def frame(self, x: float, y: float, wide: float, high: float) -> None:
        """Draw the frame of a robot or a computer, behind all else."""
        self.below.append(_rect(x, y, wide, high, "frame"))

    def stripe(self, x: float, y: float, wide: float, high: float = 10, kind: str = "bar") -> None:
        """Draw a bar: a network, or a time in which something is there."""
        self.elements.append(_rect(x, y, wide, high, kind, 3))

    def line(self, begin: complex, end: complex, kind: str = "line") -> None:
        """Draw a line from a point to another: x and y of a complex number."""
        self.lines.append(
            f'<line class="{kind}" x1="{begin.real:g}" y1="{begin.imag:g}" x2="{end.real:g}" y2="{end.imag:g}"/>'
        )

    def arrow(self, begin: complex, end: complex, kind: str = "line", both: bool = False) -> None:
        """Draw an arrow, or one with two heads."""
        along = (end - begin) / abs(end - begin) * HEAD
        self.line(begin + along * 0.6 if both else begin, end - along * 0.6, kind)
        for point, back in [(end, along), *([(begin, -along)] if both else [])]:
            corners = (point, point - back - back * 0.5j, point - back + back * 0.5j)
            points = " ".join(f"{corner.real:.1f},{corner.imag:.1f}" for corner in corners)
            self.lines.append(f'<polygon class="head" points="{points}"/>')


def _rect(x: float, y: float, wide: float, high: float, kind: str, round_: int = 5) -> str:
    return f'<rect class="{kind}" x="{x:g}" y="{y:g}" width="{wide:g}" height="{high:g}" rx="{round_}"/>'
