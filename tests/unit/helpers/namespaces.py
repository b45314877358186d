# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Computers for tests of modules that send packets: each is a network and mount namespace of its own, on a bridge in another."""

import contextlib
import functools
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import ansible_collections

TOOLS = ("ip", "unshare", "nsenter")
MODULES = "ansible_collections.rosfleet.multimaster.plugins.modules."
COLLECTIONS = Path(next(iter(ansible_collections.__path__))).parent
ROOT = Path(__file__).resolve().parents[3]
# Root of a network without another computer, also for other users than root.
ALONE = ("unshare", "--map-root-user", "--net")
#: The places where a program that runs alone finds the nodes, and the parts of its tests.
PLACES = (ROOT / "roles/nodes/files/python", ROOT / "tests/unit/nodes", ROOT / "lab/nodes/hostile")


@functools.cache
def why_not(*tried):
    """The reason why this command works in no network namespace; "" if it works in one."""
    if os.geteuid() != 0:
        return "needs root, to make network namespaces"
    absent = [tool for tool in TOOLS if not shutil.which(tool)]
    if absent:
        return f"needs {', '.join(absent)}"
    command = ["unshare", "--net", "--mount", *(tried or ("true",))]
    if subprocess.run(command, check=False, capture_output=True).returncode:
        return f"needs the right to make network namespaces {' and '.join(tried[:1])}".rstrip()
    return ""


@functools.cache
def why_not_alone():
    """The reason why a program cannot run alone; "" if it can."""
    try:
        subprocess.run([*ALONE, "ip", "link"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        return "needs unshare and ip, and network namespaces for this user"
    return ""


def run_alone(program, *words, log=None):
    """Run a program of tests/unit/nodes in a network of its own; its output. Raises AssertionError with its log if it fails."""
    path = ":".join(filter(None, (*map(str, PLACES), os.environ.get("PYTHONPATH", ""))))
    done = subprocess.run(
        [*ALONE, sys.executable, str(ROOT / "tests/unit/nodes" / program), *map(str, words)],
        env={**os.environ, "PYTHONPATH": path},
        timeout=300,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr + (log.read_text() if log and log.exists() else "")
    return done.stdout


class Host:
    """A computer; it lives as long as the process that holds its namespaces."""

    def __init__(self, name, address):
        self.name, self.address = name, address
        self.holder = subprocess.Popen(["unshare", "--net", "--mount", "sleep", "300"])
        own = os.readlink("/proc/self/ns/net")
        while os.readlink(f"/proc/{self.holder.pid}/ns/net") == own:
            time.sleep(0.005)
        self.net = os.readlink(f"/proc/{self.holder.pid}/ns/net")
        self.enter = ["nsenter", "--target", str(self.holder.pid), "--net", "--mount"]
        self.extra = {}

    def run(self, *command, **options):
        return subprocess.run([*self.enter, *command], check=True, capture_output=True, text=True, **options).stdout

    def popen(self, *command):
        return subprocess.Popen([*self.enter, *command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def processes(self):
        """The processes of this computer, without the one that holds it."""
        found = set()
        for entry in Path("/proc").glob("[0-9]*/ns/net"):
            with contextlib.suppress(OSError):
                if os.readlink(entry) == self.net:
                    found.add(int(entry.parts[2]))
        return found - {self.holder.pid}

    def end(self):
        for pid in self.processes():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, 9)
        self.holder.kill()
        self.holder.wait()


class Network:
    """Computers on one bridge."""

    def __init__(self, count, folder):
        self.folder = folder
        self.switch = Host("switch", None)
        self.switch.run("ip", "link", "add", "br0", "up", "type", "bridge", "mcast_snooping", "0")
        self.hosts = [self.add(number) for number in range(1, count + 1)]

    def add(self, number):
        host = Host(f"robot{number}computer", f"192.168.1.{number}")
        self.switch.run(
            "ip", "-batch", "-",
            input=f"link add s{number} type veth peer name eth0 netns {host.holder.pid}\n"
            f"link set s{number} master br0 up\n",
        )  # fmt: skip
        host.run(
            "ip", "-batch", "-",
            input=f"link set lo up\nlink set eth0 up\naddress add {host.address}/24 dev eth0\n"
            "route add 224.0.0.0/4 dev eth0\n",
        )  # fmt: skip
        host.run("mount", "-t", "tmpfs", "tmpfs", "/run")
        return host

    def run_module(self, host, name, arguments, fails=False):
        """Run a module of the collection on a computer; its result."""
        path = self.folder / f"{host.name}.json"
        path.write_text(json.dumps({"ANSIBLE_MODULE_ARGS": arguments}))
        done = subprocess.run(
            [*host.enter, sys.executable, "-m", MODULES + name, str(path)],
            env={**os.environ, "PYTHONPATH": str(COLLECTIONS), **host.extra},
            capture_output=True, text=True, timeout=60, check=False,
        )  # fmt: skip
        result = json.loads(done.stdout)
        assert bool(result.get("failed")) == fails, result
        return result

    def end(self):
        for host in [*self.hosts, self.switch]:
            host.end()
