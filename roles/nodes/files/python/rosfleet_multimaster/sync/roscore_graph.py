# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""All registrations of the own roscore, read on demand. Where the roscore tells changes, only these are read.

With 3,000 topics, to read everything takes longer than all other work of master_sync.
"""

from typing import Any, Callable, List, Optional, Sequence, Tuple
from xmlrpc.client import Fault

from ..edge.roscore import Roscore
from ..protocol.graph import State, graph_of
from ..protocol.mirror import CHANGES, Mirror
from .core.sync import View

Names = Sequence[str]


class RoscoreGraph:
    """The registrations. For one thread."""

    def __init__(self, roscore: Roscore) -> None:
        self.roscore = roscore
        self._mirror: Optional[Mirror] = None

    @property
    def guards_names(self) -> bool:
        """True where the roscore lets no node of another robot take the name of an own one: the managed roscore does."""
        return self._mirror is not None

    def read(self, look_up: Callable[[View], Sequence[Names]]) -> View:
        """The registrations now. Raises as Roscore.ask, and OSError where the roscore does not tell them.

        `look_up(view)`: the nodes and the services whose URIs are needed, of a view that has none yet.
        """
        try:
            if self._mirror is not None or self.roscore.has(CHANGES):
                return self._read_changes()
        except (ValueError, TypeError, Fault):  # it tells us no changes
            pass
        except Exception:
            self._mirror = None  # the next one may be another roscore
            raise
        self._mirror = None
        return self._read_whole(look_up)

    def carry_out(self, calls: Sequence[Tuple[Any, ...]]) -> List[Any]:
        """Make calls, (method, caller, argument, ...), in one request; the results as of Rpc.multicall. Raises as `read`."""
        if self._mirror is None:
            return self.roscore.rpc.multicall(calls)
        try:
            return self.roscore.together(calls)
        except Exception:
            self._mirror = None  # the next one may be another roscore
            raise

    def _read_changes(self) -> View:
        mirror = self._mirror = self._mirror or Mirror("", "")
        mirror.take_answer(self.roscore.rpc.call(CHANGES, self.roscore.caller, *mirror.position, 0, True))
        state, uris = mirror.state, (mirror.node_uris, mirror.service_uris)
        return View(state.publishers, state.subscribers, state.services, state.types, *map(dict, uris))

    def _read_whole(self, look_up: Callable[[View], Sequence[Names]]) -> View:
        types, system = self.roscore.ask(("getTopicTypes",), ("getSystemState",))
        if types is None or system is None:
            raise OSError("the roscore does not tell its state")
        state = graph_of(State("", ""), system, types)
        view = View(state.publishers, state.subscribers, state.services, state.types)
        nodes, names = look_up(view)
        answers = self.roscore.ask(
            *[("lookupNode", node) for node in nodes], *[("lookupService", name) for name in names]
        )
        view.node_uris = {node: uri for node, uri in zip(nodes, answers) if isinstance(uri, str)}
        view.service_uris = {name: uri for name, uri in zip(names, answers[len(nodes) :]) if isinstance(uri, str)}
        return view
