# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults that nobody foresaw, on real systems: drawn by a seed, kept where they break something, verified, graded and undone.

    python tests/faults/fuzz.py --number 200 --seed 1 [--record FOLDER]

The oracle is where a fault was made: the computer that is named first, and its part or the hop where packets end. What breaks nothing
by the lab's own test is drawn again. The last lines are a table of the kinds.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from run import INVENTORY, WORK, Catalogue, LabError, lab_of  # first: it finds the other files

from catalogue import Fault, facts_of  # isort: skip
from grammar import KINDS, MASTERS, PORTS, ROBOT, draw_faults  # isort: skip
from harm import Fleet, find_harm  # isort: skip
from judge import UNMADE, Named, is_at  # isort: skip
from machines.layout import read_inventory  # isort: skip

PART, COMPUTER, OTHER, NOTHING = "part or hop", "computer", "another place", "nothing"
GRADES = (PART, COMPUTER, OTHER, NOTHING)
HOP = "way"  # the kind of a part that is a place where packets end
MOST_DRAWS = 6  # for each fault that is wanted
SETTLE = 2.0  # seconds until a fault has its effect
LOOKS = 2  # in which something is broken
# The limits: shares of all faults
LEAST_COMPUTER, LEAST_PART, MOST_OTHER = 0.95, 0.85, 0.03


class Graded(NamedTuple):
    """A fault, and how well it was named."""

    fault: Fault
    grade: str
    text: str
    seconds: float


def grade(fault: Fault, found: Named) -> str:
    """Compare what was named first with where the fault was made."""
    if not found.findings:
        return NOTHING
    if not is_at(found.place, fault.at):
        return OTHER
    kinds = {kind for kind, _mode in fault.parts} | {HOP}
    return PART if found.part[0] in kinds else COMPUTER


def try_faults(number: int, seed: int, record: Path | None, name: str) -> list[Graded]:
    """Draw faults in a lab until so many have broken something."""
    listing = read_inventory(INVENTORY)
    facts = facts_of(listing, {})
    fleet = Fleet(
        {host: (facts[host], list(PORTS) if host in MASTERS else []) for host in listing["_meta"]["hostvars"]},
        ROBOT,
        {host: facts[f"{host}.common"] for host in MASTERS},
        facts["group"],
        int(facts["port"]),
    )
    graded: list[Graded] = []
    with lab_of(name, INVENTORY, {}) as lab:
        status, output = lab.play("site.yml")
        if status:
            raise LabError(f"site.yml has failed: {output[-600:]}")
        catalogue = Catalogue(lab, record)
        for fault in islice(draw_faults(seed, facts), MOST_DRAWS * number):
            if len(graded) == number:
                break
            result = catalogue.tried(fault, lambda fault: _is_harmful(lab, fleet, fault))
            if result is None or result.verdict == UNMADE:
                print(f"    {'could not be made' if result else 'breaks nothing'}: {fault.title}", flush=True)
                continue
            graded.append(Graded(fault, grade(fault, result.found), result.found.text, result.seconds))
            print(f"[{len(graded)}/{number}] {graded[-1].grade} ({result.seconds:.0f} s): {fault.title}", flush=True)
            print(f"    named: {result.found.text}", flush=True)
            for line in result.left:
                print(f"    left by undo: {line}", flush=True)
    return graded


def _is_harmful(lab, fleet: Fleet, fault: Fault) -> bool:
    """A node that is stopped breaks something, also where no port of it is asked.

    What is broken stays so: an answer to ARP that is lost once is made good by the next question of the other side.
    """
    if fault.name.startswith("signal"):
        return True
    for _look in range(LOOKS):
        time.sleep(SETTLE)
        if not find_harm(lab, fleet):
            return False
    return True


def write_table(graded: Sequence[Graded]) -> str:
    """Return the table of the kinds, with the number of each grade."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for one in graded:
        counts[one.fault.name.partition("-")[0]][one.grade] += 1
    lines = [f"{'kind':<12}" + "".join(f"{head:>16}" for head in GRADES)]
    for kind in KINDS:
        lines.append(f"{kind:<12}" + "".join(f"{counts[kind][one] or '-':>16}" for one in GRADES))
    total = Counter(one.grade for one in graded)
    lines.append(f"{'all':<12}" + "".join(f"{total[one]:>16}" for one in GRADES))
    return "\n".join(lines)


def is_good(graded: Sequence[Graded]) -> bool:
    """Say if all limits are kept."""
    total = Counter(one.grade for one in graded)
    count = max(1, len(graded))
    return (
        (total[PART] + total[COMPUTER]) / count >= LEAST_COMPUTER
        and total[PART] / count >= LEAST_PART
        and total[OTHER] / count <= MOST_OTHER
        and not total[NOTHING]
    )


def main() -> int:
    """Exit status 0 only within the limits."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--number", type=int, default=12, help="how many faults that break something")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--record", metavar="FOLDER", type=Path, help="keep the plan and the observations of each fault"
    )
    parser.add_argument("--lab", metavar="NAME", default="fuzz", help="the name of the lab")
    options = parser.parse_args()
    for folder in filter(None, (WORK, options.record)):
        folder.mkdir(parents=True, exist_ok=True)
    try:
        graded = try_faults(options.number, options.seed, options.record, options.lab)
    except (LabError, subprocess.SubprocessError) as problem:
        print(f"faults: {problem}", file=sys.stderr)
        return 1
    print(f"\n{write_table(graded)}")
    good = is_good(graded)
    print(f"{len(graded)} faults of seed {options.seed}: {'within' if good else 'beyond'} the limits")
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
