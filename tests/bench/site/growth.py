# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The costs of a fleet for the controller and its computers as it grows: plans, runs of site.yml and verify, judgements.

python tests/bench/site/growth.py [--computers 13,100] [--keep]

The computers are not there: the connection `recorded` gives the answers of computers that are as planned, at once. So one machine
shows 400 computers, and all that is measured is the controller's work. Plan and judgement are the functions behind the actions, on
observations of a fleet in which everything works. Writes .work/bench/growth.json and growth.png, with --keep to
docs/understand/performance; `make readme` then writes the tables of the pages.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT / folder) for folder in ("tests/bench", ".work/collections", "tests/unit/helpers")]

import in_tree  # noqa: E402

WORK = ROOT / ".work" / "bench"
COMPUTERS = (13, 100, 200, 400)
ROBOTS = (25, 50, 100)  # of four computers each on one network, in plan and judgement
OF_A_ROBOT = 4
RUNS = {
    "site": ("second `site.yml`", "site.yml", "changed=0"),
    "verify": ("`verify`", "playbooks/verify.yml", "PASSED: "),
}
# Runs a command and writes what it took: a child of this process would have the memory that this one had at the fork.
MEASURE = """
import json, os, sys, time
began = time.monotonic()
_pid, status, usage = os.wait4(os.spawnvp(os.P_NOWAIT, sys.argv[2], sys.argv[2:]), 0)
spent = {"seconds": time.monotonic() - began, "processor": usage.ru_utime + usage.ru_stime, "memory": usage.ru_maxrss / 1024}
json.dump(spent, open(sys.argv[1], "w"))
sys.exit(os.waitstatus_to_exitcode(status))
"""
#: figure -> seconds that 100 robots may take
LIMITS = {"plan": 3.0, "judgement": 5.0}


def record(computers: int) -> tuple[Path, list[dict[str, Any]]]:
    """Write the inventory and the answers of a fleet: the path of the inventory, and the sizes of the plan of two computers."""
    import planned
    import recording

    plan = recording.make_plan(computers)
    inventory, answers = WORK / "growth.yml", WORK / "answers"
    answers.mkdir(parents=True, exist_ok=True)
    inventory.write_text(json.dumps(recording.make_inventory(computers, answers)) + "\n")  # JSON is YAML
    for name, of_it in recording.list_answers(plan):
        (answers / f"{name}.json").write_text(json.dumps(of_it))
    sizes = [planned.measure_computer(plan, name) for name in ("robot0-0", "robot0-1")]
    return inventory, [{"computers": computers, **size} for size in sizes]


def play(inventory: Path, computers: int, run: str) -> dict[str, Any]:
    """Run a playbook over so many computers: seconds by the clock and of the processors, and the memory of the largest process."""
    _title, playbook, words = RUNS[run]
    settings = {
        **os.environ,
        "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg"),
        "ANSIBLE_HOME": str(WORK / "ansible"),  # has the reports
        "ANSIBLE_COLLECTIONS_PATH": str(ROOT / ".work/collections"),
        "ANSIBLE_CONNECTION_PLUGINS": str(ROOT / "tests/bench/connection"),
        "ANSIBLE_NOCOLOR": "1",
    }
    command = [str(Path(sys.executable).with_name("ansible-playbook")), "-i", str(inventory), playbook]
    path, figures = WORK / f"growth-{run}.log", WORK / "growth-spent.json"
    with path.open("w") as log:
        measured = [sys.executable, "-c", MEASURE, str(figures), *command]
        done = subprocess.run(measured, cwd=ROOT, env=settings, stdout=log, stderr=log, check=False)
    output = path.read_text()
    if done.returncode or words not in output:
        sys.exit(f"growth: {playbook} failed:\n{output[-3000:]}")
    return {"computers": computers, **json.loads(figures.read_text())}


def spent(function: Callable[[], Any]) -> tuple[Any, float]:
    """Call a function: its result, and the seconds of a processor that it takes."""
    began = time.process_time()
    result = function()
    return result, round(time.process_time() - began, 2)


def functions(robots: int) -> dict[str, float]:
    """Seconds of a processor for the plan of so many robots, and for the judgement of their verification."""
    import fleets
    from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
    from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.judgement import judge

    plan, planned = spent(lambda: fleets.plan(robots, OF_A_ROBOT))
    _data, written = spent(lambda: to_plain(plan))
    seen = fleets.observed(plan)
    verification, indexed = spent(lambda: fleets.engine.Verification(fleets.CHECKS, plan, seen))
    summary, judged = spent(lambda: judge(verification, False, False).summary)
    some, sampled = spent(lambda: fleets.engine.Verification(fleets.CHECKS, plan, seen, "auto"))
    few, judged_some = spent(lambda: judge(some, False, False).summary)
    return {
        "robots": robots,
        "computers": robots * OF_A_ROBOT,
        "plan": round(planned + written, 2),
        "judgement": round(indexed + judged, 2),
        "findings": summary.total,
        "sampled": round(sampled + judged_some, 2),  # with verify_pairs: auto
        "pairs": few.pairs[0],
    }


