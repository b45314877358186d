# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The XML-RPC methods of master_discovery: who this is, and the state of its master."""

import getpass
import os
import threading
from dataclasses import dataclass
from functools import partial
from typing import Any, Callable, Dict, Iterable, List, Optional, Set, Tuple

from ..edge.clock import sleep, wall_clock
from ..edge.counter import Count
from ..edge.process import program
from ..edge.process.systemd import notify
from ..protocol import json_text
from ..protocol.differences import DIFFERENCES, PACKED
from ..protocol.filters import InvalidPattern, Pattern, Rules
from ..protocol.graph import Policy, State, document, local_types, shareable_part, stamp_text
from ..protocol.members import ALLOW, Members
from ..protocol.messages import Master
from ..protocol.plain_text import LINE, plain
from .core.outsiders import Outsider
from .rpc_server import Callers, PerCaller, Refused, RpcServer, Waiting
from .told import LONGEST_WAIT, Look, Told

NO_STATE = State("", "")

Viewer = Callable[[State], Tuple[State, List[Rules]]]


@dataclass
class OwnMaster:
    """The master that this node tells the others of."""

    uri: str
    name: str
    node: str  # name of this node
    host: Callable[[], str]  # how this computer is called in URIs
    rpc_port: int
    state: Optional[State] = None
    away: str = "its roscore has not been read yet"  # why there is no state; "" where there is one

    def current(self) -> State:
        """The state. Raises Refused where there is none."""
        state = self.state
        if self.away or state is None:
            raise Refused(f"{self.name} has no state: {self.away}")
        return state

    def announced(self, address: str) -> Optional[Master]:
        """The master as discovery announces it from an address; None where there is no state."""
        if self.state is None or self.away:
            return None
        monitor = f"http://{address}:{self.rpc_port}"
        return Master(self.name, self.uri, monitor, self.node, self.state.stamp, self.state.local_stamp, True)


