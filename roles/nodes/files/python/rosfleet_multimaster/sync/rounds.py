# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The rounds of synchronising: read the registrations of the roscore, plan, write the difference.

There is a round after each change, and regularly. Each one begins with the registrations of the roscore. So a failed
round needs no repair: the next one sees its effects.
"""

from collections import Counter
from dataclasses import replace
from functools import partial
from typing import AbstractSet, Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple
from xmlrpc.client import Fault

from ..edge.clock import monotonic
from ..edge.loop import Workers
from ..edge.process import program
from ..edge.roscore import RoscoreGraph
from ..edge.rpc_client import Rpc
from ..protocol import imports
from ..protocol.imports import Claims
from ..protocol.messages import Registration, View
from ..protocol.plain_text import quote
from ..protocol.tcpros.hosts import host_of
from .core.step import Condition, Knowledge, apply_plan, condition_of, step
from .core.sync import NEVER, Candidate, RegistrationConflict, Sync, SyncPlan, calls, nodes_of, plan
from .disconnector import Disconnector
from .type_questions import TypeQuestions

ROUND = 30.0  # seconds between two rounds, if nothing happens
REST, LONGEST_REST = 4, 0.5  # the pause after a round, in times of its duration, and in seconds at most: news collect
SHARE = 1000  # the least pause without news, in times of the duration of a round
AGAIN = (0.2, 0.5, 1.0)  # seconds after failed rounds: a roscore under load refuses one now and then
SETTLED = 5.0  # seconds from the last whole state to a round that looks at all registrations
SETTLED_AFTER_ALL = 20.0  # the same from the first whole state, at most: the robots of a fleet come one by one
LEFTOVERS = 15.0  # seconds that registrations of an earlier life wait for their master
UPDATE_TIMEOUT = 3.0  # seconds to send a subscriber of another robot its publishers
LINES = 10  # log lines of one round


class NameTaken(Exception):
    """A name is not free any more, or a node has moved."""


class RoundCallbacks(NamedTuple):
    """The question of a round, and its report."""

    has_list: Callable[[], bool]  # the list of masters has come
    on_end: Callable[[Optional[Exception]], None]


class Rounds:
    """Carries out the rounds of one master_sync."""

    def __init__(
        self,
        graph: RoscoreGraph,
        node: Tuple[str, str],
        core: Sync,
        questions: TypeQuestions,
        disconnector: Disconnector,
        roscore_calls: Workers,
        updaters: Workers,
        limited: program.LimitedLog,
        callbacks: RoundCallbacks,
    ) -> None:
        """`node`: name and URI of this node. `roscore_calls`: one thread, for all calls of the roscore."""
        self.claims: Claims = {}
        self.held: Dict[Registration, str] = {}
        self.refused: List[RegistrationConflict] = []  # by the last round
        self.met: Set[str] = set()  # URIs of the masters whose state has come in this life
        self.working = False
        self.made: Counter[str] = Counter()  # "registered" or "unregistered" -> the number of registrations
        self.failures = 0  # rounds that failed
        self._roscore, self._graph, self._node, self._core = graph.roscore, graph, node, core
        self._questions, self._disconnector, self._callbacks = questions, disconnector, callbacks
        self._calls, self._updaters, self._limited = roscore_calls, updaters, limited
        self._started = NEVER  # when the loop began: from then on leftovers wait
        self._due = NEVER  # a round after a change
        self._regular = NEVER  # the round without a change
        self._unsettled = NEVER  # when the first whole state came since the last round
        self._failed = 0
        self._withdrawn: Optional[Callable[[str], None]] = None
        self._view: Optional[View] = None  # the registrations of the roscore; None if they are not known
        self._touched: Set[Registration] = set()
        self._began = self.took = 0.0  # when the last round began, and its seconds
        self._rest = 0.0  # until then there is no round: when many masters come together, few rounds are enough

    def take_over(self) -> None:
        """Read the record of an earlier life, and write that this node keeps it from now on."""
        (text,) = self._roscore.ask(("getParam", imports.IMPORTS))
        self.claims = imports.read(text).claims
        if self.claims:
            program.LOG.info("%d nodes of other masters are registered here since before this start", len(self.claims))
        # Also an empty record names this node: discovery and the verification then ask no other one.
        if self._roscore.ask(("setParam", imports.IMPORTS, self._record(self.claims))) == [None]:
            program.LOG.warning(
                "the roscore does not let this program set %s, so it cannot keep names of other robots apart from own ones: "
                "have both run by one user, or this one by root",
                imports.IMPORTS,
            )

    def soon(self, at: float) -> None:
        """Have a round at this time, or earlier."""
        self._due = min(at, self._due)

    def touch(self, items: Set[Registration]) -> None:
        """Look at these registrations: they may have changed."""
        self._touched |= items

    def touch_all(self, master: str, items: Set[Registration]) -> None:
        """Look at all registrations of a master whose whole state has come: at these, and at those of an earlier life."""
        now = monotonic()
        self.met.add(master)
        self.touch(items.union(item for item, uri in self.held.items() if uri == master))
        # A regular round waits, too: if all robots start together, it would delay registrations on each of them.
        self._unsettled = min(now, self._unsettled)
        self._regular = min(now + SETTLED, self._unsettled + SETTLED_AFTER_ALL)

    def tick(self, now: float) -> float:
        """Begin a round if one is due; the time of the next one. The end of one wakes the loop."""
        self._started = min(self._started, now)
        if now >= self._next() and not self.working:
            self._begin(self._core.candidates(now))
        elif self._touched and not self.working:
            self._step(now)
        self._due = min(self._due, self._core.next_expiry(now))
        return NEVER if self.working else self._next()

    def _next(self) -> float:
        return max(min(self._due, self._regular), self._rest)

    def withdraw(self, done: Callable[[str], None]) -> None:
        """Unregister everything, once. `done(farewell)` is called in the loop."""
        self._withdrawn = done
        if not self.working:
            self._begin([])

    # Read

    def _begin(self, wanted: List[Candidate]) -> None:
        self.working, self._began = True, monotonic()
        self._due = self._regular = self._unsettled = NEVER
        self._touched, self._view = set(), None
        claimed, asked = {node for node, _uri in self.claims}, {item.registration for item in wanted}
        self._calls.submit(
            lambda: self._graph.read(lambda view: _list_needed(wanted, claimed, view)),
            partial(self._on_view, asked, frozenset(self.met)),
        )

    # Plan

    def _on_view(
        self, asked: Set[Registration], met: AbstractSet[str], view: Optional[View], problem: Optional[Exception]
    ) -> None:
        """Plan. `asked`: the roscore was asked about these; `met`: the masters whose state had come by then."""
        if view is None:
            self._end(problem)
            return
        todo = self._plan(asked, met, view, monotonic())
        here = {item: self.claims[item.node_key] for item in view.registrations(self.claims)}
        self._carry_out(todo, view, here)

    # A step: a few registrations, without reading the roscore

    def _step(self, now: float) -> None:
        touched, self._touched = self._touched, set()
        view = self._view
        todo = self._small_plan(view, touched, now) if view is not None else None
        if todo is None or view is None:
            self.soon(now)
        elif todo.register or todo.unregister:
            self.working = True
            self._carry_out(todo, view, self.held, condition_of(todo, self.claims, self._graph.guards_names))

    def _small_plan(self, view: View, touched: Set[Registration], now: float) -> Optional[SyncPlan]:
        if self._withdrawn or self._core.on_demand or not self._callbacks.has_list():
            return None
        if now - self._started < LEFTOVERS and not self.met.issuperset(self.claims.values()):
            return None
        knowledge = Knowledge(view, self.claims, self.held, {item.name for item in self.refused})
        todo = step(touched, self._core.find_candidates(touched, now), knowledge, self._core.is_contested)
        return None if todo is None else replace(todo, refused=self.refused)

    def _plan(self, asked: Set[Registration], met: AbstractSet[str], view: View, now: float) -> SyncPlan:
        claims = self.claims
        wanted = [] if self._withdrawn else self._core.candidates(now, view.local_nodes(claims))
        # New candidates are for the next round: whether their names are free is not known.
        wanted = [item for item in wanted if item.registration in asked]
        if not self._withdrawn and (now - self._started < LEFTOVERS or not self._callbacks.has_list()):
            wanted += _leftovers(view, claims, met)
        verdict = self._questions.guard.judge(wanted, view, claims, self._core.stamps(), now)
        self._questions.ask(verdict)
        todo = plan(verdict.wanted, view, claims)
        todo.refused += verdict.refused
        return todo

    # Write

    def _carry_out(
        self, todo: SyncPlan, view: View, here: Mapping[Registration, str], condition: Optional[Condition] = None
    ) -> None:
        """Write a plan. `here`: the registrations that are there; `condition`: of a step."""
        after = apply_plan(todo, view)  # without the withdrawn nodes: those are no longer claimed, as an own node
        # Reported before it is visible in the roscore, so that discovery never takes it for the robot's own.
        before, self.held = self.held, {**here, **todo.held}

        def on_results(results: Optional[List[Any]], problem: Optional[Exception]) -> None:
            now = monotonic()
            if isinstance(problem, NameTaken):
                self.working, self.held = False, before
                self.soon(now)
                return
            if condition is None:
                self.took = now - self._began
                self._rest = now + min(self.took * REST, LONGEST_REST)
            self._view = after if results is not None else None
            self._on_results(todo, results, problem)

        self._calls.submit(lambda: self._write(todo, condition), on_results)
        # Noted while it is written: with thousands of nodes this takes a tenth of a second.
        self._disconnector.note_registrations(todo.held, after, todo.claims, monotonic())

    def _write(self, todo: SyncPlan, condition: Optional[Condition] = None) -> List[Any]:
        """Make all calls in one request, the record of imports first; in the thread of the roscore. Raises NameTaken."""
        if condition and self._roscore.ask(*condition) != list(condition.values()):
            raise NameTaken
        record: List[Tuple[Any, ...]] = []
        if todo.claims != self.claims:
            record = [("setParam", self._node[0], imports.IMPORTS, self._record(todo.claims))]
        results = self._graph.carry_out(record + calls(todo))
        return results[len(record) :]

    def _record(self, claims: Claims) -> str:
        return imports.write(*self._node, claims)

    def _on_results(self, todo: SyncPlan, results: Optional[List[Any]], problem: Optional[Exception]) -> None:
        # Also after a failure: the plan may be carried out, as the next round will see.
        claims, self.claims = self.claims, todo.claims
        if results is None:
            self._end(problem)
            return
        self.held, self.refused = dict(todo.held), todo.refused
        done = []
        made = [("unregistered", item, claims[item.node_key]) for item in todo.unregister]
        made += [("registered", item, todo.held[item]) for item in todo.register]
        for (verb, item, master), result in zip(made, results):
            if isinstance(result, Fault) or result[0] != 1:
                why = result.faultString if isinstance(result, Fault) else result[1]
                self.held.pop(item, None)
                self._limited.say("error", f"call {item}", f"the roscore refuses the {item}: {quote(why)}")
                continue
            self.made[verb] += 1
            done.append((master, verb, item))
            if verb == "registered" and item.kind == "subscriber":
                self._send_publishers(item, master, result[2])
        for master, verb, item in done[:LINES]:
            program.LOG.info("%s: %s the %s", self._name(master), verb, item)
        if len(done) > LINES:
            program.LOG.info("... and %d more registrations", len(done) - LINES)
        self._end(None)

    def _name(self, master: str) -> str:
        remote = self._core.remotes.get(master)
        return remote.announced.name if remote is not None else host_of(master) or master

    def _send_publishers(self, item: Registration, master: str, publishers: List[str]) -> None:
        """Send a subscriber on another robot its publishers: a roscore sends them only to the caller."""
        uris = self._core.publishers_for(item, master, publishers)
        if not uris:
            return

        def report(_result: Any, problem: Optional[Exception]) -> None:
            if problem is not None:
                text = f"{quote(item.node)} cannot get the publishers of {quote(item.name)}: {quote(problem)}"
                self._limited.say("warning", f"update {item.node_uri}", text)

        self._updaters.submit(
            lambda: Rpc(item.node_uri, UPDATE_TIMEOUT).call("publisherUpdate", "/master", item.name, uris), report
        )

    # The end of a round

    def _end(self, problem: Optional[Exception]) -> None:
        self.working = False
        now = monotonic()
        if self._withdrawn is not None:
            self._end_withdrawal(problem, self._withdrawn)
            return
        if problem is not None:
            self._limited.say("error", "round", f"nothing can be registered at {self._roscore.rpc.uri}: {problem}")
        self.failures += problem is not None
        self._failed = self._failed + 1 if problem is not None else 0
        if self._failed:
            self.soon(now + AGAIN[min(self._failed, len(AGAIN)) - 1])
        else:
            if self._regular == NEVER:  # no whole state has come since
                self._regular = now + max(ROUND, self.took * SHARE)
            if self.claims.keys() - nodes_of(self.held):
                self.soon(now + AGAIN[-1])
            if now < self._started + LEFTOVERS and not self.met.issuperset(self.claims.values()):
                self.soon(self._started + LEFTOVERS)
        self._callbacks.on_end(problem)

    def _end_withdrawal(self, problem: Optional[Exception], done: Callable[[str], None]) -> None:
        if self.held and problem is None:  # the round before the end registered something
            self._begin([])
            return
        farewell = "withdrawn" if problem is None else f"nothing is withdrawn, the roscore does not answer: {problem}"
        self._calls.submit(
            lambda: problem is None and self._roscore.ask(("deleteParam", imports.IMPORTS)),
            lambda *_result: done(farewell),
        )


def _leftovers(view: View, claims: Claims, met: AbstractSet[str]) -> List[Candidate]:
    """Registrations of an earlier life whose masters have not come back yet."""
    masters = {key: uri for key, uri in claims.items() if uri not in met}
    items = sorted(view.registrations(masters))
    return [Candidate(item, masters[item.node_key], masters[item.node_key]) for item in items]


def _list_needed(wanted: Sequence[Candidate], claimed: Set[str], view: View) -> Tuple[List[str], List[str]]:
    """The nodes and the services whose URIs a round needs, sorted.

    Nodes here with a wanted service or topic are among them: their URIs show whether they are our own registrations.
    """
    services = {item.registration.name for item in wanted if item.registration.kind == "service"}
    topics = {item.registration.name for item in wanted if item.registration.kind != "service"}
    present = sorted(name for name, users in view.services.items() if name in services or claimed.intersection(users))
    nodes = {item.registration.node for item in wanted} | claimed
    nodes.update(user for name in present for user in view.services[name])
    for table in (view.publishers, view.subscribers):
        nodes.update(user for name in topics.intersection(table) for user in table[name])
    return sorted(nodes), present
