# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The result of each fault, a small file each: so a long run may be made of short ones, and the table is of all of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import remedy
from catalogue import Fault

PREDICTION = "The prediction of reachability"


@dataclass(frozen=True)
class Row:
    """The result of one fault."""

    verdict: str
    text: str  # what was named first
    seconds: float  # of the verification
    ways: int  # known to the prediction and to the measurement
    agreeing: int  # of these
    revision: str  # of the code that was tried
    left: Sequence[str] = ()  # what undo has not taken back
    remedied: str = ""  # what came of the remedy that was told, where it was tried: a word of remedy.py, and the remedy
    parts: Sequence[Sequence[str]] = ()  # that were expected then
    unexplained: int = 0  # rows that no finding explains


class Kept:
    """A folder with a file for each fault that was tried."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def put(self, fault: Fault, row: Row) -> None:
        """Keep what came of a fault, instead of what came of it before."""
        self.folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(asdict(replace(row, parts=fault.parts)), indent=1)
        self._path(fault).write_text(f"{text}\n", encoding="utf-8")

    def get(self, fault: Fault) -> Row | None:
        """Return the result of a fault; None if it was not tried, or if another part was expected then."""
        path = self._path(fault)
        row = Row(**json.loads(path.read_text(encoding="utf-8"))) if path.exists() else None
        return row if row and [tuple(part) for part in row.parts] == list(fault.parts) else None

    def _path(self, fault: Fault) -> Path:
        return self.folder / f"{fault.name}.json"


def told_of_remedies(rows: Sequence[Row]) -> str:
    """The number of told commands that mended the named part, over all faults where one was tried."""
    words = [row.remedied.partition(":")[0] for row in rows if row.remedied]
    done = [word for word in words if word.endswith(f", {remedy.BY_HAND}")]
    commands = [word for word in words if word != remedy.WORDS and word not in done]
    mend, mend_by_hand = commands.count(remedy.MENDS), done.count(f"{remedy.MENDS}, {remedy.BY_HAND}")
    told = f"The command that is told mends it in {mend} of {len(commands)}; {len(words) - len(commands)} are told in words"
    return f"{told}; of these {len(done)} were done by hand, and mend it in {mend_by_hand}." if done else f"{told}."


def told_of_unexplained(rows: Sequence[Row]) -> str:
    """The number of rows without a finding that explains them, over all faults."""
    return f"Rows that no finding explains: {sum(row.unexplained for row in rows)}."


def told_of_prediction(rows: Sequence[Row]) -> str:
    """The agreement of the predicted reachability with the measured one, over all faults."""
    ways, same = sum(row.ways for row in rows), sum(row.agreeing for row in rows)
    return f"{PREDICTION} agrees with what was measured in {same} of {ways} ways."