class Served:
    """The methods. They are called in threads of the server."""

    def __init__(
        self,
        own: OwnMaster,
        policy: Policy,
        errors: Dict[str, str],
        own_addresses: Callable[[], Set[str]],
        do_not_sync: Callable[[], Any],
        md5sum: Callable[[str], Optional[str]],
        outsiders: Callable[[], Iterable[Outsider]],
        told: Optional[Told] = None,
    ) -> None:
        """`do_not_sync()`: the parameter of the roscore with this name; `md5sum(type)`: of a message type, None for none.

        `outsiders()`: who is ignored; `told`: has the changes, where others may ask for them alone.
        """
        self._own, self._policy, self._errors, self._own_addresses = own, policy, errors, own_addresses
        self._do_not_sync, self._md5sum = do_not_sync, md5sum
        self._outsiders = outsiders
        self._told = told
        self.changes = Count()  # answers with changes
        self._filtering = threading.Lock()  # patterns of others take time, of which one may have some at once

    def methods(self) -> Dict[str, Callable[..., Any]]:
        """The methods by their names."""
        quick: Dict[str, Any] = {}
        if self._told is not None:
            quick[DIFFERENCES] = Waiting(partial(self._differences, self._told, _as_it_is))
            quick[PACKED] = Waiting(partial(self._differences, self._told, json_text.to_json))
        return {
            **quick,
            "masterContacts": self._master_contacts,
            "masterInfo": PerCaller(self._master_info),
            "masterInfoFiltered": PerCaller(self._master_info_filtered),
            "masterErrors": lambda: [self._own.uri, [plain(text, LINE) for text in list(self._errors.values())]],
            "getCurrentTime": lambda: [self._own.uri, wall_clock()],
            "getTopicsMd5sum": PerCaller(self._md5sums),
            "getUser": lambda: [self._own.uri, _user()],
            "getOutsiders": PerCaller(self._ignored),
        }

    def _ignored(self, caller: str) -> List[Any]:
        """Who is ignored: address, name, URI, why. For this computer alone."""
        if not self._is_here(caller):
            raise Refused("only this computer itself is told who is ignored")
        return [self._own.uri, [list(map(plain, outsider)) for outsider in self._outsiders()]]

    def _master_contacts(self) -> List[str]:
        """Who this is: stamp, master URI, master name, node name, own URI."""
        own, state = self._own, self._own.current()
        return [stamp_text(state.stamp), own.uri, own.name, own.node, f"http://{own.host()}:{own.rpc_port}/"]

    def _master_info(self, caller: str) -> List[Any]:
        """The state of this master, as far as the caller may see it."""
        return document(*self._view(caller))

    def _master_info_filtered(self, caller: str, filters: Any) -> List[Any]:
        """The same without what the caller does not want."""
        state, rules = self._view(caller)
        wanted = _wanted(filters)
        with self._filtering:
            return document(state, [*rules, wanted])

    def _differences(
        self,
        told: Told,
        written: Callable[[Any], Any],
        caller: str,
        may_wait: bool,
        filters: Any,
        epoch: Any,
        revision: Any,
        wait: Any,
    ) -> Any:
        """Tell the news since a revision: [epoch, revision, whole, document, gone, digest]. Waits for it, so many seconds at most."""
        if not isinstance(epoch, str) or not isinstance(revision, int) or not isinstance(wait, (int, float)):
            raise Refused(f"{DIFFERENCES} takes a filter, an epoch (text), a revision (number) and a wait (seconds)")
        wanted = told.filter_of(caller, epoch) if filters == [] else _wanted(filters)

        def look() -> Look:
            viewer = self._viewer(caller)

            def seen(state: State) -> List[Any]:
                shown, rules = viewer(state)
                with self._filtering:
                    return document(shareable_part(shown), [*rules, wanted])

            return Look((written, self._is_here(caller), *viewer(NO_STATE)[1], wanted), seen, written)

        answer = told.answer(caller, wanted, look, epoch, revision, min(max(wait, 0.0), LONGEST_WAIT) * may_wait)
        # A whole state may be as it is sent, packed. Else a digest is there where nothing is new.
        self.changes.add(not isinstance(answer, list) or not answer[5])
        return written(answer) if isinstance(answer, list) else answer

    def _md5sums(self, caller: str, types: Any) -> List[List[str]]:
        """The md5 sums of message types of topics that this master's own nodes have, and the caller may see."""
        if not isinstance(types, list):
            raise Refused("getTopicsMd5sum takes a list of types")
        known = local_types(*self._view(caller))
        found = ((name, self._md5sum(name)) for name in types if isinstance(name, str) and name in known)
        return [[name, md5sum] for name, md5sum in found if md5sum]

    def _is_here(self, caller: str) -> bool:
        return caller.startswith("127.") or caller in self._own_addresses()

    def _view(self, caller: str) -> Tuple[State, List[Rules]]:
        """The state, and the rules by which a caller is told of it."""
        return self._viewer(caller)(self._own.current())

    def _viewer(self, caller: str) -> Viewer:
        """The part of a state that a caller may see, and the rules by which it is told of that."""
        if self._is_here(caller):
            return lambda state: self._policy.view(state, None)
        try:
            secret = Rules(do_not_sync=Pattern.from_items(_listed(self._do_not_sync()), "/do_not_sync"))
        except InvalidPattern as problem:  # what is secret is not known, so everything is
            raise Refused(str(problem)) from None
        return lambda state: self._policy.view(state, caller, [secret])


def _as_it_is(value: Any) -> Any:
    return value


def _wanted(filters: Any) -> Rules:
    try:
        return Rules.from_wire(filters)
    except InvalidPattern as problem:
        raise Refused(f"the filter is not usable: {problem}") from None


def callers(members: Members, own_uri: str, own_addresses: Callable[[], Set[str]]) -> Callers:
    """Who may call, and at which addresses of this computer: it listens at all, since the planned one may come late."""
    own = members.master(own_uri)

    def here(address: str) -> bool:
        return address.startswith("127.") or address in own_addresses()

    def objection(caller: str, at: str) -> str:
        if here(caller) or members.strangers == ALLOW:
            return ""
        if own is not None and at not in own.hosts:
            return f"{at} is no address of this computer in the plan"
        return "" if members.serves(caller) else "it is no computer of the fleet"

    return Callers(objection, bool(members.robots), lambda address: here(address) or members.knows(address))


def serve(
    address: str,
    port: int,
    methods: Dict[str, Callable[..., Any]],
    malformed: Callable[[str, str], None],
    who: Callers,
) -> RpcServer:
    """A running server; blocks until the port is free. `malformed(host, why)` is called in threads of the server."""
    said = False
    while True:
        try:
            return RpcServer(address, port, methods, malformed, who)
        except OSError as problem:
            if not said:
                program.LOG.error("port %d for other masters is not free: %s; trying again", port, problem)
                said = True
            notify(f"STATUS=waiting for TCP port {port}: {problem}", "EXTEND_TIMEOUT_USEC=30000000")
            sleep(1.0)


def _listed(value: Any) -> List[Any]:
    return value if isinstance(value, list) else [value] if value else []


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return str(os.getuid())
