# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The round of synchronising: read what the roscore holds, plan, write the difference.

Rounds follow each other when something changed, and regularly. Each one begins from what the roscore holds, so a failed
one needs no repair: the next one sees what became of it.
"""

from collections import Counter
from dataclasses import replace
from typing import AbstractSet, Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Set, Tuple
from urllib.parse import urlsplit
from xmlrpc.client import Fault

from ..edge.clock import monotonic
from ..edge.loop import Workers
from ..edge.process import program
from ..edge.rpc_client import Rpc
from ..protocol import imports
from ..protocol.imports import Claims
from ..protocol.messages import Registration
from ..protocol.plain_text import quote
from .core import limits
from .core.step import Knowledge, Names, apply_plan, names, step
from .core.sync import Candidate, Plan, Refusal, Sync, View, calls, nodes_of, plan
from .lost import Lost
from .own_graph import OwnGraph
from .type_questions import TypeQuestions

ROUND = 30.0  # seconds between two rounds, if nothing happens
REST, LONGEST_REST = 4, 0.5  # times as long as a round took, and seconds at most, after it: news wait for each other
SHARE = 1000  # times as long as a round took, there is none if nothing happens
AGAIN = (0.2, 0.5, 1.0)  # seconds after failed rounds: a roscore under load refuses one now and then
SETTLED = 5.0  # seconds after the last whole state that came there is a round, which looks at all that is registered,
SETTLED_AFTER_ALL = 20.0  # and so many after the first one, however many come: a fleet meets one by one
LEFTOVERS = 15.0  # seconds that registrations of an earlier life wait for their master to be found again
UPDATE_TIMEOUT = 3.0  # seconds for telling a subscriber of another robot who publishes
LINES = 10  # log lines of one round
STANDING = ("place", "limit")  # kinds of refusals


class Taken(Exception):
    """A name is not as it was thought to be."""


class Reading:
    """The part of the own roscore that a round needs: who has the names of what was wanted when the round began."""

    def __init__(self, wanted: Sequence[Candidate], view: View, claims: Claims, met: AbstractSet[str]) -> None:
        """`met`: the masters whose state was had when the round began."""
        self.wanted, self.view, self.claims, self.met = {item.registration for item in wanted}, view, claims, met


class Callbacks(NamedTuple):
    """What a round asks, and what it tells at its end."""

    listed: Callable[[], bool]  # the list of masters was had
    refused: Callable[[List[Refusal]], None]
    over: Callable[[Optional[Exception]], None]


class Rounds:
    """Carries out the rounds of one master_sync."""

    def __init__(
        self,
        graph: OwnGraph,
        node: Tuple[str, str],
        core: Sync,
        questions: TypeQuestions,
        lost: Lost,
        roscore_calls: Workers,
        updaters: Workers,
        limited: program.LimitedLog,
        callbacks: Callbacks,
    ) -> None:
        """`node`: name and URI of this node. `roscore_calls`: one thread, in which everything is asked of the roscore."""
        self.claims: Claims = {}
        self.held: Dict[Registration, str] = {}
        self.met: Set[str] = set()  # URIs of the masters whose state was had in this life
        self.working = False
        self.made: Counter[str] = Counter()  # what was done -> how many registrations
        self.failures = 0  # rounds that failed
        self._roscore, self._graph, self._node, self._core = graph.roscore, graph, node, core
        self._questions, self._lost, self._callbacks = questions, lost, callbacks
        self._calls, self._updaters, self._limited = roscore_calls, updaters, limited
        self._started = float("inf")  # when the loop began: from then on leftovers wait
        self._due: Optional[float] = None  # a round for a reason
        self._regular: Optional[float] = None  # the round if nothing happens
        self._unsettled: Optional[float] = None  # when the first whole state came since the last round
        self._failed = 0
        self._withdrawn: Optional[Callable[[str], None]] = None
        self._view: Optional[View] = None  # what the roscore holds, as far as it is known
        self._last_refused: List[Refusal] = []
        self._touched: Set[Registration] = set()
        self._began = self.took = 0.0  # when the last round began, and seconds that it took
        self._rest = 0.0  # until then there is no other one: many masters that are met together make few rounds

    def take_over(self) -> None:
        """Read what an earlier life registered, and say from now on who keeps the record."""
        (text,) = self._roscore.ask(("getParam", imports.IMPORTS))
        self.claims = imports.claims_of(text)
        if self.claims:
            program.LOG.info("%d nodes of other masters are registered here since before this start", len(self.claims))
        # Also an empty record tells who keeps it: discovery and the verification then ask nobody else.
        if self._roscore.ask(("setParam", imports.IMPORTS, self._record(self.claims))) == [None]:
            program.LOG.warning(
                "the roscore does not let this program set %s, so it cannot keep names of other robots apart from own ones: "
                "have both run by one user, or this one by root",
                imports.IMPORTS,
            )

    def soon(self, at: float) -> None:
        """Have a round at this time, or earlier."""
        self._due = at if self._due is None else min(at, self._due)

    def touch(self, items: Set[Registration]) -> None:
        """Look at these registrations: they may have changed. Who is refused for his place, or as too many, a round tells at once."""
        self._touched |= items
        if {item for item in self._last_refused if item.kind in STANDING} != set(self._standing()):
            self.soon(monotonic())

    def touch_all(self, master: str, items: Set[Registration]) -> None:
        """Look at all of a master whose whole state has come: at these, and at what an earlier life registered for it."""
        now = monotonic()
        self.met.add(master)
        self.touch(items.union(item for item, uri in self.held.items() if uri == master))
        # A regular round waits as well: it would delay what others wait for, in all robots of a fleet that meets at once.
        self._unsettled = now if self._unsettled is None else self._unsettled
        self._regular = min(now + SETTLED, self._unsettled + SETTLED_AFTER_ALL)

    def _standing(self) -> List[Refusal]:
        """The refusals that a state has in it, whatever is registered."""
        return self._core.place_refusals() + limits.limit_refusals(self._core.remotes)

    def tick(self, now: float) -> Optional[float]:
        """Begin a round where one is due; the time of the next one. The end of one wakes the loop."""
        self._started = min(self._started, now)
        gone, due = self._core.next_expiry(now), self._next()
        if due is not None and now >= due and not self.working:
            self._begin(self._core.candidates(now))
        elif self._touched and not self.working:
            self._step(now)
        if gone is not None:
            self.soon(gone)
        return None if self.working else self._next()

    def _next(self) -> Optional[float]:
        due = [time for time in (self._due, self._regular) if time is not None]
        return max(min(due), self._rest) if due else None

    def withdraw(self, done: Callable[[str], None]) -> None:
        """Take everything back, once. `done(farewell)` is called in the loop."""
        self._withdrawn = done
        if not self.working:
            self._begin([])

    # Read

    def _begin(self, wanted: List[Candidate]) -> None:
        self.working, self._began = True, monotonic()
        self._due = self._regular = self._unsettled = None
        self._touched, self._view = set(), None
        claims, met = dict(self.claims), frozenset(self.met)
        self._calls.submit(lambda: self._read(wanted, claims, met), self._read_done)

    def _read(self, wanted: List[Candidate], claims: Claims, met: AbstractSet[str]) -> Reading:
        """Ask the roscore; in its thread."""
        claimed = {node for node, _uri in claims}
        return Reading(wanted, self._graph.read(lambda view: _matter(wanted, claimed, view)), claims, met)

    # Plan

    def _read_done(self, reading: Optional[Reading], problem: Optional[Exception]) -> None:
        if reading is None:
            self._end(problem)
            return
        todo = self._plan(reading, monotonic())
        before = reading.view.registrations(reading.claims)
        # Reported before it is visible in the roscore, so that discovery never takes it for the robot's own.
        self.held = {**{item: reading.claims[item.node_key] for item in before}, **todo.held}
        self._last_refused = todo.refused
        self._calls.submit(
            lambda: self._write(todo, reading.claims),
            lambda results, why: self._round_written(todo, reading, results, why),
        )

    def _round_written(
        self, todo: Plan, reading: Reading, results: Optional[List[Any]], problem: Optional[Exception]
    ) -> None:
        now = monotonic()
        self.took = now - self._began
        self._rest = now + min(self.took * REST, LONGEST_REST)
        if results is not None:
            self._view = apply_plan(todo, reading.view)
        self._written(todo, reading.claims, results, problem)

    # A step: a few registrations, without reading the roscore

    def _step(self, now: float) -> None:
        touched, self._touched = self._touched, set()
        todo = self._small_plan(touched, now)
        if todo is None:
            self.soon(now)
            return
        if not todo.register and not todo.unregister:
            return
        self.working = True
        before, claims = self.held, self.claims
        self.held = {**before, **todo.held}  # as above: reported before it is visible
        needed = names(todo, claims, self._graph.guarded)
        self._calls.submit(
            lambda: self._write(todo, claims, needed),
            lambda results, why: self._step_written(todo, before, results, why),
        )

    def _small_plan(self, touched: Set[Registration], now: float) -> Optional[Plan]:
        if self._view is None or self._withdrawn or self._core.on_demand or not self._callbacks.listed():
            return None
        if now - self._started < LEFTOVERS and not self.met.issuperset(self.claims.values()):
            return None
        refused = {item.name for item in self._last_refused}
        known = Knowledge(self._view, self.claims, self.held, refused)
        todo = step(touched, self._core.find_candidates(touched, now), known, self._core.is_contested)
        return None if todo is None else replace(todo, refused=self._last_refused)

    def _step_written(
        self, todo: Plan, before: Dict[Registration, str], results: Optional[List[Any]], problem: Optional[Exception]
    ) -> None:
        if isinstance(problem, Taken):
            self.working, self.held = False, before
            self.soon(monotonic())
            return
        view, claims = self._view, self.claims
        self._view = apply_plan(todo, view) if view is not None and results is not None else None
        if todo.claims != claims and self._view is not None:
            self._lost.registered(todo.held, self._view, todo.claims, monotonic())
        self._written(todo, claims, results, problem)

    def _plan(self, reading: Reading, now: float) -> Plan:
        view = reading.view
        wanted = [] if self._withdrawn else self._core.candidates(now, view.local_nodes(reading.claims))
        # What came meanwhile is for the next round: nobody has looked whether its name is free.
        wanted = [item for item in wanted if item.registration in reading.wanted]
        if not self._withdrawn and (now - self._started < LEFTOVERS or not self._callbacks.listed()):
            wanted += self._leftovers(reading)
        verdict = self._questions.guard.judge(wanted, view, reading.claims, self._core.stamps(), now)
        for question in verdict.questions:
            self._questions.ask(question)
        todo = plan(verdict.wanted, view, reading.claims)
        todo.refused += verdict.refused + self._standing()
        self._lost.registered(todo.held, view, reading.claims, now)
        return todo

    def _leftovers(self, reading: Reading) -> List[Candidate]:
        """Registrations of an earlier life whose masters have not been found again yet."""
        keep = {key: uri for key, uri in reading.claims.items() if uri not in reading.met}
        return [
            Candidate(item, keep[item.node_key], keep[item.node_key])
            for item in sorted(reading.view.registrations(keep))
        ]

    # Write

    def _write(self, todo: Plan, claims: Claims, needed: Optional[Names] = None) -> List[Any]:
        """Make all calls in one request, the record of imports first; in the thread of the roscore. Raises Taken."""
        if needed is not None and any(needed):
            found = self._roscore.ask(*needed.free, *(("lookupNode", node) for node in needed.same))
            if any(found[: len(needed.free)]) or found[len(needed.free) :] != list(needed.same.values()):
                raise Taken
        record: List[Tuple[Any, ...]] = []
        if todo.claims != claims:
            record = [("setParam", imports.IMPORTS, self._record(todo.claims))]
        results = self._graph.carry_out([(call[0], self._node[0], *call[1:]) for call in record] + calls(todo))
        return results[len(record) :]

    def _record(self, claims: Claims) -> str:
        return imports.write(*self._node, claims)

    def _written(self, todo: Plan, claims: Claims, results: Optional[List[Any]], problem: Optional[Exception]) -> None:
        self.claims = todo.claims  # also after a failure: perhaps it was carried out, and the next round will see
        if results is None:
            self._end(problem)
            return
        self.held = dict(todo.held)
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
                self._tell_publishers(item, master, result[2])
        for master, verb, item in done[:LINES]:
            program.LOG.info("%s: %s the %s", self._name(master), verb, item)
        if len(done) > LINES:
            program.LOG.info("... and %d more registrations", len(done) - LINES)
        self._callbacks.refused(todo.refused)
        self._end(None)

    def _name(self, master: str) -> str:
        remote = self._core.remotes.get(master)
        return remote.announced.name if remote is not None else urlsplit(master).hostname or master

    def _tell_publishers(self, item: Registration, master: str, publishers: List[str]) -> None:
        """Tell a subscriber who publishes: it is on another robot, and a roscore tells only the caller."""
        uris = self._core.publishers_for(item, master, publishers)
        if not uris:
            return

        def told(_result: Any, problem: Optional[Exception]) -> None:
            if problem is not None:
                text = f"{quote(item.node)} cannot be told who publishes {quote(item.name)}: {quote(problem)}"
                self._limited.say("warning", f"update {item.node_uri}", text)

        self._updaters.submit(
            lambda: Rpc(item.node_uri, UPDATE_TIMEOUT).call("publisherUpdate", "/master", item.name, uris), told
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
            if self._regular is None:  # no whole state came meanwhile
                self._regular = now + max(ROUND, self.took * SHARE)
            if self.claims.keys() - nodes_of(self.held):
                self.soon(now + AGAIN[-1])
            if now < self._started + LEFTOVERS and not self.met.issuperset(self.claims.values()):
                self.soon(self._started + LEFTOVERS)
        self._callbacks.over(problem)

    def _end_withdrawal(self, problem: Optional[Exception], done: Callable[[str], None]) -> None:
        if self.held and problem is None:  # the round that was under way registered something
            self._begin([])
            return
        farewell = "withdrawn" if problem is None else f"nothing is withdrawn, the roscore does not answer: {problem}"
        self._calls.submit(
            lambda: problem is None and self._roscore.ask(("deleteParam", imports.IMPORTS)),
            lambda *_result: done(farewell),
        )


def _matter(wanted: Sequence[Candidate], claimed: Set[str], view: View) -> Tuple[List[str], List[str]]:
    """The nodes and the services whose URIs a round needs, sorted.

    A node that provides a wanted service here, or has a wanted topic, matters too: is it one of ours?
    """
    asked = {item.registration.name for item in wanted if item.registration.kind == "service"}
    named = {item.registration.name for item in wanted if item.registration.kind != "service"}
    provided = sorted(name for name, users in view.services.items() if name in asked or claimed.intersection(users))
    nodes = {item.registration.node for item in wanted} | claimed
    nodes.update(user for name in provided for user in view.services[name])
    topics = (view.publishers, view.subscribers)
    nodes.update(user for table in topics for name in named.intersection(table) for user in table[name])
    return sorted(nodes), provided
