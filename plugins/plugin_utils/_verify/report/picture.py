# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The fleet as a picture: the plan in, SVG text out. Pure.

The common network is a bar, and robots hang from it. The bar is drawn again over each row of robots. The own network of a
robot is a bar below its gateway. A finding has a mark at its place: a sign, a number, and a link.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar
from xml.sax.saxutils import escape, quoteattr

from ..._base.plain_text import plain
from ..._base.sentences import shorten_list
from ..._plan.model import COMMON, ComputerPlan, FleetPlan
from ..checks.engine import FAILED, OK, UNKNOWN, WARNING

_T = TypeVar("_T")
_Finding = Mapping[str, Any]  # as the document has it

SIGNS = {OK: "\u2713", FAILED: "\u2716", WARNING: "\u25b2", UNKNOWN: "?"}  # never only by colour
WIDTH = 1160  # of the picture; a single robot may need more
COLUMNS = 2  # computers of a robot side by side
BOX, GAP, BAR, EDGE = 46, 14, 10, 12  # heights and distances
AISLE = 18  # width of the aisles at both sides of a robot: wires go there, and texts begin between them
HEAD = 68  # the title of a robot, and the robots that it discovers
LETTER, SMALL = 7.3, 6.0  # width of a letter, and of one of a small text
LINE = 14  # height of a line of a label
LONGEST, SHORTEST = 26, 14  # letters of a name that are shown
MARKS = 4  # marks that are drawn at one place

STYLE = """
text { font: 12px system-ui, sans-serif; fill: var(--ink, #1b1f24) }
.title { font-weight: 700; font-size: 14px }
.small { font-size: 11px; fill: var(--soft, #57606a) }
.box { fill: var(--paper, #fff); stroke: var(--ink, #1b1f24); stroke-width: 1.2 }
.title, .aside { paint-order: stroke; stroke: var(--pale, #f6f8fa); stroke-width: 5px; stroke-linejoin: round }
.robot { fill: var(--pale, #f6f8fa); stroke: var(--soft, #57606a); stroke-dasharray: 2 3 }
.device { stroke-dasharray: 6 3 }
.bar { fill: var(--bar, #0969da) }
.wire { stroke: var(--bar, #0969da); stroke-width: 2 }
.is-failed { stroke: var(--failed, #b42318); stroke-width: 3.5 }
.is-warning { stroke: var(--warning, #8a5a00); stroke-width: 3.5; stroke-dasharray: 9 4 }
.is-unknown { stroke: var(--soft, #57606a); stroke-width: 3; stroke-dasharray: 2 4 }
.mark rect { fill: var(--failed, #b42318); stroke: var(--paper, #fff) }
.mark.warning rect { fill: var(--warning, #8a5a00) }
.mark.unknown rect { fill: var(--soft, #57606a) }
.mark text { fill: var(--paper, #fff); font-weight: 700; text-anchor: middle }
a:focus .mark rect, a:focus rect { stroke: var(--ink, #1b1f24); stroke-width: 3 }
""".strip()


@dataclass(frozen=True)
class _Device:
    """A box: a computer, or a device that is not a computer."""

    name: str
    lines: tuple[str, ...]
    title: str
    planned: bool = True  # it is a computer of the inventory


class RobotMark(NamedTuple):
    """A robot, the worst verdict of its findings, and the numbers of these findings from 1."""

    robot: str
    verdict: str
    numbers: tuple[int, ...]


def draw_fleet(
    fleet: FleetPlan,
    findings: Iterable[_Finding] = (),
    unseen: Mapping[str, Sequence[str]] | None = None,
    width: int = WIDTH,
    columns: int = COLUMNS,
) -> str:
    """Draw the fleet, with a mark at the place of each finding, and of each other component that may be the cause.

    `unseen` has the robots that a robot is to discover and does not. `width` is in pixels,
    and `columns` the computers of a robot side by side.
    """
    return _Picture(fleet, findings, unseen or {}, width, columns).svg()


