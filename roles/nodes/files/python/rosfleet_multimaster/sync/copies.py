# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies planned parameters of other robots to the own roscore, keeps them up to date, and takes them away again.

The other roscores are asked again and again. To subscribe would be no way: who subscribes becomes a node of that roscore,
which would end its own /master_sync for having the same name. A question leaves nothing there, and each roscore knows it.
A large value is asked for less often, so it takes no more of the network than a small one.
"""

from contextlib import closing
from functools import partial
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

from ..edge.clock import monotonic
from ..edge.loop import Loop, Workers
from ..edge.process import program
from ..edge.roscore import Roscore
from ..edge.rpc_client import Last, Rpc
from ..protocol.plain_text import quote
from ..protocol.xml_rpc import DocumentTooLarge
from .core import copies, values
from .core.copies import Contents, Copy, OfferedParameter, Todo
from .core.sync import NEVER, RegistrationConflict, Sync

LOOK = 0.5  # seconds between two looks at who is there
ASK = 2.0  # seconds between two questions to a robot, at least
RATE, SELDOM = 1 << 16, 60.0  # bytes of values that are asked for in a second, and the longest pause for that
RETRY = (2.0, 5.0, 15.0, 30.0)  # seconds after questions without an answer
TIMEOUT = 5.0  # seconds for an answer
MOST = 2 << 20  # bytes of an answer
ROUND = 30.0  # seconds between two looks at the own roscore, if nothing happens
AGAIN = 1.0  # seconds after a pass that failed
LEFTOVERS = 15.0  # seconds that parameters of an earlier life wait for their robot
READERS = 4
LINES = 10  # log lines of one pass

#: the plan of a pass, the names that could not be set, and the problem of one that was not carried out to its end
PassResult = Tuple[Todo, Set[str], Optional[Exception]]


class ParameterAnswer(NamedTuple):
    """The planned parameters of a robot: the values that are taken, and why others are not."""

    values: Mapping[str, Tuple[Any, str]]  # name -> value and digest
    refusals: Mapping[str, str]
    size: int


class ParameterSource:
    """A robot whose parameters are planned to be here."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.names: Dict[str, str] = {}  # of a parameter here -> there
        self.title = name  # as discovery has it
        self.rpc: Optional[Rpc] = None
        self.last = Last()
        self.due = 0.0
        self.asking, self.failures = False, 0
        self.met = False  # in this life
        self.answer: Optional[ParameterAnswer] = None

    def begin(self, uri: str) -> Rpc:
        """The connection to ask over."""
        if self.rpc is None or self.rpc.uri != uri:
            self.drop()
            self.rpc = Rpc(uri, TIMEOUT, MOST)
        self.asking = True
        return self.rpc

    def drop(self) -> None:
        """Ask for everything the next time."""
        if self.rpc is not None and self.asking:
            self.rpc.cut()  # its thread closes it
        elif self.rpc is not None:
            self.rpc.close()
        self.rpc, self.last = None, Last()


