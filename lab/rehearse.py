# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A rehearsal: a user's own inventory on real systems in containers, from site.yml over a reboot to the teardown.

python lab/rehearse.py --inventory ~/fleet
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from machines import containers, image
from machines.layout import Extra, Host, choose_suites, hosts_of, read_inventory, wants_packages
from machines.managers import MANAGERS
from machines.podman import ROOT, LabError, podman
from machines.signals import exit_on_signals
from progress import say
from rehearsals import rehearsal
from rehearsals.cast import Fault, cast_faults, cast_of, judge_report
from rehearsals.inventory_files import environment, read

WORK = ROOT / ".work" / "rehearse"
LIMIT = 1800.0  # seconds for a playbook
SETTLES = 30.0  # seconds until a fault has its effect, at most
OF_THE_COLLECTION = (
    "/etc/rosfleet-multimaster /usr/local/lib/rosfleet-multimaster /var/lib/rosfleet-multimaster "
    "/etc/systemd/system/multimaster-*.service"
)
ROSCORE = "foreign-roscore.service"


@dataclass(frozen=True)
class Preparation:
    """All that is known before anything is started."""

    rehearsed: rehearsal.Rehearsable
    hosts: list[Host]
    faults: list[Fault]
    wants_packages: bool = False

    @property
    def full(self) -> bool:
        """Return True if the computers need more packages than those of a demonstration."""
        return bool(self.faults) or self.wants_packages or any(MANAGERS[host.manager].full for host in self.hosts)


def machine() -> rehearsal.Machine:
    """Look at this machine."""
    routes = json.loads(subprocess.run(["ip", "-json", "route"], capture_output=True, text=True, check=True).stdout)
    names = podman("network", "ls", "--quiet", "--format", "{{.Name}}").split()
    networks = json.loads(podman("network", "inspect", *names)) if names else []
    memory = re.search(r"^MemAvailable: +(\d+)", Path("/proc/meminfo").read_text(), re.MULTILINE)
    return rehearsal.Machine(
        tuple(rehearsal.networks_of(routes, networks, f"{containers.CHECKOUT}-")),
        int(memory[1]) // 1024 if memory else 0,
    )


def prepare(options: argparse.Namespace, work: Path) -> Preparation:
    """Read the inventory, name the things that are left aside, and refuse those that cannot be rehearsed."""
    say(f"the inventory {options.inventory}: the values that the robots need")
    reading = read(options.inventory, work, rehearsal.OPTIONS)
    hosts = list(reading.values.get("variables") or reading.listing["_meta"]["hostvars"])
    aside = rehearsal.list_unused(reading.listing, hosts, reading.encrypted)
    print("\n".join(f"  left aside: {line}" for line in aside) or "  nothing is left aside", flush=True)
    problems = reading.values.get("problems")
    if problems:
        encrypted = " (The encrypted files above were not read.)" if reading.encrypted else ""
        raise LabError("site.yml would refuse this inventory:\n" + "\n".join(problems) + encrypted)

    found = rehearsal.make_rehearsable(reading.values)
    here = machine()
    problems = rehearsal.impossible(reading.values, found.devices, here, tuple(image.RELEASES))
    problems += [] if options.overlap else rehearsal.overlaps(reading.values, here)
    if problems:
        raise LabError("\n".join(problems))
    print("".join(f"  note: {note}\n" for note in found.notes), end="", flush=True)
    variables = reading.values["variables"]
    faults = cast_faults(options.faults, cast_of(reading.values["robots"], variables)) if options.faults else []

    (work / "inventory.yml").write_text(json.dumps(found.inventory, indent=1) + "\n")  # JSON is YAML
    listing = read_inventory(work / "inventory.yml")
    extras = {name: Extra(device.addresses) for name, device in found.devices.items()}
    extras |= {name: Extra((of.address,)) for name, of in found.sealed.items()}
    hosts = choose_suites(hosts_of(listing, extras), options.suites)
    return Preparation(found, hosts, faults, wants_packages(variables.values()))