def mark_places(findings: Iterable[_Finding]) -> dict[str, list[tuple[int, _Finding]]]:
    """Return the numbers and findings at each place: a computer, a robot, a network or a pair."""
    marks: dict[str, list[tuple[int, _Finding]]] = defaultdict(list)
    for number, entry in enumerate(findings, 1):
        for places in dict.fromkeys([entry["place"], *(rival["place"] for rival in entry["rivals"])]):
            for place in dict.fromkeys([places, *places.split(" and ")]):
                marks[place].append((number, entry))
    return marks


def list_robots(
    fleet: FleetPlan, findings: Iterable[_Finding], seen: Collection[str] | None = None
) -> Iterator[RobotMark]:
    """Yield each robot with the findings at its computers, at its network or at itself: those with findings first.

    A robot without a computer in `seen` was not looked at, as with --limit. None: all were.
    """
    marks, computers = mark_places(findings), defaultdict(list)
    for plan in fleet.computers.values():
        computers[plan.robot].append(plan.computer)
    networks = {entry.robot: [f"the network of {entry.robot}", str(entry.gateway)] for entry in fleet.networks}
    robots = []
    for robot in fleet.master_of:
        places = [robot, *computers[robot], *networks.get(robot, ())]
        found = {number: entry["verdict"] for place in places for number, entry in marks.get(place, ())}
        well = OK if seen is None or not set(computers[robot]).isdisjoint(seen) else UNKNOWN
        verdict = next((kind for kind in (FAILED, WARNING, UNKNOWN) if kind in found.values()), well)
        robots.append(RobotMark(robot, verdict, tuple(sorted(found))))
    yield from sorted(robots, key=lambda entry: not entry.numbers)


def _device(plan: ComputerPlan) -> _Device:
    duties = {
        "master": plan.is_master,
        "gateway": plan.is_gateway,
        "router": plan.is_router,
    }
    addresses = dict.fromkeys(str(address) for address in (plan.address, plan.common_address) if address)
    own = [duty for duty in duties if duties[duty]] + [
        component.duty for component in plan.features.values() if component.duty
    ]
    duty = " ".join(own) or "computer"
    lines = ("sealed" if plan.sealed else duty, *addresses)
    return _Device(plan.computer, lines, f"{plan.computer}: {', '.join(lines)}")


def shorten(text: str, most: int = LONGEST) -> str:
    """Return the first letters of a text, made plain."""
    return plain(text) if len(plain(text)) <= most else plain(text)[: most - 1] + "\u2026"


def write_svg(width: int, height: int, role: str, title: str, style: str, elements: Iterable[str]) -> str:
    """Return a picture of these elements, the first one at the back."""
    begin = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    head = f'{begin} role="{role}" aria-label={quoteattr(title)}>'
    return "\n".join([head, f"<style>{style}</style>", *elements, "</svg>\n"])