class Copies:
    """Carries out the plan of parameters of one master_sync."""

    def __init__(
        self,
        loop: Loop,
        roscore: Roscore,
        core: Sync,
        calls: Workers,
        limited: program.LimitedLog,
        entries: Sequence[Mapping[str, Any]],
        on_change: Callable[[], None],
    ) -> None:
        """`calls`: one thread, for all calls of the own roscore. `entries`: the parameter ~sync_parameters."""
        self.record: copies.Record = {}
        self.refused: List[RegistrationConflict] = []
        self._roscore, self._core, self._calls, self._limited = roscore, core, calls, limited
        self._on_change = on_change
        self._sources: Dict[str, ParameterSource] = {}
        for entry in entries:
            source = self._sources.setdefault(str(entry["from"]).lower(), ParameterSource(entry["from"]))
            source.names.update({entry.get("as", "") + name: name for name in entry["names"]})
        self._readers = Workers(loop, READERS if entries else 0)
        self._started = NEVER
        self._look_due, self._pass_due = 0.0 if entries else NEVER, NEVER
        self._working = False
        self._done: Optional[Callable[[], None]] = None  # the program ends

    def take_over(self) -> None:
        """Read the record of an earlier life. Raises as Roscore.ask."""
        (text,) = self._roscore.ask(("getParam", copies.RECORD))
        self.record = copies.read(text)
        if self.record:
            program.LOG.info("%d parameters of other robots are here since before this start", len(self.record))
        self._pass_due = 0.0 if self.record or self._sources else NEVER

    def masters(self) -> List[str]:
        """The names of the masters that parameters are planned of."""
        return [source.title for source in self._sources.values()]

    def describe(self, master: str) -> str:
        """The words about a master's copies for a status; empty if this robot has no copies of that master."""
        count = sum(mine.master == master for mine in self.record.values())
        return f", {count} parameters" if count else ""

    def tick(self, now: float) -> float:
        """Do all that is due; the time of the next thing to do."""
        if self._done is not None:
            return NEVER
        self._started = min(self._started, now)
        if now >= self._look_due:
            self._look_due = now + LOOK
            self._look(now)
        if now >= self._pass_due and not self._working:
            self._begin(now)
        return self._look_due if self._working else min(self._look_due, self._pass_due)

    def look_soon(self) -> None:
        """A master has come or gone."""
        if self._sources:
            self._look_due = 0.0

    # The other robots

    def _look(self, now: float) -> None:
        present = self._core.find_members(now)
        for key, source in self._sources.items():
            master = present.get(key)
            if master is None:
                self._lose(source, now)
                continue
            source.title = master.name
            if master.online and not source.asking and now >= source.due:
                self._ask(source, master.uri, now)

    def _lose(self, source: ParameterSource, now: float) -> None:
        """Its robot is not there, or not any more."""
        source.due = 0.0
        if source.answer is not None:
            source.answer = None
            source.drop()
            self._pass_due = min(self._pass_due, now)

    def _ask(self, source: ParameterSource, uri: str, now: float) -> None:
        try:
            rpc = source.begin(uri)
        except OSError as problem:  # it is no address
            self._on_answer(source, None, None, problem)
            return
        job = partial(_read, rpc, self._roscore.caller, source.names, source.last)
        self._readers.submit(job, partial(self._on_answer, source, rpc))

    def _on_answer(
        self,
        source: ParameterSource,
        rpc: Optional[Rpc],
        answer: Optional[ParameterAnswer],
        problem: Optional[Exception],
    ) -> None:
        """Take an answer. Without one and without a problem it is the last one again."""
        now = monotonic()
        source.asking = False
        if rpc is not None and source.rpc is not rpc:  # its robot was lost meanwhile
            rpc.close()
            return
        if problem is not None:
            source.drop()
            source.due = now + RETRY[min(source.failures, len(RETRY) - 1)]
            source.failures += 1
            text = f"{source.title}: its parameters cannot be read: {quote(problem)}; its values that are here stay"
            self._limited.say("warning", f"parameters {source.name}", text)
            return
        if answer is not None:
            source.answer, source.met = answer, True
            self._pass_due = min(self._pass_due, now)
        size = source.answer.size if source.answer is not None else 0
        source.failures, source.due = 0, now + min(SELDOM, max(ASK, size / RATE))

    # The own roscore: read, plan, write

    def _begin(self, now: float) -> None:
        self._working, self._pass_due = True, NEVER
        last = self._done is not None
        offers, keep = ({}, set()) if last else self._collect(now)
        self._calls.submit(partial(self._run_pass, offers, keep, self.record, last), partial(self._on_pass, last))

    def _collect(self, now: float) -> Tuple[Dict[str, OfferedParameter], Set[str]]:
        """The values to set here, and the names that wait for their robot."""
        offers: Dict[str, OfferedParameter] = {}
        keep: Set[str] = set()
        for source in self._sources.values():
            if source.answer is not None:
                offers.update(
                    {name: OfferedParameter(source.title, *found) for name, found in source.answer.values.items()}
                )
            elif not source.met and now < self._started + LEFTOVERS:
                keep.update(source.names)
        return offers, keep

    def _run_pass(
        self, offers: Dict[str, OfferedParameter], keep: Set[str], record: copies.Record, last: bool
    ) -> PassResult:
        todo = copies.plan_copies(offers, keep, record, self._read_own(sorted({*record, *offers})))
        due = todo.delete or todo.set or todo.record.keys() != record.keys() or (last and record)
        try:
            return todo, self._write(todo, last) if due else set(), None
        except Exception as problem:  # of any kind: the next pass sees the part that is done
            return todo, set(), problem

    def _read_own(self, names: Sequence[str]) -> Contents:
        leaves, *found = self._roscore.ask(("getParamNames",), *[("getParam", name) for name in names])
        if not isinstance(leaves, list):
            raise OSError("the roscore does not report its parameters")
        there = {name: value for name, value in zip(names, found) if value is not None and value != {}}
        return Contents(frozenset(map(str, leaves)), {name: values.digest(value) for name, value in there.items()})

    def _write(self, todo: Todo, last: bool) -> Set[str]:
        """Carry out a plan; the names that could not be set. The record has them before they are set."""
        text = ("deleteParam", copies.RECORD) if last else ("setParam", copies.RECORD, copies.write(todo.record))
        *_deleted, noted = self._roscore.ask(*[("deleteParam", name) for name in todo.delete], text)
        if noted is None and not last:
            raise OSError(f"it does not let this program set {copies.RECORD}")
        failed = set()
        for name, value in todo.set.items():  # one by one: all of them may be too long for one request
            if self._roscore.ask(("setParam", name, value)) == [None]:
                failed.add(name)
        return failed

    def _on_pass(self, last: bool, result: Optional[PassResult], problem: Optional[Exception]) -> None:
        if result is None:
            self._end(last, problem)
            return
        todo, failed, unwritten = result
        if unwritten is not None:
            self.record = {**self.record, **todo.record}
            self._end(last, unwritten)
            return
        self._log(todo, failed)
        before, self.record = _count(self.record), copies.settle(todo, failed)
        refused = [] if last else [*todo.refused, *self._list_refusals()]
        changed = before != _count(self.record) or refused != self.refused
        self.refused = refused
        self._end(last, OSError("a parameter is refused") if failed else None)
        if changed:
            self._on_change()

    def _log(self, todo: Todo, failed: Set[str]) -> None:
        """Report the changes, in a few lines: another robot may change all that it gives again and again."""
        for name in sorted(failed):
            self._limited.say("error", f"set {name}", f"the roscore refuses the parameter {name}")
        lines = [f"{self.record[name].master}: took the parameter {name} away" for name in todo.delete]
        lines += [f"{todo.record[name].master}: copied the parameter {name}" for name in todo.set if name not in failed]
        for line in lines[:LINES]:
            program.LOG.info("%s", line)
        if len(lines) > LINES:
            program.LOG.info("... and %d more parameters", len(lines) - LINES)

    def _list_refusals(self) -> List[RegistrationConflict]:
        """A refusal for each value that is not taken."""
        return [
            RegistrationConflict("parameter", name, source.title, "", f"its value there {why}")
            for source in self._sources.values()
            if source.answer is not None
            for name, why in source.answer.refusals.items()
        ]

    def _end(self, last: bool, problem: Optional[Exception]) -> None:
        self._working = False
        now = monotonic()
        if last and self._done is not None:
            if problem is not None:
                program.LOG.warning("parameters of other robots stay here: %s", quote(problem))
            self._done()
            return
        if self._done is not None:
            self._begin(now)
            return
        if problem is not None:
            self._limited.say(
                "error", "copies", f"parameters cannot be copied to {self._roscore.rpc.uri}: {quote(problem)}"
            )
        waiting = now < self._started + LEFTOVERS and any(not source.met for source in self._sources.values())
        pause = AGAIN if problem is not None else max(self._started + LEFTOVERS - now, 0.0) if waiting else ROUND
        if self.record or self._sources or problem is not None:
            self._pass_due = min(self._pass_due, now + pause)

    def withdraw(self, done: Callable[[], None]) -> None:
        """Take everything away, then call `done()` in the loop."""
        self._done = done
        if not self._working:
            self._begin(monotonic())


