# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The figures that are kept in the tree, since pictures and tables of docs/understand/performance.md and of the pages beside are made of them."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "understand" / "performance"
_NUMBERS = re.compile(r"\[[-+.\deE,\s]+\]")


def write(report: Any, path: Path) -> None:
    """Write a report as JSON: three significant digits, and each list of numbers on one line."""
    text = json.dumps(round_numbers(report), indent=1)
    path.write_text(_NUMBERS.sub(lambda numbers: "".join(numbers[0].split()).replace(",", ", "), text) + "\n")


def round_numbers(value: Any) -> Any:
    """Return the same data with three significant digits in each number with a point."""
    if isinstance(value, float):
        return float(f"{value:.3g}")
    if isinstance(value, dict):
        return {key: round_numbers(entry) for key, entry in value.items()}
    return [round_numbers(entry) for entry in value] if isinstance(value, list) else value


def read(name: str) -> Any:
    """Read a report of the tree, for example "network"."""
    return json.loads((FOLDER / f"{name}.json").read_text())
