# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Any two computers of the fleet communicate (section 4.3 of the report): every computer with every other, at once.

One ordinary node per computer publishes a topic and offers a service, hears every other's topic over a connection to that
very computer, and calls every other's service.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from proofs.proof import NODES, Computer, Result

SECONDS = 120.0


@dataclass(frozen=True)
class Matrix:
    """Whom each computer reached: (here, there) pairs."""

    names: tuple[str, ...]
    topic: frozenset[tuple[str, str]]
    service: frozenset[tuple[str, str]]
    lacks: tuple[str, ...] = ()  # the missing stages of a topic, in words

    @property
    def pairs(self) -> int:
        """The number of ordered pairs."""
        return len(self.names) * (len(self.names) - 1)

    def list_results(self) -> list[Result]:
        """Two lines of the proof for each ordered pair."""
        kinds = {"a topic is heard directly": self.topic, "any service is called": self.service}
        return [
            Result(what, f"{there} -> {here}", (here, there) in reached, "")
            for what, reached in kinds.items()
            for here, there in itertools.permutations(self.names, 2)
        ]

    def cell(self, here: str, there: str) -> str:
        """One character of the table."""
        if here == there:
            return "."
        try_others = (here, there)
        return {(True, True): "+", (True, False): "t", (False, True): "s", (False, False): "-"}[
            try_others in self.topic, try_others in self.service
        ]

    def table(self) -> str:
        """Rows hear and call, columns are heard and called."""
        width = max(map(len, self.names)) + 1
        lines = [" " * (width + 5) + "".join(f"{number:>3}" for number in range(1, len(self.names) + 1))]
        for number, here in enumerate(self.names, 1):
            cells = "".join(f"{self.cell(here, there):>3}" for there in self.names)
            lines.append(f"  {number:>2} {here:<{width}}{cells}")
        lines.append(
            f"  topics heard directly: {len(self.topic)} of {self.pairs}; services called: {len(self.service)} of {self.pairs}"
            "   (+ both, t only the topic, s only the service, - neither)"
        )
        lines += [f"  {words}" for words in self.lacks]
        return "\n".join(lines)


def everybody(computers: Sequence[Computer]) -> Matrix:
    """Start a node on every computer, wait until each has tried all others, and end them."""
    through = threading.Barrier(len(computers))

    def try_others(here: Computer) -> dict[str, Any]:
        others = " ".join(computer.name for computer in computers if computer is not here)
        with here.start_program(f"python3 - {here.name} {others}", NODES / "programs/everybody.py") as output:
            found = json.loads(output.readline() or "{}")
            with contextlib.suppress(threading.BrokenBarrierError):
                through.wait(SECONDS)  # one that is through stays until all are
        return found

    with ThreadPoolExecutor(max_workers=len(computers)) as pool:
        found = dict(zip([computer.name for computer in computers], pool.map(try_others, computers), strict=True))
    return Matrix(
        tuple(found),
        *(
            frozenset((here, there) for here, kinds in found.items() for there in kinds.get(kind, []))
            for kind in ("topic", "service")
        ),
        tuple(
            f"{here} has of the topic of {there}: {why}"
            for here, kinds in found.items()
            for there, why in kinds.get("lacks", {}).items()
        ),
    )
