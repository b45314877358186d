# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The demonstration: the shipped inventory of a layout, on real systems, from nothing to a fleet that talks.

python lab/demo.py --layout single_computer
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from machines import containers
from machines.layout import choose_suites, hosts_of, read_inventory, robots_of, wants_packages
from machines.memory import Peak
from machines.podman import LabError
from progress import say
from proofs.matrix import everybody
from proofs.proof import NODES, Computer, Result, prove, table
from proofs.twins import distinguish_twins

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Run:
    """One run of a playbook: its end, its duration, its tasks and changes on each host."""

    status: int
    seconds: float
    modules: dict[str, int]
    changed: dict[str, int]


def playbook(name: str, inventory: Path, connection: Path, *options: str) -> Run:
    """Run a playbook with the shipped inventory; only the connection variables come from the lab."""
    counts = connection.with_name("module_runs.json")
    counts.unlink(missing_ok=True)
    environment = {
        **os.environ,
        "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg"),
        "ANSIBLE_CALLBACK_PLUGINS": str(ROOT / "lab/callbacks"),
        "ANSIBLE_CALLBACKS_ENABLED": "module_runs",
        "MODULE_RUNS_FILE": str(counts),
    }
    command = [Path(sys.executable).with_name("ansible-playbook"), "-i", inventory, "-i", connection, name, *options]
    start = time.monotonic()
    status = subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode
    seconds = time.monotonic() - start
    counted = json.loads(counts.read_text()) if counts.exists() else {"runs": {}, "changed": {}}
    return Run(status, seconds, counted["runs"], counted["changed"])


def person(connection: Path, names: Iterable[str]) -> list[Computer]:
    """Computers of the lab, as the user `operator` reaches them by ssh."""
    hosts = json.loads(connection.read_text())["all"]["hosts"]
    return [
        Computer(
            name,
            (
                "ssh",
                *shlex.split(hosts[name]["ansible_ssh_common_args"]),
                *("-i", hosts[name]["ansible_ssh_private_key_file"]),
                f"operator@{hosts[name]['ansible_host']}",
            ),
        )
        for name in names
    ]


def choose_computers(listing: Mapping[str, Any]) -> list[str]:
    """A computer of each robot: an inner one that runs no roscore, if there is one."""
    variables = listing["_meta"]["hostvars"]

    def is_plain(name: str) -> bool:
        return name not in (variables[name].get("multimaster_gateway"), variables[name].get("multimaster_master"))

    return [max(computers, key=is_plain) for computers in robots_of(listing).values()]


def prove_all(listing: Mapping[str, Any], connection: Path) -> list[Result]:
    """Prove that everybody reaches everybody, as the report does."""
    say("any two computers, by ssh as an ordinary user, with nodes that know nothing of the collection")
    matrix = everybody(person(connection, itertools.chain(*robots_of(listing).values())))
    print(matrix.table(), flush=True)
    say("section 3.3 of the report between every pair of robots, in the same way")
    results = prove(person(connection, choose_computers(listing)), lambda text: print(f"  {text} ...", flush=True))
    print(table(results), flush=True)
    return [*matrix.list_results(), *results]


def prove_twins(listing: Mapping[str, Any], connection: Path) -> list[Result]:
    """Prove that the station distinguishes robots of one kind; robots of other kinds see nothing of each other."""
    say(
        "the same programs on each robot; rostopic, rosservice, actionlib and tf2 at the station, which know nothing of the relay"
    )
    computers = {robot: person(connection, names)[0] for robot, names in robots_of(listing).items()}
    station = computers.pop("station")
    with contextlib.ExitStack() as stack:
        for computer in computers.values():
            stack.enter_context(computer.start_program("python3 -", NODES / "programs/twin_robot.py", seconds=600))
        results = list(distinguish_twins(computers, station))
    print(table(results), flush=True)
    return results


#: The proof of a layout, if it is another one than that everybody reaches everybody.
PROOFS = {"identical_robots": prove_twins}


