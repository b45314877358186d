# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The matrix: versions of ansible-core on the controller, releases of Debian and places of ROS on the robots.

    python tests/matrix/run.py [--core LINE]... [--robots KIND]... [--page]

In each cell, the two robots of inventory/single_computer get site.yml, a second run that changes nothing, verify.yml and
teardown.yml, which leaves nothing. Each end is kept in .work/matrix, so a long run may be made of short ones; `--page`
writes the table of what is kept into docs/start/machines.md.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import cells
from controllers import NEWEST, ROOT, WORK, Controller, write_connection
from machines import containers
from machines.layout import choose_suites, hosts_of, read_inventory
from machines.podman import LabError, podman

# Since 2.20 a controller needs Python 3.12, which Debian 12 does not have.
CONTROLLERS = {
    line: Controller(line, in_image)
    for line, in_image in {"2.16": False, "2.18": False, "2.20": True, NEWEST: True}.items()
}
KEPT = WORK / "results.json"
INVENTORY = ROOT / "inventory" / "single_computer"
STEPS = {
    "site.yml": "site.yml",
    "the second run": "site.yml",
    "verify.yml": "playbooks/verify.yml",
    "teardown.yml": "playbooks/teardown.yml",
}
MAKE = "bash /usr/local/share/lab/make-opt-ros"
LEFT = "ls -d /etc/rosfleet-multimaster /usr/local/lib/rosfleet-multimaster /etc/systemd/system/multimaster-*.service 2> /dev/null; true"


def write_variables(kind: str) -> Path:
    """Write what the inventory of these robots says besides."""
    path = WORK / f"{kind}.yml"
    path.write_text(json.dumps({"robots": {"vars": dict(cells.ROBOTS[kind].variables)}}) + "\n")  # JSON is YAML
    return path


def try_cell(controller: Controller, kind: str, lab: str) -> str:
    """Run all steps of a cell on a lab that is as new; return how it ends."""
    robots = cells.ROBOTS[kind]
    hosts = choose_suites(hosts_of(read_inventory(INVENTORY)), [robots.suite])
    containers.bring_up(lab, hosts, full=False)
    if robots.shape:
        for host in hosts:
            podman("exec", containers.container(lab, host.name), "sh", "-c", f"{MAKE} {robots.shape}")
    connection = write_connection(containers.write_inventory(lab, hosts), controller)
    log = WORK / f"{controller.line}-{kind}.log"
    log.unlink(missing_ok=True)
    for step, playbook in STEPS.items():
        status, output = controller.play([INVENTORY, write_variables(kind), connection], playbook, log)
        problem = cells.find_problem(status, output, unchanged=step == "the second run")
        if problem:
            print(f"  {step} {problem}: {log}", flush=True)
            return f"{step} {problem}"
    left = "".join(podman("exec", containers.container(lab, host.name), "sh", "-c", LEFT) for host in hosts)
    return f"teardown.yml leaves {' '.join(left.split())}" if left else cells.OK


def try_cells(lines: Sequence[str], kinds: Sequence[str], lab: str) -> bool:
    """Try these cells, and keep each end; True when all are well."""
    ends = []
    for line in lines:
        CONTROLLERS[line].install()
    for kind in kinds:
        for line in lines:
            controller, began = CONTROLLERS[line], time.monotonic()
            with containers.remove_at_end(lab):
                end = try_cell(controller, kind, lab)
            kept = cells.read(KEPT)
            cells.note(kept, line, controller.version, controller.python, kind, end)
            cells.write(KEPT, kept)
            print(f"ansible-core {controller.version}, {kind}: {end} ({time.monotonic() - began:.0f} s)", flush=True)
            ends.append(end)
    return all(end == cells.OK for end in ends)


def parse_options(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--core", action="append", choices=list(CONTROLLERS), help="only this version of ansible-core")
    parser.add_argument("--robots", action="append", choices=list(cells.ROBOTS), help="only robots of this kind")
    parser.add_argument("--lab", metavar="NAME", default="matrix", help="the name of the lab")
    parser.add_argument("--page", action="store_true", help="write the table into docs/start/machines.md")
    return parser.parse_args(words)


def main() -> int:
    """Exit status 0 only when each cell is well."""
    options = parse_options()
    WORK.mkdir(parents=True, exist_ok=True)
    try:
        well = try_cells(options.core or list(CONTROLLERS), options.robots or list(cells.ROBOTS), options.lab)
    except (LabError, subprocess.SubprocessError) as problem:
        print(f"matrix: {problem}", file=sys.stderr)
        return 1
    if options.page:
        page = cells.fill(cells.PAGE.read_text(encoding="utf-8"), cells.table(list(CONTROLLERS), cells.read(KEPT)))
        cells.PAGE.write_text(page, encoding="utf-8")
    return int(not well)


if __name__ == "__main__":
    sys.exit(main())
