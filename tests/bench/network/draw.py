# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The pictures of the network's figures, out of the JSON file alone.

python tests/bench/network/draw.py REPORT.json FOLDER
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import picture  # noqa: E402  (first, since it says how matplotlib draws)
from matplotlib import pyplot  # noqa: E402

#: measurement -> title of its part of the picture
PARTS = {
    "new": "New publisher: registered on the other roscore after",
    "new_full": "The same with 3,000 topics",
    "first": "New publisher: first message on the other robot after",
    "gone": "Clean stop: gone on the other roscore after",
}
COLOURS = {"managed": "#1b7837", "existing": "#2166ac", "upstream": "#b2182b"}


def draw(report: Mapping[str, Any], path: Path) -> None:
    """A part for each measurement: the share of the changes that had arrived after a time."""
    figure, places = pyplot.subplots(len(PARTS), 1, figsize=(7, 2 * len(PARTS)), sharex=True, layout="constrained")
    for place, (measurement, title) in zip(places, PARTS.items(), strict=True):
        for system, found in report["systems"].items():
            samples = sorted(found.get(measurement, []))
            if samples:
                shares = [100 * (number + 1) / len(samples) for number in range(len(samples))]
                milliseconds = [1000 * sample for sample in samples]
                label = f"{report['titles'][system]} ({len(samples)})"
                place.step(milliseconds, shares, where="post", color=COLOURS[system], label=label)
        place.set(title=title, xscale="log", xlim=(1, 1e6), ylim=(0, 102), ylabel="% of changes")
        place.grid(alpha=0.3)
        place.legend(loc="lower right", frameon=False, fontsize=8)
    places[-1].set_xlabel("milliseconds")
    picture.save(figure, path)


#: what a robot takes beside many masters -> title, factor
COSTS = {
    "cpu": ("CPU of both nodes\n(% of a core)", 100.0),
    "memory": ("memory of both nodes\n(MB)", 1e-6),
    "packets": ("packets per master\nand second", 1.0),
    "there": ("until all topics are there\n(s)", 1.0),
}


def draw_crowd(report: Mapping[str, Any], path: Path) -> None:
    """The costs of one robot beside 10, 30 and 100 masters."""
    rows = report["crowd"]
    figure, places = pyplot.subplots(1, len(COSTS), figsize=(9, 2.4), layout="constrained")
    for place, (cost, (title, factor)) in zip(places, COSTS.items(), strict=True):
        masters, values = [row["masters"] for row in rows], [factor * row[cost] for row in rows]
        place.plot(masters, values, marker="o", color=COLOURS["managed"])
        place.set(title=title, xlabel="masters", xticks=masters, xlim=(0, None), ylim=(0, None))
        place.grid(alpha=0.3)
    picture.save(figure, path)


def pictures(report: Mapping[str, Any], folder: Path) -> None:
    """All pictures of a report."""
    draw(report, folder / "network.png")
    if report.get("crowd"):
        draw_crowd(report, folder / "crowd.png")


if __name__ == "__main__":
    pictures(json.loads(Path(sys.argv[1]).read_text()), Path(sys.argv[2]))
