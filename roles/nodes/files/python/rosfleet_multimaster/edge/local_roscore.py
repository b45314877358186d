# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The roscore that a program belongs to: waited for at the start, and watched."""

from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple

from ..protocol.parameters import Table
from ..protocol.plain_text import quote
from .clock import monotonic, sleep
from .lifeline import Lifeline, Socket, lifeline
from .loop import EndFlag, Loop, RecurringJob, Workers
from .process import program
from .process.systemd import notify
from .roscore import Roscore
from .rpc_client import Rpc

#: seconds between two checks whether it is still the same one: while its end would be seen at once, else, and while it is away
WATCHED, HEALTH, AWAY_HEALTH = 10.0, 0.5, 0.1


def wait_for_roscore(uri: str) -> str:
    """The URI that the roscore calls itself, as soon as it answers."""
    said = False
    while True:
        try:
            answer = Rpc(uri, 2.0).call("getUri", "/rosfleet")
            if isinstance(answer, list) and len(answer) == 3 and answer[0] == 1 and isinstance(answer[2], str):
                return answer[2]
            raise ValueError("no URI")
        except program.FAILURES as problem:
            if not said:
                program.LOG.warning("waiting for the roscore at %s: %s", uri, problem)
                said = True
            notify(f"STATUS=waiting for the roscore at {uri}", "EXTEND_TIMEOUT_USEC=30000000")
            sleep(0.2)


def refuse_second(roscore: Roscore, node: str) -> None:
    """A second node of this name would end the first one. Raises program.Fatal."""
    (uri,) = roscore.ask(("lookupNode", node))
    if not uri:
        return
    try:
        Rpc(uri, 2.0).call("getPid", "/rosfleet")
    except program.FAILURES:
        return  # it is dead, and its registration is replaced
    raise program.Fatal(f"a node named {node} is already running at {uri}: stop it, or do not start this one")


class Start(NamedTuple):
    """A node that has begun: its loop, its roscore, its names and its parameters."""

    loop: Loop
    ended: EndFlag  # it ends by itself: that ROS ends it, too, is nothing to report
    roscore: Roscore
    uri: str  # that the roscore calls itself
    name: str  # of the node
    node_uri: str
    values: Dict[str, Any]


def begin(ros: Any, default_name: str, table: Table, description: str) -> Start:
    """Become a node of the own roscore. `ros`: edge/ros.py. `table`: the parameters. Raises program.Fatal."""
    read = program.read_parameters(description, table)
    env_uri = ros.master_uri()
    uri = wait_for_roscore(env_uri)
    name = ros.node_name(default_name)
    roscore = Roscore(env_uri, name)
    refuse_second(roscore, name)
    loop, ended = Loop(), EndFlag()
    node_name, node_uri = ros.start(default_name)
    ros.on_shutdown(lambda reason: loop.post(_on_shutdown, ended, reason))
    values = program.settle_parameters(roscore, name, read, table)
    return Start(loop, ended, roscore, uri, node_name, node_uri, values)


def _on_shutdown(ended: EndFlag, reason: str) -> None:
    if not ended:
        obey_shutdown(reason)


def obey_shutdown(reason: str) -> None:
    """End this node, since another program wants it to. `reason`: its words."""
    program.give_up(f"somebody ended this node: {quote(reason)}")


class Identity:
    """Proof that the roscore is still the one that this node registered with."""

    def __init__(self) -> None:
        self._pid: Any = None
        self.service = ("", "")  # name and URI of a service of this node

    def calls(self) -> List[Tuple[str, ...]]:
        """The calls to the roscore whose answers `check` takes."""
        return [("getPid",), ("lookupService", self.service[0] or "/-")]

    def check(self, service: Tuple[str, str], pid: Any, service_uri: Any) -> bool:
        """Compare the answers. `service`: the own one when they were asked for. Raises program.Fatal if `service_uri` differs.

        True if it was restarted, and has remembered this node.
        """
        if pid is None:
            raise OSError("the roscore does not report its process id")
        before, self._pid = self._pid, pid
        self.check_service(service, service_uri)  # a node without a URI yet may be as well known as before
        return before not in (None, pid)

    def check_service(self, service: Tuple[str, str], service_uri: Any) -> None:
        """Compare the roscore's entry of the own service. Raises program.Fatal if it is not this node's any more."""
        if service[0] and service_uri != service[1]:
            raise program.Fatal(f"the roscore knows {service[0]} no longer as a service of this node: starting again")


class RoscoreCheck:
    """The check whether the roscore is still there, and still the same one: made when its lifeline ends, and else rarely."""

    def __init__(
        self, loop: Loop, roscore: Roscore, identity: Identity, workers: Workers, again: Callable[[], None]
    ) -> None:
        """`again()` is called if it answers again or was restarted. The program ends if the own service is lost."""
        self._roscore, self._identity, self._again = roscore, identity, again
        self._unanswered = 0
        self._line = Lifeline(loop, self._cut)
        self._checked_at = 0.0
        self._checks = RecurringJob(workers, lambda: WATCHED if self._line else HEALTH, self._check, self._on_check)

    def tick(self, now: float) -> Optional[float]:
        """Check if that is due; the time of the next check."""
        return self._checks.tick(now)

    def _cut(self) -> None:
        """The lifeline has ended. Some roscores end each connection after a while."""
        self._checks.due = max(monotonic(), self._checked_at + HEALTH)

    def _check(self) -> Tuple[bool, Optional[Socket]]:
        service, line = self._identity.service, None if self._line else lifeline(self._roscore.rpc.uri)
        return self._identity.check(service, *self._roscore.ask(*self._identity.calls())), line

    def _on_check(self, found: Optional[Tuple[bool, Optional[Socket]]], problem: Optional[Exception]) -> None:
        self._checked_at = monotonic()
        if isinstance(problem, program.Fatal):
            program.give_up(str(problem))
        elif found is None:
            self._unanswered += 1
            self._line.drop()
            self._checks.due = monotonic() + AWAY_HEALTH  # the next one may be another roscore already
            if self._unanswered == 2:
                program.LOG.error("the roscore at %s does not answer: %s", self._roscore.rpc.uri, problem)
        else:
            restarted, line = found
            if line is not None:
                self._line.hold(self._roscore.rpc.uri, line)
                self._checks.due = monotonic() + WATCHED
            if restarted or self._unanswered > 1:
                program.LOG.info("the roscore answers again")
                self._again()
            self._unanswered = 0