@dataclass
class Rehearsal:
    """The containers of a rehearsal, and its steps."""

    name: str
    prepared: Preparation
    work: Path
    keep: bool = False  # leave a fleet that is set up
    connection: Path = Path()
    seconds: dict[str, float] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)
    report: Path | None = None  # the one to look at: the first with a fault, else the last

    @property
    def lab(self) -> str:
        return rehearsal.lab_of(self.name)

    def step(self, what: str, work: Callable[[], bool]) -> bool:
        """One step, with its time; True when it went well."""
        say(what)
        began = time.monotonic()
        try:
            ok = work()
        except LabError as problem:
            print(f"  {problem}", flush=True)
            ok = False
        self.seconds[what] = time.monotonic() - began
        if not ok:
            self.wrong.append(what)
        return ok

    def start(self) -> bool:
        """Start the containers, and the parts of the robots' world that are not the collection's."""
        containers.bring_up(self.lab, self.prepared.hosts, full=self.prepared.full)
        self.connection = containers.write_inventory(self.lab, self.prepared.hosts)
        for name, of in self.prepared.rehearsed.sealed.items():
            if of.gateway:
                self.run(name, f"ip route replace default via {of.gateway}")
        for host, port in self.prepared.rehearsed.roscores.items():
            self.run(
                host,
                f"sed 's/:11311/:{port}/; s/exec roscore/& -p {port}/' /usr/local/share/lab/{ROSCORE} > /etc/systemd/system/{ROSCORE}; "
                f"systemctl enable --quiet --now {ROSCORE}",
            )
        folder = self.work / "router_config"
        shutil.rmtree(folder, ignore_errors=True)
        if self.prepared.rehearsed.devices:
            variables = {"router_config_folder": str(folder), "router_config_dialects": ["linux"]}
            if not self.play("playbooks/router_config.yml", variables):
                return False
        return self.devices()

    def devices(self) -> bool:
        """Have the devices forward, and paste the commands of router_config.yml; they forget it at a reboot."""
        for name, device in self.prepared.rehearsed.devices.items():
            script = self.work / "router_config" / device.folder / "linux.sh"
            paste = script.read_text() if script.exists() else ""  # no robot has a network of its own
            self.run(name, f"sysctl --quiet --write net.ipv4.ip_forward=1\n{paste}")
        return True

    def run(self, host: str, command: str, *, check: bool = True) -> str:
        """Run a command as root of a computer."""
        return podman(
            "exec", "-i", containers.container(self.lab, host), "bash", "-l", stdin=command.encode(), check=check
        )

    def play(self, name: str, variables: dict[str, Any] | None = None) -> bool:
        """Run a playbook with the rehearsed inventory; a signal that ends this program ends it, too."""
        words = ["-i", self.work / "inventory.yml", *(["-i", self.connection] if self.connection.name else [])]
        extra = ["-e", json.dumps(variables)] if variables else []
        process = subprocess.Popen(
            [Path(sys.executable).with_name("ansible-playbook"), *words, name, *extra],
            cwd=ROOT,
            env=environment(),
            start_new_session=True,
        )
        try:
            return process.wait(LIMIT) == 0
        except BaseException:
            os.killpg(process.pid, signal.SIGTERM)
            raise
        finally:
            _wait_or_kill(process)

    def verify(self, label: str) -> bool:
        """Run verify.yml; its report is kept under a name of its own."""
        data = self.work / "reports" / f"{label}.json"
        for path in (data, data.with_suffix(".html")):
            path.unlink(missing_ok=True)
        ok = self.play("playbooks/verify.yml", {"verify_report": str(data), "verify_junit": ""})
        if data.with_suffix(".html").exists() and not self.wrong:
            self.report = data.with_suffix(".html")
        return ok

    def reboot(self) -> bool:
        """Reboot all computers: addresses, routes and kernel settings are those of files."""
        containers.restart(self.lab)
        return self.devices()

    def fault(self, fault: Fault) -> bool:
        """Inject a fault, see whether the verification names it first, and take it back."""
        try:
            for step in fault.inject:
                self.run(step.where, step.what)
            for step in fault.settled:
                self.run(
                    step.where,
                    f"for time in $(seq {SETTLES:.0f}); do {{ {step.what}; }} && exit; sleep 1; done; exit 1",
                )
            before, label = self.report, f"fault-{fault.name}"
            self.verify(label)
            self.report = before
        finally:
            for step in fault.undo:
                self.run(step.where, step.what, check=False)
        data = self.work / "reports" / f"{label}.json"
        ok, text = judge_report(fault, json.loads(data.read_text()) if data.exists() else {})
        print(f"  {fault.title}, at {', '.join(fault.at)}: {text}\n  {data.with_suffix('.html')}", flush=True)
        return ok

    def teardown(self) -> bool:
        """Take everything back, and look whether anything of the collection is left."""
        if not self.play("playbooks/teardown.yml"):
            return False
        computers = [host.name for host in self.prepared.hosts if host.name not in self.prepared.rehearsed.devices]
        left = {host: self.run(host, f"ls -d {OF_THE_COLLECTION} 2> /dev/null; true") for host in computers}
        for host, found in left.items():
            if found:
                print(f"  {host}: {' '.join(found.split())} is left", flush=True)
        return not any(left.values())

    def whole(self) -> bool:
        """All steps; one that cannot go on ends them."""
        if not self.step("the computers start", self.start):
            return False
        if not self.step("site.yml: make the fleet talk", lambda: self.play("site.yml")):
            return False
        self.step("verify.yml: prove it", lambda: self.verify("site"))
        self.step("a reboot of all computers", self.reboot)
        self.step("verify.yml: prove it again", lambda: self.verify("reboot"))
        for fault in self.prepared.faults:
            self.step(f"fault {fault.name}: {fault.title}", lambda fault=fault: self.fault(fault))
        if self.prepared.faults:
            self.step("verify.yml: the faults are taken back", lambda: self.verify("end"))
        if self.step("teardown.yml: take it back", self.teardown) and self.keep:
            self.step("site.yml: set up again, to look around", lambda: self.play("site.yml"))
        return not self.wrong

    def explain_kept(self) -> str:
        """Say how the computers that stay are reached; the paths are those of the checkout."""
        inventories = " ".join(
            f"-i {shlex.quote(os.path.relpath(path, ROOT))}" for path in (self.work / "inventory.yml", self.connection)
        )
        return (
            f"  with Ansible, in {ROOT}:\n    .work/venv/bin/ansible-playbook {inventories} playbooks/verify.yml\n"
            f"  a shell: .work/venv/bin/python lab/lab.py shell --name {self.lab} HOST\n  remove them: make lab-down"
        )


