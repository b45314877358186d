# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The states of other masters, fetched from their discovery nodes when the core wants them."""

from functools import partial
from typing import Any, Callable, Dict, NamedTuple, Optional, Set
from xmlrpc.client import Fault

from ..edge.clock import monotonic
from ..edge.loop import Loop, Workers
from ..edge.process import program
from ..edge.rpc_client import Rpc
from ..protocol.differences import DIFFERENCES, PACKED
from ..protocol.graph import InvalidDocument, State, parse
from ..protocol.messages import Registration
from ..protocol.plain_text import quote
from ..protocol.xml_rpc import STATE, DocumentTooLarge
from .core.limits import size
from .core.places import Places
from .core.sync import Fetch, Sync
from .followed import MOST, TIMEOUT, Answer, Follower, Misplaced, Surroundings, View

MOST_FOLLOWED = 128  # masters: more are fetched when they announce a change


class Fetched(NamedTuple):
    """A state, where its nodes may be, and who can follow its changes."""

    state: State
    places: Places
    method: str  # by which this master tells its changes; "" where it tells none
    follower: Optional[Follower]


class Fetcher:
    """Carries out what the core wants to fetch, and follows the masters that tell their changes."""

    def __init__(
        self,
        loop: Loop,
        core: Sync,
        limited: program.LimitedLog,
        fetched: Callable[[str, Set[Registration]], None],
        changed: Callable[[str, Set[Registration]], None],
        differences: bool = True,
    ) -> None:
        """`fetched(uri, items)`: there is a new state of this master, of which these may be others; `changed` the same, followed.

        `differences`: masters are followed.
        """
        self._workers, self._loop = Workers(loop, 8), loop
        self._core, self._limited, self._on_state, self._on_changes = core, limited, fetched, changed
        self._differences = differences
        self._followers: Dict[str, Follower] = {}
        self._around = Surroundings()
        self._methods: Dict[str, str] = {}  # master -> the method by which it told its changes
        self.states = self.changes = 0  # that came

    def tick(self, now: float) -> Optional[float]:
        """Fetch what is due; the time of the next fetch."""
        for uri in [uri for uri, follower in self._followers.items() if not self._core.follows(follower.fetch)]:
            self._stop(uri)
        for fetch in self._core.due(now):
            self._stop(fetch.uri)
            self._methods = {uri: method for uri, method in self._methods.items() if uri in self._core.remotes}
            before = self._core.remotes[fetch.uri].state
            view = View(fetch, self._core.own_uri, self._core.sync_remote_nodes, self._core.members, self._around)
            quick = self._differences and len(self._followers) < MOST_FOLLOWED
            job = partial(_fetch, fetch, before, view, quick, self._methods.get(fetch.uri, ""))
            self._workers.submit(job, partial(self._fetched, fetch))
        return self._core.next_due()

    def _fetched(self, fetch: Fetch, found: Optional[Fetched], problem: Optional[Exception]) -> None:
        state, places, method, follower = found or Fetched(None, None, "", None)  # type: ignore[arg-type]
        before = self._core.selection(fetch.uri)
        taken = self._core.take_fetch(
            fetch, state, monotonic(), places, quick=bool(method), following=follower is not None
        )
        if found is not None:
            self._methods[fetch.uri] = method
        if follower is not None and taken:
            self._followers[fetch.uri] = follower
            follower.start(
                lambda *news: self._loop.post(self._told, *news), lambda *why: self._loop.post(self._over, *why)
            )
        elif follower is not None:
            follower.stop()
        if taken:
            self.states += 1
            self._on_state(fetch.uri, {*before, *self._core.selection(fetch.uri)})
        elif problem is not None:
            self._limited.say(
                "warning",
                f"fetch {fetch.uri}",
                f"the state of {fetch.uri} cannot be had from {fetch.monitor_uri}: {quote(problem)}{_advice(problem)}",
            )

    # Who is followed

    def _told(self, follower: Follower, state: State, misplaced: Misplaced) -> None:
        if self._followers.get(follower.fetch.uri) is follower and self._core.follows(follower.fetch):
            self.changes += 1
            self._on_changes(follower.fetch.uri, self._core.take_change(follower.fetch.uri, state, misplaced))

    def _over(self, follower: Follower, problem: Exception) -> None:
        uri = follower.fetch.uri
        if self._followers.get(uri) is follower:
            program.LOG.debug("the changes of %s are not followed any more: %s", uri, problem)
            self._stop(uri)

    def _stop(self, uri: str) -> None:
        follower = self._followers.pop(uri, None)
        if follower is not None:
            follower.stop()
            self._core.end_following(uri, monotonic())


def _advice(problem: Exception) -> str:
    if not isinstance(problem, DocumentTooLarge):
        return ""
    return "; nothing new of it is taken, what was registered stays: leave out there what nobody needs, by multimaster_exports"


def _fetch(fetch: Fetch, before: Optional[State], view: View, quick: bool, known: str = "") -> Fetched:
    """The state of a master, filtered there where it can be, and as much of it as is taken.

    `known`: the method by which it told its changes before. It may be another program by now.
    """
    rpc = Rpc(fetch.monitor_uri, TIMEOUT, STATE)
    follower: Optional[Follower] = None
    try:
        method = (known or _method(rpc)) if quick and fetch.quick else ""
        if method:
            answer, state = rpc.call(method, view.wanted, "", 0, 0, read=_whole)
            taken = view.taken(state, before)
            if size(state) <= MOST:
                follower = Follower(rpc, method, fetch, view, answer, state, taken)
        else:
            taken = _without_changes(rpc, view.wanted, lambda value: view.taken(parse(value), before))
        return Fetched(taken, view.places(taken), method, follower)
    except Fault:
        if not known:
            raise
    except InvalidDocument as problem:
        if not known:
            raise ValueError(f"it sends no state of a master: {problem}") from None
    finally:
        if follower is None:
            rpc.close()
    # It is another program by now. What it has sent is gone with the error, since one large answer at a time is enough.
    return _fetch(fetch, before, view, quick)


def _whole(value: Any) -> Any:
    answer = Answer(value)
    state = answer.state(None)
    answer.document = None  # it is large
    return answer, state


def _method(rpc: Rpc) -> str:
    """The method by which this master tells its changes; "" where it tells none."""

    def best(methods: Any) -> str:
        return next((name for name in (PACKED, DIFFERENCES) if isinstance(methods, list) and name in methods), "")

    try:
        return str(rpc.call("system.listMethods", read=best))
    except Fault:
        return ""


def _without_changes(rpc: Rpc, wanted: Any, read: Callable[[Any], State]) -> State:
    """The state of a master that does not tell its changes: of upstream, or where this is switched off."""
    try:
        state: State = rpc.call("masterInfoFiltered", wanted, read=read)
    except Fault:
        if "masterInfoFiltered" in rpc.call("system.listMethods"):
            raise
        state = rpc.call("masterInfo", read=read)
    return state
