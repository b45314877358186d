# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The proof of the diagnosis on simulated fleets: `PYTHONPATH=.work/collections:. python -m tests.simulator`.

Prints how often the right part is named, by kind of fault, with some of the misses.
"""

import argparse
import sys
import time

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.explanation import write_explanation
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.content import list_findings

from tests.simulator import faults, harness


def explain(number, row):
    """Say what was injected in a trial, and why each finding was made, as `report -e explain=all` does."""
    trial = harness.draw(number, [[row]])
    for fault, place in trial.faults:
        yield f"{fault.name} at {place}; expected: {', '.join(' '.join(part) for part in fault.components)}"
    for place, entry in enumerate(list_findings(harness.diagnose(trial.state.fleet, trial.observations)), 1):
        yield from write_explanation(place, entry, 400)


def main():
    parser = argparse.ArgumentParser(prog="python -m tests.simulator", description=__doc__)
    parser.add_argument("--single", type=int, default=2000, help="trials with one fault")
    parser.add_argument("--pairs", type=int, default=2000, help="trials with two faults")
    parser.add_argument("--healthy", type=int, default=1000, help="trials without a fault")
    parser.add_argument(
        "--seed", type=int, default=0, help="the number of the first trial: others are drawn from another one on"
    )
    parser.add_argument("--fault", action="append", choices=list(faults.BY_NAME), help="only this kind of fault")
    parser.add_argument("--misses", type=int, default=3, help="misses that are shown of each kind")
    parser.add_argument(
        "--explain", type=int, metavar="TRIAL", help="only this trial with one fault: why each finding was made"
    )
    chosen = parser.parse_args()
    rows = tuple(faults.BY_NAME[name] for name in chosen.fault) if chosen.fault else faults.FAULTS
    if chosen.explain is not None:
        print("\n".join(explain(chosen.explain, rows[chosen.explain % len(rows)])))
        return
    for title, number, trials in (
        ("One fault: the right part is named first", chosen.single, harness.single_faults),
        ("Two faults: each is among the first three", chosen.pairs, harness.pairs_of_faults),
    ):
        if number:
            began = time.monotonic()
            table = harness.scores(trials(range(chosen.seed, chosen.seed + number), rows))
            print(f"{title} ({number} trials, {time.monotonic() - began:.0f} s)\n\n{harness.render(table)}\n")
            print(f"findings of a trial: {harness.render_findings(table)}\n")
            print(harness.render_misses(table, chosen.misses) + "\n")
    alarms = list(harness.false_alarms(range(chosen.seed, chosen.seed + chosen.healthy)))
    print(f"Healthy: {chosen.healthy - len(alarms)} of {chosen.healthy} without a finding")
    for number, said in alarms[:10]:
        print(f"trial {number}: {said}")


if __name__ == "__main__":
    sys.exit(main())