def figures(runs: dict[str, Run], systems: int, peak: int) -> str:
    """The table of wall times, module runs and memory."""
    lines = []
    for what, run in runs.items():
        modules = sorted(set(run.modules.values()))
        per_host = "-".join(str(number) for number in (modules[:1] + modules[-1:] if len(modules) > 1 else modules))
        changed = sum(run.changed.values())
        lines.append(
            f"  {what:<24}{run.seconds:7.1f} s   {per_host or '0':>3} module runs per host   changed={changed}"
        )
    lines.append(
        f"  memory of {systems} systems    {peak / 2**20:5.0f} MiB at most (anonymous memory of all their processes, every second)"
        if peak
        else "  memory of the systems: this machine does not account it by container"
    )
    return "\n".join(lines)


def demonstrate(layout: str, lab: str, suites: Iterable[str]) -> bool:
    """Bring the lab up, run site.yml, verify, make the tests of the report, run site.yml again; True when all is well."""
    inventory = ROOT / "inventory" / layout
    say(f"the lab: the computers of inventory/{layout} as containers with real systemd and ROS")
    listing = read_inventory(inventory)
    hosts = choose_suites(hosts_of(listing), suites)
    print("\n".join(f"  {host.name:<24}Debian {host.suite}" for host in hosts), flush=True)
    full = layout in PROOFS or wants_packages(listing["_meta"]["hostvars"].values())  # tf2 is in the full image
    containers.bring_up(lab, hosts, full=full)
    connection = containers.write_inventory(lab, hosts)
    report = connection.with_name("report.html")
    report.unlink(missing_ok=True)

    with Peak(lab) as peak:
        say("site.yml: make the fleet talk")
        runs = {"site run": playbook("site.yml", inventory, connection)}
        if runs["site run"].status:
            return False
        say("verify.yml: prove it")
        runs["verification"] = playbook(
            "playbooks/verify.yml", inventory, connection, "-e", f"verify_report={report.with_suffix('.json')}"
        )
        results = PROOFS.get(layout, prove_all)(listing, connection)
        say("site.yml once more: nothing is left to change")
        runs["second site run"] = playbook("site.yml", inventory, connection)

    unchanged = not any(runs["second site run"].changed.values())
    well = {
        "site run": runs["site run"].status == 0,
        "verification": runs["verification"].status == 0 and report.exists(),
        "what the robots have of each other": all(result.ok for result in results),
        "second site run changed nothing": runs["second site run"].status == 0 and unchanged,
    }
    say("figures")
    print(figures(runs, len(hosts), peak.bytes))
    say("result")
    for what, ok in well.items():
        print(f"  {'ok    ' if ok else 'FAILED'}  {what}")
    passed = sum(result.ok for result in results)
    print(
        f"\ndemo: {passed} passed, {len(results) - passed} failed; look around: .work/venv/bin/python lab/lab.py shell HOST; "
        f"remove it: make lab-down\nThe report of the verification, for your browser:\n{report}",
        flush=True,
    )
    return all(well.values())


def main() -> int:
    """Exit status 0 only when every check passed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--layout", default="single_computer", help="a folder of inventory/ (default: %(default)s)")
    parser.add_argument("--name", default="demo", help="the name of the lab (default: %(default)s)")
    parser.add_argument(
        "--suite",
        metavar="[HOST=]SUITE",
        action="append",
        default=[],
        help="Debian's release of all computers, or of one",
    )
    options = parser.parse_args()
    layout = options.layout
    if not (ROOT / "inventory" / layout).is_dir():
        layouts = ", ".join(sorted(path.name for path in (ROOT / "inventory").iterdir() if path.is_dir()))
        print(f"demo: there is no layout {layout}; expected one of {layouts}", file=sys.stderr)
        return 2
    try:
        return int(not demonstrate(layout, options.name, options.suite))
    except LabError as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
