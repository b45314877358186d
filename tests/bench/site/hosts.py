# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The module hosts_entries beside blockinfile: 100 bindings of /etc/hosts on a computer of the lab, whole runs by turns.

python tests/bench/site/hosts.py [--repetitions 20]

Each turn begins with the file of the installer, so the first run changes it and the second one does not. Writes
.work/bench/hosts.json.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[3]
WORK = ROOT / ".work" / "bench"
sys.path[:0] = [str(ROOT / "lab"), str(Path(__file__).parent)]

from growth import machine  # noqa: E402
from machines import containers  # noqa: E402
from machines.layout import hosts_of, read_inventory  # noqa: E402
from machines.podman import environment  # noqa: E402

LAB = "bench-hosts"
ENTRIES = [{"address": f"10.1.0.{number}", "names": [f"robot{number}"]} for number in range(1, 101)]
BLOCK = "".join(f"{entry['address']}\t{entry['names'][0]}\n" for entry in ENTRIES)
TASKS = {
    "hosts_entries": {"rosfleet.multimaster.hosts_entries": {"entries": ENTRIES}},
    "blockinfile": {"ansible.builtin.blockinfile": {"path": "/etc/hosts", "block": BLOCK}},
}
CASES = ("changed", "unchanged")


def spent() -> float:
    """The seconds of processors of all ended children."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


class Comparison:
    """One computer, and the two playbooks."""

    def __init__(self) -> None:
        (host, *_others) = hosts_of(read_inventory(ROOT / "inventory" / "single_computer"), {})
        containers.bring_up(LAB, [host])
        self.container = containers.container(LAB, host.name)
        self.inventory = containers.write_inventory(LAB, [host])
        self.before = self.on("cat", "/etc/hosts")
        WORK.mkdir(parents=True, exist_ok=True)
        for name, task in TASKS.items():
            play = {"hosts": "all", "gather_facts": False, "become": True, "tasks": [{"name": name, **task}]}
            self.playbook(name).write_text(json.dumps([play]))  # JSON is YAML

    @staticmethod
    def playbook(name: str) -> Path:
        """The playbook with the one task."""
        return WORK / f"hosts-{name}.yml"

    def on(self, *command: str, stdin: str = "") -> str:
        """Run a command on the computer."""
        words = ["podman", "exec", "-i", self.container, *command]
        return subprocess.run(words, env=environment(), input=stdin, capture_output=True, text=True, check=True).stdout

    def run(self, name: str, case: str) -> tuple[float, float]:
        """Run a playbook: seconds by the clock, and of the controller's processors. Ends the program where it did not do that."""
        settings = {
            **os.environ,
            "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg"),
            "ANSIBLE_COLLECTIONS_PATH": str(ROOT / ".work/collections"),
            "ANSIBLE_NOCOLOR": "1",
        }
        command = [str(Path(sys.executable).with_name("ansible-playbook")), "-i", str(self.inventory)]
        before, began = spent(), time.monotonic()
        done = subprocess.run(
            [*command, str(self.playbook(name))], cwd=ROOT, env=settings, capture_output=True, text=True, check=False
        )
        seconds, processor = time.monotonic() - began, spent() - before
        if done.returncode or f"changed={int(case == 'changed')}" not in done.stdout:
            sys.exit(f"hosts: {name}, {case}:\n{done.stdout[-2000:]}{done.stderr[-1000:]}")
        return seconds, processor

    def turn(self, names: Sequence[str]) -> list[dict[str, Any]]:
        """Run each playbook on the file of the installer, and once more."""
        found = []
        for name in names:
            self.on("sh", "-c", "cat >/etc/hosts", stdin=self.before)
            for case in CASES:
                seconds, processor = self.run(name, case)
                found.append({"name": name, "case": case, "seconds": seconds, "processor": processor})
        return found


def table(runs: Sequence[dict[str, Any]]) -> str:
    """The medians, and how many times the time of blockinfile they are."""
    lines = [f"{'':<12}{'':<16}{'by the clock':>14}{'controller':>14}   (medians of whole runs)"]
    for case in CASES:
        of = {
            name: [
                statistics.median(run[figure] for run in runs if (run["name"], run["case"]) == (name, case))
                for figure in ("seconds", "processor")
            ]
            for name in TASKS
        }
        lines += [f"{case:<12}{name:<16}{clock:>12.3f} s{own:>12.3f} s" for name, (clock, own) in of.items()]
        ratio = [mine / other for mine, other in zip(of["hosts_entries"], of["blockinfile"])]
        lines.append(f"{'':<12}{'times':<16}{ratio[0]:>12.2f}  {ratio[1]:>12.2f}")
    return "\n".join(lines)


def main() -> None:
    """Compare, print, and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=20, help="turns (default: %(default)s)")
    options = parser.parse_args()
    with containers.remove_at_end(LAB):
        comparison = Comparison()
        comparison.turn(list(TASKS))  # the first login takes longer
        runs = []
        for number in range(options.repetitions):
            runs += comparison.turn(list(TASKS)[:: 1 if number % 2 else -1])
    (WORK / "hosts.json").write_text(json.dumps({"machine": machine(), "runs": runs}, indent=1) + "\n")
    print(table(runs))


if __name__ == "__main__":
    main()
