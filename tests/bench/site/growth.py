# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The costs of a fleet for the controller as it grows: plan, second run of site.yml, judgement of a full verification.

python tests/bench/site/growth.py [--keep]

The computers of the second run are not there: the connection `recorded` gives the answers of a real one that is as
planned, at once. So one machine shows 100 computers, and all that is measured is the controller's work. Plan and
judgement are the functions behind the actions, on observations of a fleet in which everything works. Writes
.work/bench/growth.json and growth.png, with --keep to docs/understand/performance; `make readme` then writes the tables of README.md.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT / folder) for folder in ("tests/bench", ".work/collections", "tests/unit/helpers")]

import in_tree  # noqa: E402

WORK = ROOT / ".work" / "bench"
COMPUTERS = (13, 25, 50, 100)  # of the second run
ROBOTS = (25, 50, 100)  # of four computers each, in plan and judgement
OF_A_ROBOT = 4
#: figure -> seconds that 100 robots may take
LIMITS = {"plan": 3.0, "judgement": 5.0}


def inventory(computers: int) -> dict[str, Any]:
    """An inventory of robots with four computers on one network, behind the connection `recorded`."""
    robots: dict[str, dict[str, Any]] = {}
    for number in range(computers):
        robot = f"robot{number // OF_A_ROBOT}"
        hosts = robots.setdefault(robot, {"hosts": {}, "vars": {"multimaster_master": f"{robot}-0"}})["hosts"]
        hosts[f"{robot}-{number % OF_A_ROBOT}"] = {"multimaster_address": f"10.1.{number // 200}.{1 + number % 200}"}
    shared = {
        "multimaster_common_network": "10.1.0.0/16",
        "ansible_connection": "recorded",
        "ansible_user": "root",
        "ansible_python_interpreter": "/usr/bin/python3",
        "recorded_machine": str(Path(__file__).with_name("machine.json")),
    }
    return {"robots": {"children": robots, "vars": shared}}


def second_run(computers: int) -> dict[str, float]:
    """Seconds of a run of site.yml over so many computers: by the clock, and of the processors."""
    path = WORK / "growth.yml"
    path.write_text(json.dumps(inventory(computers)) + "\n")  # JSON is YAML
    settings = {
        **os.environ,
        "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg"),
        "ANSIBLE_COLLECTIONS_PATH": str(ROOT / ".work/collections"),
        "ANSIBLE_CONNECTION_PLUGINS": str(ROOT / "tests/bench/connection"),
        "ANSIBLE_NOCOLOR": "1",
    }
    command = [str(Path(sys.executable).with_name("ansible-playbook")), "-i", str(path), "site.yml"]
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.run(command, cwd=ROOT, env=settings, capture_output=True, text=True, check=False)
    seconds, after = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode or "changed=0" not in done.stdout:
        sys.exit(f"growth: site.yml failed:\n{done.stdout[-3000:]}{done.stderr[-1000:]}")
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"computers": computers, "seconds": round(seconds, 2), "processor": round(spent, 2)}


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


def site_table(report: dict[str, Any]) -> str:
    """The second run of site.yml over a growing fleet, as a table of Markdown."""
    lines = ["| second `site.yml` | by the clock | processors | for each computer |", "|---|---|---|---|"]
    lines += [
        f"| {row['computers']} computers | {row['seconds']:.1f} s | {row['processor']:.1f} s"
        f" | {row['processor'] / row['computers']:.2f} s |"
        for row in report["site"]
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
    """The growth, drawn out of the report alone."""
    import picture  # first, since it says how matplotlib draws
    from matplotlib import pyplot

    figure, (site, verify) = pyplot.subplots(1, 2, figsize=(8, 3), layout="constrained")
    for key, label in (("seconds", "by the clock"), ("processor", "of the processors")):
        site.plot([row["computers"] for row in report["site"]], [row[key] for row in report["site"]], "o-", label=label)
    site.set(title="Controller: second site.yml", xlabel="computers", ylabel="seconds", xlim=(0, None), ylim=(0, None))
    for key in LIMITS:
        rows = report["functions"]
        verify.plot([row["computers"] ** 2 / 1000 for row in rows], [row[key] for row in rows], "o-", label=key)
    verify.set(title="Plan and judgement", xlabel="pairs of computers, in thousands", xlim=(0, None), ylim=(0, None))
    for place in (site, verify):
        place.grid(alpha=0.3)
        place.legend(frameon=False)
    picture.save(figure, path)


def main() -> None:
    """Measure, print and write; name what takes longer than is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", action="store_true", help="write the figures to docs/understand/performance")
    options = parser.parse_args()
    WORK.mkdir(parents=True, exist_ok=True)
    report: dict[str, Any] = {"machine": machine(), "site": [], "functions": []}
    for robots in ROBOTS:
        report["functions"].append(functions(robots))
    for computers in COMPUTERS:
        report["site"].append(second_run(computers))
    print(f"{site_table(report)}\n{functions_table(report)}", flush=True)
    for folder in [WORK] + [in_tree.FOLDER] * options.keep:
        folder.mkdir(parents=True, exist_ok=True)
        in_tree.write(report, folder / "growth.json")
        draw(report, folder / "growth.png")
    largest = report["functions"][-1]
    late = [f"{key}: {largest[key]} s, at most {limit} s" for key, limit in LIMITS.items() if largest[key] > limit]
    print("".join(f"growth: falls short: {line}\n" for line in late), end="")


if __name__ == "__main__":
    main()