def machine() -> dict[str, Any]:
    """The machine that the figures were measured on, and with."""
    version = subprocess.run(["git", "describe", "--always"], cwd=ROOT, capture_output=True, text=True, check=False)
    ansible = subprocess.run(
        [str(Path(sys.executable).with_name("ansible")), "--version"], capture_output=True, text=True, check=False
    )
    return {
        "cores": os.cpu_count(),
        "kernel": platform.release(),
        "python": platform.python_version(),
        "ansible": ansible.stdout.partition("\n")[0],
        "collection": version.stdout.strip(),
        "load": round(os.getloadavg()[0], 1),
    }


def grow(rows: Sequence[dict[str, Any]], key: str) -> list[str]:
    """Return by how much a figure grows from each row to the next, for twice the computers."""
    pairs = zip(rows, rows[1:])
    ratios = (
        2 ** (math.log(after[key] / before[key]) / math.log(after["computers"] / before["computers"]))
        for before, after in pairs
    )
    return ["", *(f"{ratio:.1f} times" for ratio in ratios)]


def runs_table(report: dict[str, Any]) -> str:
    """Return the runs of the playbooks over a growing fleet as a table of Markdown."""
    lines = [
        "| run | by the clock | processors | for each computer | twice the computers take | memory |",
        "|---|---|---|---|---|---|",
    ]
    for run, (title, _playbook, _words) in RUNS.items():
        rows = report[run]
        lines += [
            f"| {title}, {row['computers']} computers | {row['seconds']:.1f} s | {row['processor']:.1f} s"
            f" | {row['processor'] / row['computers']:.2f} s | {ratio} | {row['memory']:.0f} MB |"
            for row, ratio in zip(rows, grow(rows, "processor"))
        ]
    return "\n".join(lines) + "\n"


def plans_table(report: dict[str, Any]) -> str:
    """Return the sizes of the plan of two computers in a growing fleet as a table of Markdown."""
    lines = [
        "| computer | names in `/etc/hosts` | routes | nftables | rules of ufw | rules of firewalld | planned in |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row['computer']}, of {row['computers']} | {row['names']} | {row['routes']} | {row['nftables_bytes'] / 1000:.1f} kB"
        f" | {row['ufw_rules']:,} | {row['firewalld_rules']:,} | {row['seconds']:.3f} s |"
        for row in sorted(report["plans"], key=lambda row: row["computer"], reverse=True)
    ]
    return "\n".join(lines) + "\n"


def functions_table(report: dict[str, Any]) -> str:
    """Plan and judgement of a growing fleet, as a table of Markdown."""
    lines = [
        "| robots of four computers | plan | judgement of all pairs | results | judgement of a sample |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {row['robots']} | {row['plan']:.2f} s | {row['judgement']:.2f} s | {row['findings']:,} | {row['sampled']:.2f} s |"
        for row in report["functions"]
    ]
    return "\n".join(lines) + "\n"


def draw(report: dict[str, Any], path: Path) -> None:
    """Draw the growth out of the report alone."""
    import picture  # first, since it says how matplotlib draws
    from matplotlib import pyplot

    figure, (runs, functions_of) = pyplot.subplots(1, 2, figsize=(8, 3), layout="constrained")
    for run, (title, _playbook, _words) in RUNS.items():
        for key, label in (("seconds", "by the clock"), ("processor", "of the processors")):
            runs.plot(
                [row["computers"] for row in report[run]],
                [row[key] for row in report[run]],
                "o-",
                label=f"{title.replace('`', '')}, {label}",
            )
    runs.set(
        title="Controller: site.yml and verify", xlabel="computers", ylabel="seconds", xlim=(0, None), ylim=(0, None)
    )
    for key in LIMITS:
        rows = report["functions"]
        functions_of.plot([row["computers"] ** 2 / 1000 for row in rows], [row[key] for row in rows], "o-", label=key)
    functions_of.set(
        title="Plan and judgement", xlabel="pairs of computers, in thousands", xlim=(0, None), ylim=(0, None)
    )
    for place in (runs, functions_of):
        place.grid(alpha=0.3)
        place.legend(frameon=False)
    picture.save(figure, path)


def measure(computers: Iterable[int]) -> dict[str, Any]:
    """Measure all, and say on the way what is done."""
    report: dict[str, Any] = {"machine": machine(), "plans": [], **{run: [] for run in RUNS}}
    report["functions"] = [functions(robots) for robots in ROBOTS]
    for number in computers:
        inventory, sizes = record(number)
        report["plans"] += sizes
        for run in RUNS:
            report[run].append(play(inventory, number, run))
            print(f"growth: {number} computers, {run}: {report[run][-1]['seconds']:.0f} s", flush=True)
    return report


def main() -> None:
    """Measure, print and write; name what takes longer than is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--computers", default=",".join(map(str, COMPUTERS)), help="the fleets (default: %(default)s)")
    parser.add_argument("--keep", action="store_true", help="write the figures to docs/understand/performance")
    options = parser.parse_args()
    WORK.mkdir(parents=True, exist_ok=True)
    report = measure(map(int, options.computers.split(",")))
    print("\n".join(table(report) for table in (plans_table, runs_table, functions_table)), flush=True)
    for folder in [WORK] + [in_tree.FOLDER] * options.keep:
        folder.mkdir(parents=True, exist_ok=True)
        in_tree.write(report, folder / "growth.json")
        draw(report, folder / "growth.png")
    largest = report["functions"][-1]
    late = [f"{key}: {largest[key]} s, at most {limit} s" for key, limit in LIMITS.items() if largest[key] > limit]
    print("".join(f"growth: falls short: {line}\n" for line in late), end="")


if __name__ == "__main__":
    main()
