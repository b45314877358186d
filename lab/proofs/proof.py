# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The tests that section 3.3 of the report makes by hand, between every pair of robots, as a person by ssh.

All nodes are ordinary ones (rostopic, rosservice, rospy, actionlib): nothing of them knows the collection.
"""

from __future__ import annotations

import contextlib
import itertools
import pathlib
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TextIO

from proofs.busy import Busy

NODES = pathlib.Path(__file__).parents[1] / "nodes"
# A registration crosses within a second; rospy's command-line tools take a few to start, and more on a busy machine (Slack).
PATIENCE = 20.0
# Seconds by which a limit is longer, for what has been measured since a moment of the steady clock; see busy.py.
Slack = Callable[[float], float]
# Pairs that are tried at the same time: most of it is waiting for command-line tools to start.
AT_ONCE = 4


@dataclass(frozen=True)
class Computer:
    """A computer of the lab: its name, and the command that logs a person in there."""

    name: str
    ssh: tuple[str, ...]

    @property
    def label(self) -> str:
        """The name as ROS allows it in a graph name."""
        return self.name.replace("-", "_")

    def run(self, command: str, script: pathlib.Path | None = None, seconds: float = 45) -> str:
        """Run a command by ssh, with a file as its input, and return its output; '' if it failed."""
        with contextlib.ExitStack() as stack:
            stdin = stack.enter_context(script.open("rb")) if script else subprocess.DEVNULL
            try:
                done = subprocess.run(
                    [*self.ssh, command],
                    stdin=stdin,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    text=True,
                    timeout=seconds,
                    check=False,
                )
            except subprocess.TimeoutExpired:
                return ""
        return done.stdout if done.returncode == 0 else ""

    @contextlib.contextmanager
    def start_program(self, command: str, script: pathlib.Path | None = None, seconds: int = 120) -> Iterator[TextIO]:
        """Run a command by ssh until the end of the block, at most so many seconds; it is ended by its own process id.

        Yields its output.
        """
        with contextlib.ExitStack() as stack:
            stdin = stack.enter_context(script.open("rb")) if script else subprocess.DEVNULL
            process = subprocess.Popen(
                [*self.ssh, f"echo $$; exec timeout -s INT {seconds} {command}"],
                stdin=stdin,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
            assert process.stdout is not None
            pid = int(process.stdout.readline())
            try:
                yield process.stdout
            finally:
                self._end(process, pid)

    def _end(self, process: subprocess.Popen[str], pid: int) -> None:
        """End the program that `running` started: as Ctrl+C does, and by force if a busy machine leaves it no time for that."""
        for end in (f"kill -INT {pid}", f"kill -KILL -- -{pid}"):  # timeout leads a process group of its own
            self.run(end)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.communicate(timeout=30)
                return
        process.kill()
        process.communicate()


@dataclass(frozen=True)
class Result:
    """One line of the proof."""

    what: str
    whom: str
    ok: bool
    found: str


def wait_for(
    look: Callable[[], str], wanted: Callable[[str], bool], seconds: float = PATIENCE, slack: Slack | None = None
) -> tuple[bool, str]:
    """Look until it is as wanted; returns if it was, and the value that was last seen. With `slack`, it is longer on a busy machine."""
    began = time.monotonic()
    deadline = began + seconds
    while True:
        seen = look()
        if wanted(seen):
            return True, seen.strip()
        if time.monotonic() > deadline:
            if slack is None:
                return False, seen.strip()
            deadline, slack = deadline + slack(began), None
        time.sleep(0.2)


def prove(computers: Sequence[Computer], report: Callable[[str], None]) -> list[Result]:
    """Everything of section 3.3, from each computer to each other."""

    def pair(both: tuple[Computer, Computer]) -> list[Result]:
        here, there = both
        report(f"{here.name} -> {there.name}: topic, connection, service, action, parameter, end of a publisher")
        return list(_pair(here, there, busy.slack))

    with Busy() as busy, ThreadPoolExecutor(max_workers=AT_ONCE) as pool:
        return [result for results in pool.map(pair, itertools.permutations(computers, 2)) for result in results]


def _pair(here: Computer, there: Computer, slack: Slack) -> Iterator[Result]:
    began = time.monotonic()
    whom = f"{here.name} -> {there.name}"
    name = f"{here.label}_to_{there.label}"  # pairs are tried at the same time, and names of nodes are unique
    topic = f"/{name}/test"
    with here.start_program(f"rostopic pub -r 5 {topic} std_msgs/Int32 1"):
        ok, seen = wait_for(lambda: there.run("rostopic list"), lambda text: topic in text.split(), slack=slack)
        yield Result("rostopic list shows the topic", whom, ok, "listed" if ok else f"only {seen.split()}")
        seen = there.run(f"timeout {PATIENCE + slack(began):.1f} rostopic echo -n 1 {topic}")
        yield Result(
            "rostopic echo prints the message", whom, seen.split() == ["data:", "1", "---"], " ".join(seen.split())
        )
        with there.start_program(f"rostopic echo {topic}"):
            ok, seen = wait_for(
                lambda: there.run(f"rostopic info {topic}"),
                lambda text: (
                    f"(http://{here.name}:" in text.partition("Subscribers:")[0]
                    and f"(http://{there.name}:" in text.partition("Subscribers:")[2]
                ),
                slack=slack,
            )
            yield Result("rostopic info shows a direct connection", whom, ok, " ".join(seen.split()))
        yield Result(
            "the message package is known",
            whom,
            *_run_and_find(there, "rosmsg show fkie_multimaster_msgs/MasterState", "string state"),
        )
    ok, seen = wait_for(
        lambda: there.run("rostopic list"), lambda text: bool(text) and topic not in text.split(), slack=slack
    )
    yield Result("the topic goes with its publisher", whom, ok, "gone" if ok else "still listed")
    with here.start_program(f"python3 - {name}_server", NODES / "programs/service_server.py"):
        ok, seen = wait_for(
            lambda: there.run(f"rosservice call /{name}_server/where"), lambda text: here.name in text, slack=slack
        )
        yield Result("a service is called", whom, ok, " ".join(seen.split()))
    with here.start_program(f"python3 - {name}_action", NODES / "programs/action_server.py"):
        seen = there.run(f"python3 - /{name}_action/double", NODES / "programs/action_client.py", seconds=100)
        ok = seen.split() in (["1", "42"], ["2", "42"], ["3", "42"])
        yield Result("an action gives feedback and its result", whom, ok, " ".join(seen.split()))
    parameter = f"/{name}_parameter"
    here.run(f"rosparam set {parameter} 7")
    own, other = here.run(f"rosparam get {parameter}").strip(), there.run("rosparam list").split()
    here.run(f"rosparam delete {parameter}")
    ok = own == "7" and bool(other) and parameter not in other
    yield Result(
        "a parameter stays on its robot",
        whom,
        ok,
        f"{own} here, {'unknown' if parameter not in other else 'known'} there",
    )


def _run_and_find(computer: Computer, command: str, part: str) -> tuple[bool, str]:
    seen = computer.run(command)
    return part in seen, " ".join(seen.split())[:60]


def table(results: Sequence[Result]) -> str:
    """The results as text: one line each, the found value if it was not the expected one."""
    width = max(len(result.what) for result in results)
    return "\n".join(
        f"  {'ok    ' if result.ok else 'FAILED'}  {result.what:<{width}}  {result.whom}"
        + ("" if result.ok else f"\n          found: {result.found}")
        for result in results
    )
