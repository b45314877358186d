# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The second run of site.yml beside a playbook that does the same with the usual tasks, on the same systems of the lab.

python tests/bench/site/site.py
python tests/bench/site/site.py --stages 2

The second form is for site.yml alone: its first run, its second one, and the verification, each so often.

What site.yml brings to the systems is read off them (the difference of two snapshots) and becomes the input of
conventional.yml. Both are shown to bring the same: conventional.yml makes that difference anew out of nothing, and
afterwards neither playbook finds anything to change. Then both run by turns, over the same connections.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import statistics
import subprocess
import sys
import time
import zipfile
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[3]
WORK = ROOT / ".work" / "bench"
LAB_FOLDER = ROOT / "lab"
sys.path[:0] = [str(LAB_FOLDER), str(Path(__file__).parent), str(Path(__file__).parents[1])]

import pace  # noqa: E402
import snapshot  # noqa: E402
from growth import machine  # noqa: E402
from machines import containers  # noqa: E402
from machines.layout import hosts_of, read_inventory  # noqa: E402
from machines.podman import LabError, environment, podman  # noqa: E402

WANTED = 5.0  # times faster
OURS, THEIRS = "site.yml", "tests/bench/site/conventional.yml"
NAMES = {OURS: "site.yml", THEIRS: "conventional.yml"}
NODES = "nodes"  # what tasks about their files have in their name
SHOWN = 0.5  # seconds of a task
WHEEL = "ansible==12.3.0"  # has ansible.posix; only that is unpacked

DROP_IN = "/etc/sysctl.d/90-rosfleet-multimaster.conf"
LIBRARY = "/usr/local/lib/rosfleet-multimaster"
CONFIGURATION = "/etc/rosfleet-multimaster"
RECORDS = "/var/lib/rosfleet-multimaster"
ASIDE = "/var/tmp/records"
# What belongs to the way of working, and not to what is brought.
OWN_AFFAIRS = (RECORDS, "/run/rosfleet-multimaster")
# Run on the computers: what a person or a playbook wrote there.
READ = """
import json, os, sys
found = {}
for path in json.load(sys.stdin):
    with open(path) as file:
        found[path] = {"content": file.read(), "mode": "%04o" % (os.stat(path).st_mode & 0o7777)}
json.dump(found, sys.stdout)
"""


class BenchError(Exception):
    """The comparison cannot be made; the text says why."""


@dataclass(frozen=True)
class Run:
    """One run of a playbook."""

    seconds: float
    tasks: Sequence[Mapping[str, Any]]
    stolen: float = 0.0  # seconds of all cores that the host took meanwhile

    @property
    def changed(self) -> list[str]:
        """The tasks that changed something, with their hosts."""
        return [f"{task['task']} ({', '.join(task['changed'])})" for task in self.tasks if task["changed"]]