class _Picture:
    """The elements of a picture, and how far it reaches."""

    def __init__(
        self,
        fleet: FleetPlan,
        findings: Iterable[_Finding],
        unseen: Mapping[str, Sequence[str]],
        width: int,
        columns: int,
    ) -> None:
        self.fleet = fleet
        self.columns = columns
        self.robots = list(fleet.master_of)
        self.unseen = unseen
        self.marks = mark_places(findings)
        names = [plan.computer for plan in fleet.computers.values() if plan.robot in fleet.master_of]
        names += [str(network.gateway) for network in fleet.networks if network.device]
        self.box = round(LETTER * min(max(SHORTEST, *map(len, names)), LONGEST)) + 2 * GAP
        self.frame = columns * self.box + (columns + 1) * GAP
        self.each = max(1, min(len(self.robots), (width - EDGE) // (self.frame + GAP)))
        self.width = self.each * (self.frame + GAP) + 2 * EDGE
        self.frames: list[str] = []
        self.wires: list[str] = []
        self.elements: list[str] = []

    def svg(self) -> str:
        """Draw all: frames are behind wires, and wires behind boxes."""
        y = self._router(EDGE)
        rows = _split_rows(self.robots, self.each)
        left = EDGE + (GAP if len(rows) > 1 else 0)  # a wire is at the left of several rows
        bars = []
        for number, robots in enumerate(rows):
            label = self._common(number)
            y += LINE * (len(_split_label(label, self.width - 2 * EDGE)) - 1)
            bars.append(y)
            self._bar(EDGE, y, self.width - 2 * EDGE, label, COMMON if number == 0 else "")
            heights = [
                self._draw(robot, left + column * (self.frame + GAP), y + BAR) for column, robot in enumerate(robots)
            ]
            y += BAR + max(heights, default=0) + 3 * GAP
        if len(rows) > 1:  # the bars are one network
            self._wire(EDGE + 1, bars[0] + BAR // 2, bars[-1] + BAR // 2)
        if self.fleet.router is not None:
            x = EDGE + GAP + AISLE // 2
            self._wire(x, EDGE + BOX, bars[0])
        title = f"The fleet: {len(self.robots)} robots, {len(self.fleet.computers)} computers"
        return write_svg(self.width, y, "group", title, STYLE, [*self.frames, *self.wires, *self.elements])

    def _common(self, row: int) -> str:
        fleet = self.fleet
        ways = {"both": "multicast and unicast"}.get(fleet.transport, fleet.transport)
        if row:
            return f"{fleet.common_network}, the same network"
        kind = next((plan.carrier for plan in fleet.computers.values() if plan.carrier), "common network")
        return f"{kind} {fleet.common_network}; discovery by {ways}, {fleet.multicast_group}:{fleet.multicast_port}"

    def _router(self, y: int) -> int:
        router = self.fleet.router
        if router is None:
            return y + 2 * GAP
        if router.name:
            device = _device(self.fleet.computers[router.name])
        else:
            device = _Device(str(router.address), ("router, no computer",), "the router, a device", planned=False)
        self._box(device, EDGE + GAP, y)
        return y + self._height(device) + 2 * GAP

    def _draw(self, robot: str, x: int, top: int) -> int:
        """Draw a robot below the bar; return its height."""
        network = next((entry for entry in self.fleet.networks if entry.robot == robot), None)
        plans = [plan for plan in self.fleet.computers.values() if plan.robot == robot]
        front = [_device(plan) for plan in plans if network is None or plan.common_address]
        if network is not None and network.device:
            lines = ("gateway, no computer", str(network.gateway), str(network.common_address))
            front.append(_Device(str(network.gateway), lines, "the gateway of the robot, a device", planned=False))
        y = top + GAP
        self._text(x + GAP + AISLE, y + 20, f"robot {shorten(robot)}", "title")
        for number, line in enumerate(self._describe_discovery(robot)):
            self._text(x + GAP + AISLE, y + 37 + 15 * number, line, "small aside")
        marks = self.marks.get(robot, ())
        self._marks(x + self.frame - GAP, y + 6, marks)
        y = self._hang(front, x, y + HEAD, top)
        if network is not None:
            if front:
                self._wire(x + GAP + AISLE // 2, top, y + 2 * GAP)
            y += 2 * GAP
            self._bar(x + GAP, y, self.frame - 2 * GAP, f"own network {network.network}", f"the network of {robot}")
            y = self._hang([_device(plan) for plan in plans if not plan.common_address], x, y + BAR + GAP, y)
        height = y - top
        self.frames.append(
            f'<rect class="robot{_class(marks)}" x="{x}" y="{top + GAP}" width="{self.frame}" height="{height - GAP}" rx="8"/>',
        )
        return height

    def _describe_discovery(self, robot: str) -> Iterator[str]:
        """Yield the robots that a robot discovers, and those that it does not."""
        unseen = self.unseen.get(robot, ())
        others = [other for other in self.robots if other not in (robot, *unseen)]
        yield f"discovers {shorten_list(map(shorten, others)) or 'nobody'}"
        if unseen:
            yield f"{SIGNS[FAILED]} does not discover {shorten_list(map(shorten, unseen))}"

    def _hang(self, devices: Sequence[_Device], x: int, y: int, above: int) -> int:
        """Draw boxes in columns below a bar, with wires in the outer aisles; return the y of the next thing."""
        for row in _split_rows(devices, self.columns):
            for column, device in enumerate(row):
                left = x + GAP + column * (self.box + GAP)
                self._wire(left + (self.box - AISLE // 2 if column else AISLE // 2), above, y)
                self._box(device, left, y)
            y += max(map(self._height, row)) + GAP
        return y

    def _height(self, device: _Device) -> int:
        return BOX + 14 * max(0, len(device.lines) - 1)

    def _box(self, device: _Device, x: int, y: int) -> None:
        marks = self.marks.get(device.name, ())
        kind = "box" if device.planned else "box device"
        self.elements.append(
            f'<g><title>{escape(plain(device.title))}</title><rect class="{kind}{_class(marks)}" x="{x}" y="{y}" '
            f'width="{self.box}" height="{self._height(device)}" rx="4"/>'
        )
        self._text(x + GAP, y + 19, shorten(device.name), "name")
        for number, line in enumerate(device.lines):
            self._text(x + GAP, y + 35 + 14 * number, line, "small")
        self.elements.append("</g>")
        self._marks(x + self.box, y - 14, marks)  # above the name

    def _bar(self, x: int, y: int, width: int, text: str, place: str) -> None:
        marks = self.marks.get(place, ()) if place else ()
        self.elements.append(
            f'<rect class="bar{_class(marks)}" x="{x}" y="{y}" width="{width}" height="{BAR}" rx="3"/>'
        )
        for number, line in enumerate(reversed(_split_label(text, width))):
            self._text(x + GAP + AISLE, y - 5 - LINE * number, line, "small")
        self._marks(x + width, y - 8, marks)

    def _marks(self, right: int, y: int, marks: Sequence[tuple[int, _Finding]]) -> None:
        """Draw marks from the right to the left, each a link to its finding."""
        for position, (number, entry) in enumerate(marks[:MARKS]):
            x, verdict = right - 40 * (position + 1), entry["verdict"]
            last = position == MARKS - 1 and len(marks) > MARKS
            label = f"{len(marks) - MARKS + 1} more" if last else f"{SIGNS[verdict]} {number}"
            title = f"{verdict}: finding {number}: {plain(entry['sentence'], 400)}"
            self.elements.append(
                f'<a href="#finding-{number}" aria-label={quoteattr(title)}><title>{escape(title)}</title>'
                f'<g class="mark {verdict}"><rect x="{x}" y="{y}" width="38" height="20" rx="3"/>'
                f'<text x="{x + 19}" y="{y + 15}">{label}</text></g></a>'
            )

    def _wire(self, x: int, top: int, bottom: int) -> None:
        self.wires.append(f'<line class="wire" x1="{x}" y1="{top}" x2="{x}" y2="{bottom}"/>')

    def _text(self, x: int, y: int, text: str, kind: str) -> None:
        self.elements.append(f'<text class="{kind}" x="{x}" y="{y}">{escape(plain(text))}</text>')


def _class(marks: Sequence[tuple[int, _Finding]]) -> str:
    """Return the class for the worst of the marks of an element."""
    verdicts = {entry["verdict"] for _number, entry in marks}
    return next((f" is-{verdict}" for verdict in (FAILED, WARNING, UNKNOWN) if verdict in verdicts), "")


def _split_label(text: str, width: int) -> list[str]:
    """Split the label of a bar of this width into its parts, if it is too long for one line."""
    lines = [text]
    for mark in ("; ", ", "):
        if max(map(len, lines)) * SMALL > width - GAP - AISLE:
            lines = [part for line in lines for part in line.split(mark)]
    return lines


def _split_rows(entries: Sequence[_T], size: int) -> list[Sequence[_T]]:
    """Split a list into rows of this size."""
    return [entries[begin : begin + size] for begin in range(0, len(entries), size)]