def _wait_or_kill(process: subprocess.Popen[bytes]) -> None:
    """See that a playbook has ended."""
    try:
        process.wait(20)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def summarize(rehearsed: Rehearsal) -> str:
    """The last lines."""
    lines = [
        f"  {'FAILED' if what in rehearsed.wrong else 'ok    '}{seconds:7.1f} s   {what}"
        for what, seconds in rehearsed.seconds.items()
    ]
    computers = len(rehearsed.prepared.hosts)
    verdict = f"{len(rehearsed.wrong)} of {len(lines)} steps failed" if rehearsed.wrong else "all went well"
    lines.append(f"\nrehearse: {computers} computers, {sum(rehearsed.seconds.values()):.0f} s: {verdict}")
    return "\n".join([*lines, *([str(rehearsed.report)] if rehearsed.report else [])])


def rehearse(options: argparse.Namespace) -> bool:
    """Prepare, run all steps, and remove the containers."""
    name = options.name or rehearsal.name_of(options.inventory)
    work = WORK / name
    (work / "reports").mkdir(parents=True, exist_ok=True)
    with (work / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise LabError(f"the rehearsal {name} is running already: wait for its end.") from None
        run = Rehearsal(name, prepare(options, work), work, options.keep)
        with contextlib.nullcontext() if options.keep else containers.remove_at_end(run.lab):
            if options.keep:
                containers.take_down(run.lab)
            run.whole()
        if options.keep and run.connection.name:
            say("the computers stay")
            print(run.explain_kept(), flush=True)
        say("the rehearsal")
        print(summarize(run), flush=True)
        return not run.wrong


def _words(text: str) -> list[str]:
    return [word for word in re.split(r"[,\s]+", text) if word]


def parse_options(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--inventory", metavar="PATH", required=True, help="the inventory: a folder, a file or a script"
    )
    parser.add_argument(
        "--name", metavar="NAME", default="", help="name of the rehearsal (default: after the inventory)"
    )
    parser.add_argument(
        "--faults", metavar="NAME,...", type=_words, default=[], help="faults of tests/faults/catalogue"
    )
    parser.add_argument(
        "--suites",
        metavar="[HOST=]SUITE,...",
        type=_words,
        default=[],
        help="Debian's release of all computers, or of one",
    )
    parser.add_argument("--overlap", action="store_true", help="rehearse networks that this machine has, too")
    parser.add_argument("--keep", action="store_true", help="leave the containers at the end, with the fleet set up")
    options = parser.parse_args(words)
    if not re.fullmatch(r"[a-z0-9_]*", options.name):
        parser.error(f"--name is '{options.name}'; expected small letters, digits and underscores")
    if not options.inventory.strip():
        raise LabError("INVENTORY is not set; expected the folder of your inventory: make rehearse INVENTORY=<folder>")
    options.inventory = Path(os.path.abspath(os.path.expanduser(options.inventory)))
    return options


def main() -> int:
    """Exit status 0 only when every step went well; 2 when it cannot be rehearsed."""
    try:
        with exit_on_signals():
            return int(not rehearse(parse_options()))
    except (LabError, subprocess.SubprocessError) as error:
        print(f"rehearse: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("rehearse: interrupted; the containers are removed", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
