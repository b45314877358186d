# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The master API of a roscore (http://wiki.ros.org/ROS/Master_API), and the registrations there, which it may report by changes."""

from typing import Any, Callable, List, Optional, Sequence, Tuple
from xmlrpc.client import Fault

from ..protocol.graph import State, graph_of
from ..protocol.json_text import pack_rows, unpack_rows
from ..protocol.messages import View
from ..protocol.mirror import CHANGES, Mirror
from ..protocol.plain_text import plain
from ..protocol.xml_rpc import STATE
from .rpc_client import SAME, Last, Rpc

TOGETHER = "rosfleetTogether"
KNOWN = 60.0  # seconds until a roscore that did not report its changes is asked again if it does

Names = Sequence[str]


class Roscore:
    """The master API of a roscore. Its answers are [code, text, value]."""

    def __init__(self, uri: str, caller: str, timeout: float = 5.0) -> None:
        self.rpc, self.caller = Rpc(uri, timeout, STATE, own=True), caller

    def ask(self, *calls: Tuple[Any, ...], last: Optional[Last] = None) -> List[Any]:
        """The values of many calls (without the caller's name) in one request; None if one was refused.

        `last`: no values at all if the answer is that one. Raises OSError, ValueError or xmlrpc.client.Fault if the
        roscore does not answer at all.
        """
        if last is not None and len(calls) == 1:  # again and again: a single one costs two thirds of a multicall
            return self._ask_one(*calls[0], last=last)
        results = self.rpc.multicall([(call[0], self.caller, *call[1:]) for call in calls], last)
        return [_value(result) for result in results]

    def _ask_one(self, method: str, *arguments: Any, last: Optional[Last]) -> List[Any]:
        try:
            result = self.rpc.call(method, self.caller, *arguments, last=last)
        except Fault:
            return [None]
        return [] if result is SAME else [_value(result)]

    def together(self, calls: Sequence[Tuple[Any, ...]]) -> List[Any]:
        """The results of many calls, (method, caller, argument, ...), by a roscore that has TOGETHER; as Rpc.multicall.

        It costs a tenth of the same calls in a multicall, and those who wait for changes are woken less often.
        """
        if not calls:
            return []
        answer = self.rpc.call(TOGETHER, self.caller, pack_rows(calls))
        results = unpack_rows(_value(answer))
        if len(results) != len(calls):
            raise ValueError(f"{self.rpc.uri} does not answer every call")
        return [Fault(1, plain(result)) if isinstance(result, str) else result for result in results]

    def has(self, method: str) -> bool:
        """True if the roscore has a method besides those of rosmaster. Raises as `ask` if it does not answer."""
        try:
            methods = self.rpc.call("system.listMethods")
        except Fault:  # rosmaster lacks even this call
            return False
        return isinstance(methods, list) and method in methods


def _value(result: Any) -> Any:
    if isinstance(result, (list, tuple)) and len(result) == 3 and result[0] == 1:
        return result[2]
    return None


class RoscoreGraph:
    """All registrations of the own roscore, read on demand. If the roscore reports changes, only these are read. For one thread.

    With 3,000 topics, to read everything takes longer than all other work of master_sync.
    """

    def __init__(self, roscore: Roscore) -> None:
        self.roscore = roscore
        self._mirror: Optional[Mirror] = None

    @property
    def guards_names(self) -> bool:
        """True if the roscore lets no node of another robot take the name of an own one: the managed roscore does."""
        return self._mirror is not None

    def read(self, look_up: Callable[[View], Sequence[Names]]) -> View:
        """The registrations now. Raises as Roscore.ask, and OSError if the roscore does not report them.

        `look_up(view)`: the nodes and the services whose URIs are needed, of a view that lacks them yet.
        """
        try:
            if self._mirror is not None or self.roscore.has(CHANGES):
                return self._read_changes()
        except (ValueError, TypeError, Fault):  # it reports no changes
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
            raise OSError("the roscore does not report its state")
        state = graph_of(State("", ""), system, types)
        view = View(state.publishers, state.subscribers, state.services, state.types)
        nodes, names = look_up(view)
        answers = self.roscore.ask(
            *[("lookupNode", node) for node in nodes], *[("lookupService", name) for name in names]
        )
        view.node_uris = {node: uri for node, uri in zip(nodes, answers) if isinstance(uri, str)}
        view.service_uris = {name: uri for name, uri in zip(names, answers[len(nodes) :]) if isinstance(uri, str)}
        return view
