# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Questions about the types of shared topics: to own nodes, and to other masters."""

from contextlib import closing
from functools import partial
from typing import Any, Callable, Dict, List, Optional, Tuple

from ..edge.clock import monotonic
from ..edge.loop import Loop, Workers
from ..edge.rpc_client import Rpc
from ..protocol.messages import NodeKey
from ..protocol.xml_rpc import NODE
from .core.message_types import TypeGuard, TypeVerdict

TYPES = 200  # types in one question to another master: the answer must fit
TIMEOUT = 2.0  # seconds for the answer of an own node or of another master

Md5Sum = Callable[[str], Optional[str]]
Md5Sums = Tuple[Dict[str, str], Dict[str, str]]  # type -> md5 sum: of another master, and here


class TypeQuestions:
    """Carries out the questions of a TypeGuard, and gives it the answers."""

    def __init__(
        self,
        loop: Loop,
        monitor_of: Callable[[str], str],
        md5sum: Md5Sum,
        on_answer: Callable[[], None],
    ) -> None:
        """`monitor_of(master)`: the URI of its discovery, "" if it has left; `md5sum(type)`: None if unknown here."""
        self._workers = Workers(loop, 4)
        self.guard = TypeGuard()
        self._monitor_of, self._md5sum, self._on_answer = monitor_of, md5sum, on_answer

    def ask(self, verdict: TypeVerdict) -> None:
        """Ask all that is to be asked, and hand the answers to the guard later."""
        for node in verdict.nodes:
            self._workers.submit(partial(_types_of, node[1]), partial(self._take_types, node))
        for master, types in verdict.masters.items():
            job = partial(_md5sums, self._monitor_of(master), sorted(types), self._md5sum)
            self._workers.submit(job, partial(self._take_md5sums, master))

    def _take_types(self, node: NodeKey, types: Optional[Dict[str, str]], _problem: Optional[Exception]) -> None:
        self.guard.take_node_types(node, types, monotonic())
        self._on_answer()

    def _take_md5sums(self, master: str, sums: Optional[Md5Sums], _problem: Optional[Exception]) -> None:
        there, here = sums or (None, {})
        self.guard.take_md5sums(master, there, here, monotonic())
        self._on_answer()


def _types_of(node_uri: str) -> Dict[str, str]:
    """Topic -> type, as a node of this robot has them."""
    types: Dict[str, str] = {}
    with closing(Rpc(node_uri, TIMEOUT, NODE)) as rpc:
        for method in ("getPublications", "getSubscriptions"):
            answer = rpc.call(method, "/rosfleet")
            rows = answer[2] if isinstance(answer, list) and len(answer) == 3 and isinstance(answer[2], list) else []
            types.update({row[0]: row[1] for row in rows if _is_pair(row)})
    return types


def _md5sums(monitor_uri: str, types: List[str], md5sum: Md5Sum) -> Md5Sums:
    """The md5 sums of types at another master, and here. Only types that an own node has named are imported."""
    there: Dict[str, str] = {}
    with closing(Rpc(monitor_uri, TIMEOUT)) as rpc:
        for at in range(0, len(types), TYPES):
            rows = rpc.call("getTopicsMd5sum", types[at : at + TYPES])
            there.update({row[0]: row[1] for row in rows if _is_pair(row)} if isinstance(rows, list) else {})
    here = {name: md5sum(name) for name in types if name in there}
    return there, {name: text for name, text in here.items() if text}


def _is_pair(row: Any) -> bool:
    return isinstance(row, list) and len(row) == 2 and all(isinstance(text, str) for text in row)
