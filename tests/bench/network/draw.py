# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The picture of the network's figures, out of the JSON file alone.

python tests/bench/network/draw.py REPORT.json PICTURE.svg
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("svg")
matplotlib.rcParams.update({"svg.hashsalt": "rosfleet", "font.size": 9, "axes.spines.top": False})

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
        place.set(title=title, xscale="log", ylim=(0, 102), ylabel="% of changes")
        place.grid(alpha=0.3)
        place.legend(loc="lower right", frameon=False)
    places[-1].set_xlabel("milliseconds")
    figure.savefig(path, metadata={"Date": None})
    pyplot.close(figure)


if __name__ == "__main__":
    draw(json.loads(Path(sys.argv[1]).read_text()), Path(sys.argv[2]))