def _count(record: Mapping[str, Copy]) -> List[Tuple[str, str]]:
    return [(name, mine.master) for name, mine in sorted(record.items())]


def _read(rpc: Rpc, caller: str, names: Mapping[str, str], last: Last) -> Optional[ParameterAnswer]:
    """The values of a roscore, by names here -> there; None if it is the last answer again. Raises as Rpc does."""
    try:
        results = rpc.multicall([("getParam", caller, name) for name in names.values()], last)
    except DocumentTooLarge:
        with closing(Rpc(rpc.uri, TIMEOUT, MOST)) as other:
            results = [_read_one(other, caller, name) for name in names.values()]
    return _take(list(names), results) if results else None


def _read_one(rpc: Rpc, caller: str, name: str) -> Any:
    try:
        return rpc.call("getParam", caller, name)
    except DocumentTooLarge:
        return values.UnusableValue(f"has more than {MOST} bytes")


def _take(names: Sequence[str], results: Sequence[Any]) -> ParameterAnswer:
    """The answer in results of getParam. Raises ValueError if they are no such results."""
    taken: Dict[str, Tuple[Any, str]] = {}
    refusals: Dict[str, str] = {}
    total = 0
    for name, result in zip(names, results):
        try:
            if isinstance(result, values.UnusableValue):
                raise result
            value = _value(result)
            if value is None or value == {}:
                continue
            made, size = values.take(value)
            taken[name] = made, values.digest(made)
            total += size
        except values.UnusableValue as problem:
            refusals[name] = str(problem)
            total += MOST
    return ParameterAnswer(taken, refusals, total)


def _value(result: Any) -> Any:
    """The value in a result of getParam, None if the parameter is not set. Raises ValueError."""
    if isinstance(result, list) and len(result) == 3 and isinstance(result[0], int):
        if result[0] == 1:
            return result[2]
        if result[0] == -1:
            return None
    raise ValueError("it does not answer as a roscore")
