# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The states of other masters, fetched from their discovery nodes when the core wants them."""

from functools import partial
from typing import Any, Callable, Dict, List, Optional, Tuple
from xmlrpc.client import Fault

from ..core.graph import Malformed, State, parse
from ..core.limits import limited
from ..core.members import Members, Networks
from ..core.places import Here, Places, names_to_resolve
from ..core.sync import Fetch, Sync
from ..edge.addresses import address_of, network, networks
from ..edge.clock import monotonic
from ..edge.loop import Loop, Workers
from ..edge.rpc_client import Rpc
from ..edge.xml_rpc import STATE
from . import program

TIMEOUT = 10.0  # seconds


LOOKUPS = 3.0  # seconds for the names in a state that the plan does not have

Fetched = Tuple[State, Places]  # a state, and where its nodes may be


class Fetcher:
    """Carries out what the core wants to fetch."""

    def __init__(self, loop: Loop, core: Sync, limited: program.Limited, fetched: Callable[[str], None]) -> None:
        """`fetched(uri)`: there is a new state of this master."""
        self._workers = Workers(loop, 8)
        self._core, self._limited, self._on_state = core, limited, fetched

    def tick(self, now: float) -> Optional[float]:
        """Fetch what is due; the time of the next fetch."""
        for fetch in self._core.due(now):
            before = self._core.remotes[fetch.uri].state
            job = partial(_fetch, fetch, self._core.sync_remote_nodes, before, self._core.own_uri, self._core.members)
            self._workers.submit(job, partial(self._fetched, fetch))
        return self._core.next_due()

    def _fetched(self, fetch: Fetch, found: Optional[Fetched], problem: Optional[Exception]) -> None:
        state, places = found or (None, None)
        if self._core.fetched(fetch, state, str(problem or ""), monotonic(), places):
            self._on_state(fetch.uri)
        elif problem is not None:
            self._limited.say(
                "warning",
                f"fetch {fetch.uri}",
                f"the state of {fetch.uri} cannot be had from {fetch.monitor_uri}: {problem}",
            )


def _fetch(fetch: Fetch, sync_remote_nodes: bool, before: Optional[State], own_uri: str, members: Members) -> Fetched:
    """The state of a master, and where its nodes may be."""
    state = _state(fetch, sync_remote_nodes, before, own_uri)
    here = Here(frozenset(network().own), Networks(networks()))
    resolved = _resolved(names_to_resolve(state, members))
    return state, Places(members, fetch.uri, fetch.monitor_uri, here, resolved)


def _resolved(names: List[str]) -> Dict[str, str]:
    """The addresses of names, of as many as can be looked up in a short time."""
    until, found = monotonic() + LOOKUPS, {}
    for name in names:
        if monotonic() > until:
            break
        try:
            found[name] = address_of(name)
        except (OSError, UnicodeError):  # one that is no host name
            pass
    return found


def _state(fetch: Fetch, sync_remote_nodes: bool, before: Optional[State], own_uri: str) -> State:
    """The state of a master, filtered there where it can be, and as much of it as is taken."""

    def read(value: Any) -> State:
        return limited(parse(value), before, own_uri=own_uri, sync_remote_nodes=sync_remote_nodes)

    rpc = Rpc(fetch.monitor_uri, TIMEOUT, STATE)
    try:
        try:
            state: State = rpc.call("masterInfoFiltered", fetch.rules.to_wire(sync_remote_nodes), read=read)
        except Fault:
            if "masterInfoFiltered" in rpc.call("system.listMethods"):
                raise
            state = rpc.call("masterInfo", read=read)
        return state
    except Malformed as problem:
        raise ValueError(f"it sends no state of a master: {problem}") from None
    finally:
        rpc.close()
