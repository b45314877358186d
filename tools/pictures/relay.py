# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The relay between a robot and the station of inventory/identical_robots: names, frames and rates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.exports import FROM_SERVER, Export

from .sheet import EDGE, LINE, WIDTH, Sheet, measure
from .shipped import find_master, read_plan

ROBOT, STATION = "kobuki1", "station"
ROW, SHORTEST = 26, 30  # height of a row; length of an arrow


def _describe(channel: Mapping[str, Any]) -> Iterator[str]:
    """Yield what the relay changes in the messages of a channel."""
    if channel["frames"]:
        yield f"frame odom is {channel['frames']}odom at the station"
    if channel["rate"]:
        yield f"at most {channel['rate']:g} messages a second" + (", the newest" if channel["newest"] else "")


def _list_names(channel: Mapping[str, Any]) -> Iterator[tuple[str, str, str, bool]]:
    """Yield the kind, inner name and outer name of what crosses, and True if it comes from the station."""
    entry = Export(namespace=channel["as"], base=channel["base"])
    actions = sorted({name.rpartition("/")[0] for name in channel["topics"] if name.rpartition("/")[2] in FROM_SERVER})
    for name in channel["topics"]:
        if name.rpartition("/")[0] not in actions:
            yield "", name, entry.rename(name), False
    for name in actions:
        yield "action ", name, entry.rename(name), False
    for name in channel["services"]:
        yield "service ", name, entry.rename(name), False
    for name in channel["back"]:
        if name.rpartition("/")[0] not in actions:
            yield "", name, entry.rename(name), True


def draw_relay() -> str:
    """Draw each name that crosses, with its name at the other end."""
    fleet = read_plan("identical_robots")
    relay = find_master(fleet, ROBOT).relay
    if relay is None:
        raise ValueError(f"{ROBOT} has no relay any more")
    sheet, y, spoken = Sheet(), 92.0, []
    left = EDGE + 12
    for channel in relay["channels"]:
        top = y - 24
        for words in _describe(channel):
            sheet.text(left, y - 4, words, "soft")
            y += LINE
        for kind, inner, outer, back in _list_names(channel):
            y = _cross(sheet, y, kind + inner, outer, back)
            spoken.append(f"{kind}{inner} of {ROBOT} is {outer} at the station")
        sheet.frame(EDGE, top, WIDTH - 2 * EDGE, y - top - 12)
        y += 20
    _draw_heads(sheet, int(relay["port"]))
    return sheet.finish(
        int(y - 18),
        f"The relay between {ROBOT} and the station: names, frames and rates",
        f"{'; '.join(spoken)}. Frames get the prefix of the robot, and a camera has a rate.",
    )


def _cross(sheet: Sheet, y: float, inner: str, outer: str, back: bool) -> float:
    """Draw an arrow between two names, in one line if they are short; return the height of the next row."""
    left, right = EDGE + 12, WIDTH - EDGE - 12
    sheet.text(left, y, inner, "strong")
    begin = left + measure(inner, 14) + 8
    end = right - measure(outer, 14) - 8
    if end - begin < SHORTEST:
        y += LINE + 2
        begin = left + 12
    sheet.text(right, y, outer, "strong end")
    points = complex(begin, y - 4), complex(end, y - 4)
    sheet.arrow(*(reversed(points) if back else points))
    return y + ROW


def _draw_heads(sheet: Sheet, port: int) -> None:
    """Draw the two ends above all names."""
    sheet.text(EDGE + 12, 28, ROBOT, "strong")
    sheet.text(EDGE + 12, 28 + LINE, "master_relay", "soft")
    sheet.text(WIDTH - EDGE - 12, 28, STATION, "strong end")
    sheet.text(WIDTH - EDGE - 12, 28 + LINE, "master_relay", "soft end")
    sheet.text(WIDTH / 2, 32, f"TCP {port}", "middle")
    sheet.arrow(complex(140, 40), complex(WIDTH - 140, 40), both=True)
