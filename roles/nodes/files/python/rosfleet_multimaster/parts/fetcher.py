# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The states of other masters, fetched from their discovery nodes when the core wants them."""

from functools import partial
from typing import Callable, Optional
from xmlrpc.client import Fault

from ..core.graph import Malformed, State, parse
from ..core.sync import Fetch, Sync
from ..edge.clock import monotonic
from ..edge.loop import Loop, Workers
from ..edge.rpc_client import Rpc
from . import program

TIMEOUT, MAX_STATE = 10.0, 16 << 20  # seconds, bytes: 5,000 topics are 3 MB


class Fetcher:
    """Carries out what the core wants to fetch."""

    def __init__(self, loop: Loop, core: Sync, limited: program.Limited, fetched: Callable[[str], None]) -> None:
        """`fetched(uri)`: there is a new state of this master."""
        self._workers = Workers(loop, 8)
        self._core, self._limited, self._on_state = core, limited, fetched

    def tick(self, now: float) -> Optional[float]:
        """Fetch what is due; the time of the next fetch."""
        for fetch in self._core.due(now):
            self._workers.submit(partial(_fetch, fetch, self._core.sync_remote_nodes), partial(self._fetched, fetch))
        return self._core.next_due()

    def _fetched(self, fetch: Fetch, state: Optional[State], problem: Optional[Exception]) -> None:
        if self._core.fetched(fetch, state, str(problem or ""), monotonic()):
            self._on_state(fetch.uri)
        elif problem is not None:
            self._limited.say(
                "warning",
                f"fetch {fetch.uri}",
                f"the state of {fetch.uri} cannot be had from {fetch.monitor_uri}: {problem}",
            )


def _fetch(fetch: Fetch, sync_remote_nodes: bool) -> State:
    """The state of a master, filtered there where it can be."""
    rpc = Rpc(fetch.monitor_uri, TIMEOUT, MAX_STATE)
    try:
        try:
            return parse(rpc.call("masterInfoFiltered", fetch.rules.to_wire(sync_remote_nodes)))
        except Fault:
            if "masterInfoFiltered" in rpc.call("system.listMethods"):
                raise
            return parse(rpc.call("masterInfo"))
    except Malformed as problem:
        raise ValueError(f"it sends no state of a master: {problem}") from None
    finally:
        rpc.close()
