# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The master API of a roscore (http://wiki.ros.org/ROS/Master_API)."""

from typing import Any, List, Optional, Sequence, Tuple
from xmlrpc.client import Fault

from ..protocol.json_text import pack_rows, unpack_rows
from ..protocol.plain_text import plain
from ..protocol.xml_rpc import STATE
from .rpc_client import SAME, Last, Rpc

TOGETHER = "rosfleetTogether"
KNOWN = 60.0  # seconds until a roscore that did not tell its changes is asked again whether it does


class Roscore:
    """The master API of a roscore. Its answers are [code, text, value]."""

    def __init__(self, uri: str, caller: str, timeout: float = 5.0) -> None:
        self.rpc, self.caller = Rpc(uri, timeout, STATE, own=True), caller

    def ask(self, *calls: Tuple[Any, ...], last: Optional[Last] = None) -> List[Any]:
        """The values of many calls (without the caller's name) in one request; None where one was refused.

        `last`: no values at all where the answer is that one. Raises OSError, ValueError or xmlrpc.client.Fault where the
        roscore does not answer at all.
        """
        if last is not None and len(calls) == 1:  # again and again: alone it costs two thirds of a multicall
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

        It costs a tenth of what the same calls cost in a multicall, and those who wait for changes are woken less often.
        """
        if not calls:
            return []
        answer = self.rpc.call(TOGETHER, self.caller, pack_rows(calls))
        results = unpack_rows(_value(answer))
        if len(results) != len(calls):
            raise ValueError(f"{self.rpc.uri} does not answer every call")
        return [Fault(1, plain(result)) if isinstance(result, str) else result for result in results]

    def has(self, method: str) -> bool:
        """True where the roscore has a method besides those of rosmaster. Raises as `ask` where it does not answer."""
        try:
            methods = self.rpc.call("system.listMethods")
        except Fault:  # rosmaster has not even this one
            return False
        return isinstance(methods, list) and method in methods


def _value(result: Any) -> Any:
    if isinstance(result, (list, tuple)) and len(result) == 3 and result[0] == 1:
        return result[2]
    return None
