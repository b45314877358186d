# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A lab for tests: commands, programs and playbooks on its computers."""

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

from machines import containers
from machines.layout import hosts_of, read_inventory
from machines.podman import ROOT, podman
from proofs.proof import Computer
from setups.links import wait_until

NODES = Path(__file__).with_name("nodes")
THREE_ROBOTS = ROOT / "tests" / "systems" / "three_robots"


class Lab:
    """The computers of the lab, and the playbooks against them."""

    patience = 300  # seconds for a playbook

    def __init__(self, name, inventory, extras=None):
        """`extras`: computers besides those of the inventory, and more for those of it; see layout.Extra."""
        self.name, self.extras = name, extras
        self.become(inventory)

    def become(self, inventory):
        """Bring the lab to the computers of an inventory: those that it has already stay as they are."""
        hosts = hosts_of(read_inventory(inventory), self.extras)
        containers.bring_up(self.name, hosts)
        self.inventory, self.connection = inventory, containers.write_inventory(self.name, hosts)

    def run(self, host, command, check=True, stdin=None):
        """Run a shell command as root on a computer and return its output."""
        done = subprocess.run(
            ["podman", "exec", "-i", containers.container(self.name, host), "bash", "-lc", command],
            input=stdin,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert not check or done.returncode == 0, f"{host}: {command}: {done.stdout}{done.stderr}"
        return done.stdout

    def computer(self, host):
        """Give a computer as the proofs take it."""
        return Computer(host, ("podman", "exec", "-i", containers.container(self.name, host), "bash", "-lc"))

    def start(self, host, unit, command, script=None):
        """Start a program as a person would; `{script}` in its command is a copy of a file of lab/nodes."""
        path = f"/tmp/{Path(script or '').name}"
        text = (NODES / script).read_text() if script else ""
        line = f"bash -lc 'exec {command.format(script=path)}'"
        # A node of rospy that is stopped during a call to its roscore waits for itself.
        options = f"--unit {unit} -p TimeoutStopSec=10 -p StandardOutput=truncate:/run/{unit}.out"
        self.run(
            host,
            f"{f'cat > {path};' if script else ''} systemctl stop {unit} 2>/dev/null; "
            f"systemd-run --quiet --collect {options} {line}",
            stdin=text,
        )

    def wait_until_ready(self, host, unit, seconds=60):
        """Wait for the line "ready" of a program that `start` has started. One that has ended instead fails with its output."""

        def ready():
            state, *said = self.run(host, f"systemctl is-active {unit}; cat /run/{unit}.out", check=False).splitlines()
            if "ready" in said:  # as a line: "Address already in use" has the word in it, too
                return True
            assert state in ("active", "activating"), f"{host}: {unit} is {state}: {' '.join(said)}"
            return False

        wait_until(ready, seconds, f"{unit} on {host} is ready")

    def stop(self, host, *units):
        """End programs that `start` has started."""
        self.run(host, f"systemctl stop {' '.join(units)}")

    def output(self, host, unit):
        """The lines of a program that begin with a time: (time, the rest)."""
        lines = self.run(host, f"grep ^[0-9] /run/{unit}.out", check=False).splitlines()
        return [(float(time), text) for time, _space, text in (line.partition(" ") for line in lines)]

    def podman(self, *arguments):
        """Run podman with a computer's container as the last argument."""
        *words, host = arguments
        podman(*words, containers.container(self.name, host))

    def halt(self, host):
        """Switch a computer off."""
        containers.halt(containers.container(self.name, host))

    def reboot(self, host):
        """Let a computer reboot, without waiting for it."""
        containers.reboot(containers.container(self.name, host))

    def wait_until_up(self, host):
        containers.wait(containers.container(self.name, host))

    def play(self, name, *options, variables=None, programs=Path(sys.executable).parent, environment=None):
        """Run a playbook; returns its exit status and its output on one line."""
        report = ROOT / ".work" / "reports" / f"{self.name}.json"  # not among those of the user
        report.parent.mkdir(parents=True, exist_ok=True)
        extra = json.dumps({"verify_report": str(report), **(variables or {})})
        return self._ansible(programs / "ansible-playbook", name, *options, "-e", extra, environment=environment)

    def module(self, host, name, arguments):
        """Run one module of the collection on a computer; returns exit status and output on one line."""
        return self._ansible(
            Path(sys.executable).with_name("ansible"),
            host,
            "-m",
            f"rosfleet.multimaster.{name}",
            "-a",
            json.dumps(arguments),
        )

    def ssh(self, host, command, user="root"):
        """Run a command over a new connection by ssh, and return its output of one line."""
        variables = {"ansible_user": user, "ansible_ssh_extra_args": "-o ControlPath=none"}
        words = ("-m", "ansible.builtin.raw", "-e", json.dumps(variables), "-a", command)
        return self._ansible(Path(sys.executable).with_name("ansible"), host, *words)[1]

    def _ansible(self, program, *words, environment=None):
        done = subprocess.run(
            [program, "-i", self.inventory, "-i", self.connection, *words],
            cwd=ROOT,
            env={
                **os.environ,
                "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg"),
                "ANSIBLE_NOCOLOR": "1",
                **(environment or {}),
            },
            capture_output=True,
            text=True,
            timeout=self.patience,
            check=False,
        )
        return done.returncode, " ".join((done.stdout + done.stderr).split())


@contextlib.contextmanager
def lab_of(name, inventory, extras=None):
    """The computers of an inventory, and the extra ones, until the end of the block, or of this program by a signal."""
    with containers.remove_at_end(name):
        yield Lab(name, inventory, extras)


@contextlib.contextmanager
def three_robots(name):
    """ana, bob and cid after site.yml, each of one computer; cid has a roscore of its own kind: three workers, no time limit."""
    with lab_of(name, THREE_ROBOTS) as lab:
        lab.run("cid-pc", "cp /usr/local/share/lab/foreign-roscore.service /etc/systemd/system")
        lab.run("cid-pc", "systemctl enable --now foreign-roscore.service")
        status, output = lab.play("site.yml")
        assert status == 0, output
        yield lab
