# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The topics that cost most between robots, as rows for the terminal and for the page. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..._base.sentences import shorten_list

HEADINGS = ("topic", "from (node)", "to", "messages/s", "kB/s")
ROWS = 10
LEAST = 1000.0  # bytes a second; a topic with less costs nothing
NAMES = 4  # robots or nodes in a cell


def list_dearest(traffic: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the rows below HEADINGS. `traffic` is a part of the document, with the dearest topic first."""
    return [
        (
            entry["topic"],
            f"{entry['from']} ({shorten_list(entry['nodes'], NAMES)})",
            shorten_list(
                [f"{robot} ({number})" if number > 1 else robot for robot, number in entry["to"].items()], NAMES
            ),
            f"{entry['messages_s']:.1f}",
            f"{entry['bytes_s'] / 1000:.1f}",
        )
        for entry in traffic["topics"][:ROWS]
        if entry["bytes_s"] >= LEAST
    ]


def describe_measurement(traffic: Mapping[str, Any]) -> str:
    """Say how the rows were measured."""
    return (
        f"As the publishers counted it for {traffic['seconds']:.1f} s, summed over all subscribers of other robots. "
        f"Topics of less than {LEAST / 1000:g} kB/s are left out"
    )
