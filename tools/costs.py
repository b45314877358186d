# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Show which findings a change of one cost moves, over the cases of the simulator.

    PYTHONPATH=.work/collections:. python tools/costs.py RF-231 +1

A cost is how rare a fault is (plugins/plugin_utils/_faults): of two that explain the same, the cheaper one is named. Nothing is written.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Iterator
from typing import Any, NamedTuple

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults import table

#: the simulator of the tests, which has no types
faults, harness = (importlib.import_module(f"tests.simulator.{name}") for name in ("faults", "harness"))


class Move(NamedTuple):
    """A case of which other findings come out, or the same in another order."""

    case: int
    injected: str
    before: tuple[str, ...]
    after: tuple[str, ...]


def find_key(fault_id: str) -> tuple[str, str]:
    """Find the kind and mode of an id. Raises KeyError."""
    return {fault.id: key for key, fault in table.FAULTS.items()}[fault_id]


def list_cases(number: int) -> Iterator[tuple[int, str, Any]]:
    """List the cases: one fault each, all kinds in turn. A case is made of its number, so it is always the same."""
    for case in range(number):
        row = faults.FAULTS[case % len(faults.FAULTS)]
        yield case, row.name, harness.draw(case, [[row]])


def find_moves(fault_id: str, change: float, cases: list[tuple[int, str, Any]]) -> Iterator[Move]:
    """Diagnose each case with the cost of today and with another one, and yield the differences."""
    key = find_key(fault_id)
    rows: Any = table.FAULTS  # the tables of the faults are dictionaries, and parts look into this one
    today = rows[key]
    for case, injected, trial in cases:
        before = _name_findings(trial)
        rows[key] = today._replace(cost=today.cost + change)
        try:
            after = _name_findings(trial)
        finally:
            rows[key] = today
        if before != after:
            yield Move(case, injected, before, after)


def _name_findings(trial: Any) -> tuple[str, ...]:
    found = harness.diagnose(trial.state.fleet, trial.observations).findings
    return tuple(
        " or ".join(f"{one.fault.id} {one.place_text}" for one in (entry.component, *entry.rivals)) for entry in found
    )


def main() -> int:
    parser = argparse.ArgumentParser(prog="tools/costs.py", description=__doc__.partition("\n")[0])
    parser.add_argument("id", help="of a fault, such as RF-231")
    parser.add_argument("change", type=float, help="of its cost, such as +1 or -0.5")
    parser.add_argument("--cases", type=int, default=300, help="that are tried, default 300")
    chosen = parser.parse_args()
    try:
        fault = table.FAULTS[find_key(chosen.id)]
    except KeyError:
        parser.error(f"{chosen.id} is no id of a finding; docs/findings/README.md has them")
    moves = list(find_moves(chosen.id, chosen.change, list(list_cases(chosen.cases))))
    for move in moves:
        print(
            f"case {move.case}, {move.injected}:\n  before: {'; '.join(move.before)}\n  after:  {'; '.join(move.after)}"
        )
    print(
        f"{chosen.id}, cost {fault.cost:g} ({fault.why}) to {fault.cost + chosen.change:g}: {len(moves)} of {chosen.cases} cases move."
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