@dataclass(frozen=True)
class Bench:
    """The lab, and how its systems are reached."""

    lab: str
    hosts: Sequence[str]
    inventories: Sequence[Path]

    def play(self, playbook: str) -> Run:
        """Run a playbook. Raises BenchError with the end of its output when it fails."""
        times = WORK / "times.json"
        for path in (times, Path(f"{times}.ssh")):
            path.unlink(missing_ok=True)
        settings = {
            **os.environ,
            "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg"),
            "ANSIBLE_COLLECTIONS_PATH": f"{ROOT / '.work/collections'}:{WORK / 'collections'}",
            "ANSIBLE_CALLBACK_PLUGINS": str(ROOT / "tests/bench/callbacks"),
            "ANSIBLE_CALLBACKS_ENABLED": "task_times",
            "ANSIBLE_NOCOLOR": "1",
            "TASK_TIMES_FILE": str(times),
            "TASK_TIMES_SYSTEMS": ":".join(self.accounts()),
        }
        options = [word for path in self.inventories for word in ("-i", str(path))]
        command = [str(Path(sys.executable).with_name("ansible-playbook")), *options, playbook]
        start, taken = time.monotonic(), pace.stolen()
        done = subprocess.run(
            command, cwd=ROOT, env=settings, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
        )
        seconds = time.monotonic() - start
        if done.returncode:
            raise BenchError(f"{playbook} failed:\n{done.stdout[-6000:]}")
        return Run(seconds, json.loads(times.read_text()), pace.stolen() - taken)

    def accounts(self) -> list[str]:
        """The files in which the kernel counts the processors' time of the systems; none where it does not."""
        names = [containers.container(self.lab, host) for host in self.hosts]
        found = podman("inspect", "--type=container", "--format={{.Id}}", *names).split()
        folder = Path("/sys/fs/cgroup/cpuacct/libpod_parent")
        files = [folder / f"libpod-{identity}" / "cpuacct.usage" for identity in found]
        return [str(path) for path in files if path.exists()]

    def on(self, host: str, *command: str, stdin: str = "") -> str:
        """Run a command on a computer."""
        done = subprocess.run(
            ["podman", "exec", "-i", containers.container(self.lab, host), *command],
            env=environment(),
            input=stdin,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise BenchError(f"{host}: {' '.join(command[:3])} failed: {done.stderr.strip()}")
        return done.stdout

    def everywhere(self, *command: str, stdin: str = "") -> dict[str, str]:
        """Run a command on all computers: host -> what it printed."""
        with ThreadPoolExecutor(max_workers=4) as pool:
            return dict(zip(self.hosts, pool.map(lambda host: self.on(host, *command, stdin=stdin), self.hosts)))

    def snapshots(self) -> dict[str, Any]:
        """The state of all computers (lab/snapshot.py)."""
        script = Path(snapshot.__file__).read_text()
        return {host: json.loads(text) for host, text in self.everywhere("python3", "-", stdin=script).items()}

    def routes(self) -> dict[str, dict[str, str]]:
        """The routes by a gateway on all computers: host -> destination -> gateway."""
        found = self.everywhere("ip", "-json", "-4", "route")
        return {
            host: {route["dst"]: route["gateway"] for route in json.loads(text) if "gateway" in route}
            for host, text in found.items()
        }

    def read(self, host: str, paths: Iterable[str]) -> dict[str, dict[str, str]]:
        """Text files of a computer: path -> content and mode."""
        return json.loads(self.on(host, "python3", "-c", READ, stdin=json.dumps(list(paths))))


def say(text: str) -> None:
    """A line of progress."""
    print(f"bench: {text}", flush=True)


def fetch_posix() -> None:
    """Unpack ansible.posix, which ansible-core does not bring."""
    target = WORK / "collections"
    if (target / "ansible_collections/ansible/posix/plugins").is_dir():
        return
    say(f"fetching ansible.posix out of {WHEEL} ...")
    downloads = WORK / "downloads"
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", str(downloads), WHEEL]
    subprocess.run(command, check=True)
    (wheel,) = downloads.glob("ansible-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        prefix = "ansible_collections/ansible/posix/"
        archive.extractall(target, [name for name in archive.namelist() if name.startswith(prefix)])
    shutil.rmtree(downloads)


def brought(before: Mapping[str, str], after: Mapping[str, str]) -> dict[str, str]:
    """The files and folders that are new or other than before, without our records: path -> entry of the snapshot."""
    return {
        path: entry
        for path, entry in sorted(after.items())
        if before.get(path) != entry and not path.startswith(OWN_AFFAIRS)
    }


def inputs(
    bench: Bench, host: str, change: Mapping[str, str], routes: Iterable[tuple[str, str]], hosts_before: str
) -> dict[str, Any]:
    """The variables with which conventional.yml brings the same to a computer."""
    paths = [path for path, entry in change.items() if entry.startswith("-") and not path.startswith(LIBRARY)]
    files = bench.read(host, paths)
    hosts_after = files.pop("/etc/hosts", {"content": hosts_before})["content"].splitlines()
    settings = [line.split("=", 1) for line in files.pop(DROP_IN)["content"].splitlines() if line[:1] not in ("#", "")]
    wanted: dict[str, list[dict[str, str]]] = defaultdict(list)
    for path, file in files.items():
        if path.startswith("/etc/systemd/system/"):
            kind = "units"
        elif path.startswith(CONFIGURATION) and path.endswith(".json"):
            kind = "parameters"
        elif path.startswith(("/etc/network/", "/etc/systemd/network/", "/etc/netplan/")):
            kind = "boot"
        else:
            kind = "environment"
        wanted[kind].append({"path": path, **file})
    folders = [
        {"path": path, "mode": "0755"}
        for path, entry in change.items()
        if entry.startswith("d") and not path.startswith(f"{LIBRARY}/")
    ]
    units = [Path(unit["path"]).name for unit in wanted["units"]]
    order = ("roscore", "discovery", "sync")
    return {
        "conventional_sysctl": [{"name": name.strip(), "value": value.strip()} for name, value in settings],
        "conventional_routes": [{"destination": destination, "gateway": gateway} for destination, gateway in routes],
        "conventional_hosts": [line for line in hosts_after if line not in hosts_before.splitlines()],
        "conventional_hosts_gone": [line for line in hosts_before.splitlines() if line not in hosts_after],
        "conventional_folders": folders,
        "conventional_services": sorted(units, key=lambda unit: [name in unit for name in order].index(True)),
        **{f"conventional_{kind}": wanted[kind] for kind in ("boot", "environment", "parameters", "units")},
    }


def copy_nodes(target: Path) -> None:
    """The files of the role `nodes`, as they are installed."""
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(ROOT / "roles" / "nodes" / "files", target, ignore=shutil.ignore_patterns("__pycache__", "*.pyc"))
    for path in target.rglob("*"):
        path.chmod(0o755 if path.is_dir() or path.stat().st_mode & 0o100 else 0o644)


def without_form(state: dict[str, Any], bench: Bench, host: str) -> dict[str, Any]:
    """A snapshot in which order and form do not count: lines of the hosts file, settings of the drop-in."""
    files = {**state["file"]}
    for path in ("/etc/hosts", DROP_IN):
        if path in files:
            lines = bench.read(host, [path])[path]["content"].splitlines()
            files[path] = "\n".join(sorted("".join(line.split()) for line in lines if line[:1] not in ("#", "")))
    return {**state, "file": {path: entry for path, entry in files.items() if not path.startswith(OWN_AFFAIRS)}}


def differences(bench: Bench, one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """The differences between two states, a line each, without form and without our records."""
    return [f"{host}: {line}" for host in bench.hosts for line in snapshot.compare(one[host], other[host])]


def unchanged(run: Run, name: str) -> None:
    """Raise BenchError when a run changed something."""
    if run.changed:
        raise BenchError(f"{name} changed something that the other playbook had brought: {'; '.join(run.changed)}")


def prepare(bench: Bench) -> None:
    """site.yml, then the same by conventional.yml out of nothing; raise BenchError unless both bring the same."""
    before, routes_before = bench.snapshots(), bench.routes()
    hosts_before = bench.everywhere("cat", "/etc/hosts")
    say("site.yml, for the first time ...")
    bench.play(OURS)
    unchanged(bench.play(OURS), "the second run of site.yml")
    say("reading off the systems what it brought ...")
    after, routes_after = bench.snapshots(), bench.routes()
    form = {host: without_form(after[host], bench, host) for host in bench.hosts}
    variables = {
        host: inputs(
            bench,
            host,
            brought(before[host]["file"], after[host]["file"]),
            routes_after[host].items() - routes_before[host].items(),
            hosts_before[host],
        )
        for host in bench.hosts
    }
    copy_nodes(WORK / "nodes")
    shared = {
        "conventional_sysctl_file": DROP_IN,
        "conventional_nodes": str(WORK / "nodes"),
        "conventional_library": LIBRARY,
    }
    listing = {"all": {"hosts": variables, "vars": shared}}
    bench.inventories[-1].write_text(json.dumps(listing, indent=1) + "\n")  # JSON is YAML

    say("teardown.yml, then the same out of nothing by conventional.yml ...")
    bench.everywhere("cp", "-a", RECORDS, ASIDE)
    bench.play("playbooks/teardown.yml")
    bench.play(THEIRS)
    anew = bench.snapshots()
    found = differences(bench, form, {host: without_form(anew[host], bench, host) for host in bench.hosts})
    if found:
        raise BenchError("the two playbooks do not bring the same:\n  " + "\n  ".join(found[:40]))
    bench.everywhere("sh", "-c", f"rm -rf {RECORDS} && mv {ASIDE} {RECORDS}")
    say("site.yml once more: only the form of the file of kernel settings may change ...")
    touched = [text for text in bench.play(OURS).changed if "kernel settings" not in text]
    if touched:
        raise BenchError(f"site.yml changed what conventional.yml had brought: {'; '.join(touched)}")


def measure(bench: Bench, repetitions: int) -> dict[str, list[Run]]:
    """Both playbooks by turns, the first one changing from turn to turn; raise BenchError when one changes something."""
    runs: dict[str, list[Run]] = {OURS: [], THEIRS: []}
    for turn in range(repetitions):
        for playbook in (OURS, THEIRS) if turn % 2 == 0 else (THEIRS, OURS):
            run = bench.play(playbook)
            unchanged(run, NAMES[playbook])
            runs[playbook].append(run)
            say(f"{NAMES[playbook]}: {run.seconds:.1f} s, changed=0")
    return runs


def seconds(runs: Sequence[Run]) -> list[float]:
    """The wall times."""
    return [run.seconds for run in runs]


def ratio(runs: Mapping[str, Sequence[Run]], without: str = "") -> float:
    """The factor by which site.yml is faster, by the medians; without the tasks that have a word in their name, if asked."""
    ours, theirs = (
        statistics.median(
            run.seconds - sum(task["seconds"] for task in run.tasks if without and without in task["task"])
            for run in runs[playbook]
        )
        for playbook in (OURS, THEIRS)
    )
    return theirs / ours


def table(runs: Mapping[str, Sequence[Run]], hosts: int) -> str:
    """The figures, and where the time goes."""
    lines = [f"Second run (nothing to change) on {hosts} systems, {len(runs[OURS])} runs each, by turns:", ""]
    lines.append(f"  {'':<20}{'median':>10}{'range':>18}{'results per host':>19}")
    for playbook, name in NAMES.items():
        taken = seconds(runs[playbook])
        results = sum(task["results"] for task in runs[playbook][0].tasks) / hosts
        span = f"{min(taken):.1f} - {max(taken):.1f} s"
        lines.append(f"  {name:<20}{statistics.median(taken):>8.1f} s{span:>18}{results:>19.1f}")
    lines += [
        "",
        f"  site.yml is {ratio(runs):.1f} times faster (at least {WANTED:.0f} is asked for).",
        f"  Without the files of the nodes on both sides, which one task copies file by file: {ratio(runs, NODES):.1f} times.",
    ]
    for playbook, name in NAMES.items():
        lines += ["", f"  tasks of {name} that take {SHOWN} s and more (median):"]
        taken = defaultdict(list)
        for run in runs[playbook]:
            for number, task in enumerate(run.tasks):
                taken[number, task["task"]].append(task["seconds"])
        lines += [
            f"    {statistics.median(values):6.1f} s  {task}"
            for (_number, task), values in taken.items()
            if statistics.median(values) >= SHOWN
        ]
    return "\n".join(lines) + "\n"


PARTS = ("controller", "transfers", "systems")


def places(runs: Mapping[str, Sequence[Run]]) -> str:
    """The seconds by their place: of the clock, and of the processors on each side. The rest of the cores' time was waited."""
    cores = os.cpu_count() or 1
    lines = ["Seconds of processors in a run (median), by where they are spent:", ""]
    lines.append(f"  {'':<20}{'by the clock':>14}" + "".join(f"{part:>13}" for part in PARTS) + f"{'idle':>9}")
    for playbook, name in NAMES.items():
        taken = [statistics.median(sum(task[part] for task in run.tasks) for run in runs[playbook]) for part in PARTS]
        clock = statistics.median(seconds(runs[playbook]))
        idle = max(0.0, cores * clock - sum(taken))
        lines.append(
            f"  {name:<20}{clock:>12.1f} s" + "".join(f"{value:>11.1f} s" for value in taken) + f"{idle:>7.1f} s"
        )
    return "\n".join([*lines, "", "  idle: waits, and whatever else ran on this machine.", ""])


def report(runs: Mapping[str, Sequence[Run]], hosts: int) -> dict[str, Any]:
    """All that was measured, for the JSON file."""
    each = {
        NAMES[playbook]: [{"seconds": run.seconds, "tasks": list(run.tasks)} for run in runs[playbook]]
        for playbook in runs
    }
    return {"machine": machine(), "systems": hosts, "runs": each}


def picture(runs: Mapping[str, Sequence[Run]]) -> str:
    """One bar per playbook, one dot per run."""
    longest = max(second for playbook in runs for second in seconds(runs[playbook]))
    rows = []
    for row, (playbook, name) in enumerate(NAMES.items()):
        y, median = 40 + 50 * row, statistics.median(seconds(runs[playbook]))
        rows.append(f'<text x="140" y="{y + 5}" text-anchor="end">{name}</text>')
        rows.append(f'<rect x="150" y="{y - 12}" width="{400 * median / longest:.1f}" height="24" fill="#9bd"/>')
        rows += [
            f'<circle cx="{150 + 400 * value / longest:.1f}" cy="{y}" r="3" fill="#035"/>'
            for value in seconds(runs[playbook])
        ]
        rows.append(f'<text x="640" y="{y + 5}" text-anchor="end">{median:.1f} s</text>')
    title = f"Second run on the systems of the lab: site.yml is {ratio(runs):.1f} times faster"
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" width="660" height="130" font-family="sans-serif" font-size="13">\n'
        f'<text x="10" y="16">{title}</text>\n' + "\n".join(rows) + "\n</svg>\n"
    )


STAGES = {"first site.yml": OURS, "second site.yml": OURS, "verify": "playbooks/verify.yml"}


def stages(on_lab: Bench, rounds: int) -> str:
    """The first run, the second one and the verification; between two rounds teardown.yml takes everything back."""
    runs: dict[str, list[Run]] = {name: [] for name in STAGES}
    references = []
    for number in range(rounds):
        if number:
            on_lab.play("playbooks/teardown.yml")
        references.append(pace.reference())
        for name, playbook in STAGES.items():
            runs[name].append(on_lab.play(playbook))
            say(f"{name}: {runs[name][-1].seconds:.1f} s")
    measured = {name: [vars(run) for run in of] for name, of in runs.items()}
    (WORK / "stages.json").write_text(
        json.dumps({"machine": machine(), "references": references, "runs": measured}, indent=1) + "\n"
    )
    lines = [f"Seconds by the clock and of processors, {rounds} runs each (median), {len(on_lab.hosts)} systems."]
    lines.append(f"The pace of the machine before each round: {', '.join(f'{value:.2f}' for value in references)} s.")
    for name, of in runs.items():
        clock = statistics.median(run.seconds for run in of)
        sums = [statistics.median(sum(task[part] for task in run.tasks) for run in of) for part in PARTS]
        stolen = statistics.median(run.stolen for run in of)
        said = f"{clock:.1f} s by the clock, {sum(sums):.1f} s of processors, {stolen:.1f} s taken by the host"
        lines += ["", f"  {name}: {said}", ""]
        lines.append(f"  {'clock':>8}" + "".join(f"{part:>12}" for part in PARTS) + "  task")
        for number, task in enumerate(of[0].tasks):
            same = [run.tasks[number] for run in of if number < len(run.tasks)]
            values = [statistics.median(one[part] for one in same) for part in ("seconds", *PARTS)]
            lines.append(
                f"  {values[0]:>8.2f}" + "".join(f"{value:>12.2f}" for value in values[1:]) + f"  {task['task']}"
            )
    return "\n".join(lines) + "\n"


def lab_of(layout: str, lab: str) -> Bench:
    """Bring the lab up."""
    WORK.mkdir(parents=True, exist_ok=True)
    inventory = ROOT / "inventory" / layout
    hosts = hosts_of(read_inventory(inventory), {})
    containers.take_down(lab)
    containers.bring_up(lab, hosts)
    inventories = [inventory, containers.write_inventory(lab, hosts), WORK / "conventional.yml"]
    inventories[-1].write_text("{}\n")
    return Bench(lab, [host.name for host in hosts], inventories)


def bench(on_lab: Bench, repetitions: int) -> bool:
    """Compare, print; True when site.yml is fast enough."""
    fetch_posix()
    prepare(on_lab)
    runs = measure(on_lab, repetitions)
    text = table(runs, len(on_lab.hosts)) + "\n" + places(runs)
    (WORK / "site.json").write_text(json.dumps(report(runs, len(on_lab.hosts)), indent=1) + "\n")
    print(f"\n{text}", flush=True)
    (WORK / "site.txt").write_text(text)
    (WORK / "site.svg").write_text(picture(runs))
    say(f"the same in {WORK / 'site.txt'} and {WORK / 'site.svg'}")
    return ratio(runs) >= WANTED


def main() -> int:
    """Exit status 0 only when site.yml is at least five times faster."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--layout", default="multi_computer", help="a folder of inventory/ (default: %(default)s)")
    parser.add_argument("--name", default="bench", help="the name of the lab (default: %(default)s)")
    parser.add_argument("--repetitions", type=int, default=3, help="runs of each playbook (default: %(default)s)")
    parser.add_argument("--stages", type=int, default=0, metavar="N", help="N runs of site.yml and verify.yml alone")
    parser.add_argument("--keep", action="store_true", help="leave the lab up")
    options = parser.parse_args()
    removed = contextlib.nullcontext() if options.keep else containers.remove_at_end(options.name)
    try:
        with removed:
            on_lab = lab_of(options.layout, options.name)
            if not options.stages:
                return int(not bench(on_lab, options.repetitions))
            text = stages(on_lab, options.stages)
            print(f"\n{text}", flush=True)
            (WORK / "stages.txt").write_text(text)
            return 0
    except (BenchError, LabError) as error:
        print(f"bench: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
