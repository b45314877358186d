# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Robots in the lab whose nodes are the bundled ones or those of a checkout (upstream.py), in any combination.

The collection installs every robot; on `theirs` it runs upstream's nodes by its provider `fkie_existing`. A robot with one
node of each has the bundled ones; in the place of one of them upstream's runs as a transient service, with the same
parameters, from the checkout, with the collection's message package.
"""

from __future__ import annotations

import contextlib
import json
import re
import shlex
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from machines import containers
from upstream import SETUP
from upstream import UPSTREAM as IMPLEMENTATION

LAB = "interop"
BUNDLED, UPSTREAM = "bundled", "upstream"
NODES = ("discovery", "sync")
PATIENCE = (
    20.0  # seconds: upstream waits up to 2 s before it fetches, and up to 30 s after a node of its robot started anew
)

CONFIGURATION = "/etc/rosfleet-multimaster/master_{}.json"
Seen = TypeVar("Seen")


def eventually(look: Callable[[], Seen], wanted: Callable[[Seen], bool], seconds: float = PATIENCE) -> Seen:
    """Look until it is as wanted, for some seconds at most; returns what was last seen."""
    deadline = time.monotonic() + seconds
    while True:
        seen = look()
        if wanted(seen) or time.monotonic() > deadline:
            return seen
        time.sleep(0.2)


@dataclass(frozen=True)
class Computer:
    """A computer of the lab."""

    host: str

    @property
    def label(self) -> str:
        """Its name, as ROS allows it in a graph name."""
        return self.host.replace("-", "_")

    def run(self, command: str, check: bool = True, stdin: str | None = None) -> str:
        """Run a shell command as root and return what it printed."""
        done = subprocess.run(
            ["podman", "exec", "-i", containers.container(LAB, self.host), "bash", "-lc", command],
            input=stdin,
            capture_output=True,
            text=True,
            timeout=90,
            check=False,
        )
        assert not check or done.returncode == 0, f"{self.host}: {command}: {done.stdout}{done.stderr}"
        return done.stdout

    def start(self, unit: str, command: str) -> None:
        """Run something in the background until `stop`; the fixture `fleet_rests` stops everything at the end of a test."""
        # A node of rospy that is stopped during a call to its roscore waits for itself.
        options = f"--quiet --collect --property=TimeoutStopSec=10 --unit=test-{unit}"
        self.run(f"systemd-run {options} bash -lc {shlex.quote(f'exec {command}')}")

    def stop(self, unit: str) -> None:
        """Stop what `start` started (a pattern), if it is there."""
        self.run(f"systemctl stop 'test-{unit}.service'")

    def active(self, unit: str) -> bool:
        """Return True if what `start` started still runs."""
        return self.run(f"systemctl is-active test-{unit}", check=False).strip() == "active"

    def publish(self, topic: str, client: str = "rospy") -> None:
        """Publish ten texts a second, until `unpublish`; with roscpp, a relay of what a rospy node publishes."""
        unit, source = topic[1:], topic if client == "rospy" else f"{topic}_in"
        self.start(f"{unit}-source", f"rostopic pub -r 10 {source} std_msgs/String hello __name:={source[1:]}_source")
        if client == "roscpp":
            self.start(unit, f"/usr/lib/topic_tools/relay {source} {topic} __name:={topic[1:]}_relay")

    def unpublish(self, topic: str) -> None:
        """End what `publish` began."""
        self.stop(f"{topic[1:]}*")

    def listen(self, topic: str) -> None:
        """Subscribe to a topic, whether anybody publishes there or not; `heard` tells what arrives."""
        self.run(": > /run/heard")
        self.start("listener", f"python3 /opt/interop/listener.py {topic} > /run/heard")

    def heard(self) -> int:
        """The number of messages that have arrived so far."""
        return int(self.run("wc -l < /run/heard"))

    def hears(self, topic: str, seconds: float = PATIENCE) -> bool:
        """Return True if anything arrives on a topic."""
        return self.run(f"timeout -k 5 {seconds:.0f} rostopic echo -n 1 {topic}", check=False).startswith("data:")

    def topics(self) -> list[str]:
        """The topics that its roscore knows."""
        return self.run("rostopic list", check=False).split()

    def services(self) -> list[str]:
        """The services that its roscore knows."""
        return self.run("rosservice list", check=False).split()

    @contextlib.contextmanager
    def losing(self, per_cent: int) -> Iterator[None]:
        """Of all packets to and from this computer some get lost, until the end of the block."""
        chain = "chain {0} {{ type filter hook {0} priority 0; {1} lo accept; numgen random mod 100 < {2} drop; }};"
        chains = " ".join(chain.format(hook, name, per_cent) for hook, name in (("input", "iif"), ("output", "oif")))
        self.run(f"nft 'table inet interop {{ {chains} }}'")
        try:
            yield
        finally:
            self.run("nft delete table inet interop")


@dataclass(frozen=True)
class Robot(Computer):
    """The computer with a robot's roscore, and whose nodes run there."""

    discovery: str
    sync: str
    provider: str = BUNDLED  # whose nodes the collection runs there

    def implementation(self, node: str) -> str:
        """The implementation of "discovery" or "sync" that runs here."""
        return str(getattr(self, node))

    def added(self, node: str) -> bool:
        """Return True if a node is not the one that the collection runs."""
        return self.implementation(node) != self.provider

    def unit(self, node: str) -> str:
        """The service that runs a node."""
        return f"fkie-{node}" if self.added(node) else f"multimaster-{node}"

    def launch(self, node: str, **parameters: Any) -> None:
        """Start a node, or start it anew, with the parameters that the collection wrote and these."""
        values = {**json.loads(self.run(f"cat {CONFIGURATION.format(node)}.written")), **parameters}
        if self.implementation("sync") == UPSTREAM and node == "sync":  # upstream reads it there
            self.run(f"rosparam set /do_not_sync {shlex.quote(json.dumps(values.get('do_not_sync', [])))}")
        if not self.added(node):
            self.run(f"cat > {CONFIGURATION.format(node)}", stdin=json.dumps(values))
            self.run(f"systemctl restart {self.unit(node)}")
            return
        self.run(f"systemctl stop {self.unit(node)}; rosparam delete /master_{node}", check=False)
        given = shlex.join(f"_{name}:={json.dumps(value)}" for name, value in values.items())
        program = f"env {IMPLEMENTATION.environment} python3 {IMPLEMENTATION.program(node)} __name:=master_{node}"
        command = f"source {SETUP}; exec {program} {given}"
        self.run(
            f"systemd-run --quiet --collect --unit={self.unit(node)} --property=TimeoutStopSec=15"
            f" --setenv=ROS_HOME=/run/interop bash -lc {shlex.quote(command)}"
        )

    def begin(self) -> None:
        """Put upstream's nodes in the place of those that the collection runs, where that is wanted."""
        for node in NODES:
            self.run(f"cp {CONFIGURATION.format(node)} {CONFIGURATION.format(node)}.written")
            if self.added(node):
                self.run(f"systemctl stop multimaster-{node}")
        for node in NODES:
            if self.added(node):
                self.launch(node)

    @contextlib.contextmanager
    def with_parameters(self, node: str, **parameters: Any) -> Iterator[None]:
        """A node with other parameters, until the end of the block."""
        self.launch(node, **parameters)
        try:
            yield
        finally:
            self.launch(node)

    def kill(self, node: str) -> None:
        """End a node as a loss of power does, and keep it from being started again."""
        self.run(
            f"mkdir -p /run/systemd/system/{self.unit(node)}.service.d && cd $_ && printf '[Service]\nRestart=no\n'"
            f" > killed.conf && systemctl daemon-reload && systemctl kill --signal=KILL {self.unit(node)}"
        )

    def revive(self, node: str) -> None:
        """Start a killed node again."""
        self.run(f"rm -r /run/systemd/system/{self.unit(node)}.service.d && systemctl daemon-reload")
        self.launch(node)

    def log(self, node: str, seconds: int) -> str:
        """The log of a node in the last seconds."""
        return self.run(f"journalctl --unit {self.unit(node)} --output cat --since=-{seconds}s")

    def masters(self) -> dict[str, bool]:
        """The masters that its discovery lists, and whether they are online."""
        messages = f"source {SETUP};" if self.discovery == UPSTREAM else ""
        listed = self.run(f"{messages} timeout -k 5 10 rosservice call /master_discovery/list_masters", check=False)
        return {
            name: online == "True"
            for name, online in re.findall(r'name: "?([\w-]+)"?$.*?online: (\w+)', listed, re.M | re.S)
        }

    def ask(self, method: str, *arguments: Any) -> Any:
        """Call a method of its discovery's XML-RPC server."""
        code = (
            "import json, sys, xmlrpc.client as x; method, *arguments = json.load(sys.stdin);"
            f" print(json.dumps(getattr(x.ServerProxy('http://{self.host}:11611'), method)(*arguments)))"
        )
        return json.loads(self.run(f'python3 -c "{code}"', stdin=json.dumps([method, *arguments])))


SECOND = Computer("ours-second")
ROBOTS: Mapping[str, Robot] = {
    robot.host: robot
    for robot in (
        Robot("ours", BUNDLED, BUNDLED),
        Robot("theirs", UPSTREAM, UPSTREAM, provider=UPSTREAM),
        Robot("our-discovery", BUNDLED, UPSTREAM),
        Robot("our-sync", UPSTREAM, BUNDLED),
    )
}
COMPUTERS = (*ROBOTS.values(), SECOND)
OURS, THEIRS = ROBOTS["ours"], ROBOTS["theirs"]
#: who gives, who takes
DIRECTIONS = ((THEIRS, OURS), (OURS, THEIRS))


def other(robot: Robot) -> Robot:
    """The other one of the two whole implementations."""
    return THEIRS if robot is OURS else OURS


def settled(seconds: float = 45.0) -> None:
    """Wait until every robot lists every master as online."""
    for robot in ROBOTS.values():
        seen = eventually(robot.masters, lambda masters: masters == dict.fromkeys(ROBOTS, True), seconds)
        assert seen == dict.fromkeys(ROBOTS, True), f"{robot.host} lists {seen}"
