# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The XML-RPC methods of master_discovery: its contact, and the state of its master."""

import getpass
import os
import threading
from dataclasses import dataclass
from functools import partial
from typing import Any, Callable, Dict, Iterable, List, Optional, Tuple

from ..edge.clock import wall_clock
from ..edge.loop import Count
from ..edge.rpc_server import LongPoll, Method, PackedAnswer, PerCaller, RefusedCall
from ..protocol import json_text
from ..protocol.differences import DIFFERENCES, PACKED
from ..protocol.filters import InvalidPattern, Rules, secret_names
from ..protocol.graph import ExportPolicy, State, document, local_types, shareable_part, stamp_text
from ..protocol.messages import AnnouncedMaster
from ..protocol.plain_text import LINE, plain
from ..protocol.wire_filters import read_rules
from .core.outsiders import Outsider
from .state_feed import LONGEST_WAIT, CallerView, StateFeed

NO_STATE = State("", "")
UNREAD = "its roscore has not been read yet"

Viewer = Callable[[State], Tuple[State, List[Rules]]]


@dataclass
class ServedMaster:
    """The master that this node announces and serves."""

    uri: str
    name: str
    node: str  # name of this node
    host: Callable[[], str]  # the name of this computer in URIs
    rpc_port: int
    state: Optional[State] = None
    away: str = UNREAD  # why there is no state; "" if there is one

    def current(self) -> State:
        """The state. Raises RefusedCall while the state is unknown."""
        state = self.state
        if self.away or state is None:
            raise RefusedCall(f"{self.name} has no state: {self.away}")
        return state

    def announce(self, address: str) -> Optional[AnnouncedMaster]:
        """The announcement of the master from an address; None if there is no state."""
        if self.state is None or self.away:
            return None
        monitor = f"http://{address}:{self.rpc_port}"
        return AnnouncedMaster(self.name, self.uri, monitor, self.node, self.state.stamp, self.state.local_stamp, True)


class RpcMethods:
    """The methods, called in threads of the server."""

    def __init__(
        self,
        own: ServedMaster,
        policy: ExportPolicy,
        errors: Dict[str, str],
        is_here: Callable[[str], bool],
        do_not_sync: Callable[[], Any],
        md5sum: Callable[[str], Optional[str]],
        outsiders: Callable[[], Iterable[Outsider]],
        feed: Optional[StateFeed] = None,
    ) -> None:
        """`is_here(address)`: of this computer; `do_not_sync()`: the parameter of the roscore with this name; `md5sum(type)`: of a message type, None for none.

        `outsiders()`: the ignored masters; `feed`: the changes, if others may ask for differences.
        """
        self._own, self._policy, self._errors, self._is_here = own, policy, errors, is_here
        self._do_not_sync, self._md5sum = do_not_sync, md5sum
        self._outsiders, self._feed = outsiders, feed
        self.changes = Count()  # answers with changes
        self._filtering = threading.Lock()  # foreign patterns take time: one caller at a time
        self._making = threading.Lock()  # with its foreign registrations, a state may take 100 MB until it is packed

    def methods(self) -> Dict[str, Method]:
        """The methods by their names."""
        quick: Dict[str, Method] = {}
        if self._feed is not None:
            quick[DIFFERENCES] = LongPoll(partial(self._differences, self._feed, list))
            quick[PACKED] = LongPoll(partial(self._differences, self._feed, json_text.to_json))
        return {
            **quick,
            "masterContacts": self._master_contacts,
            "masterInfo": PerCaller(self._master_info),
            "masterInfoFiltered": PerCaller(self._master_info_filtered),
            "masterErrors": lambda: [self._own.uri, [plain(text, LINE) for text in list(self._errors.values())]],
            "getCurrentTime": lambda: [self._own.uri, wall_clock()],
            "getTopicsMd5sum": PerCaller(self._md5sums),
            "getUser": lambda: [self._own.uri, _user()],
            "getOutsiders": PerCaller(self._list_outsiders),
        }

    def _list_outsiders(self, caller: str) -> List[Any]:
        """The ignored masters, each as (address, name, URI, reason). Only for this computer."""
        if not self._is_here(caller):
            raise RefusedCall("only this computer itself gets the list of ignored senders")
        return [self._own.uri, [list(map(plain, outsider)) for outsider in self._outsiders()]]

    def _master_contacts(self) -> List[str]:
        """The contact of this node: stamp, master URI, master name, node name, own URI."""
        own, state = self._own, self._own.current()
        return [stamp_text(state.stamp), own.uri, own.name, own.node, f"http://{own.host()}:{own.rpc_port}/"]

    def _master_info(self, caller: str) -> PackedAnswer:
        """The part of this master's state that the caller may see."""
        with self._making:
            return PackedAnswer(document(*self._view(caller)))

    def _master_info_filtered(self, caller: str, filters: Any) -> PackedAnswer:
        """The same, by a filter of the caller."""
        state, rules = self._view(caller)
        wanted = self._read_filter(filters)
        with self._making, self._filtering:
            return PackedAnswer(document(state, [*rules, wanted]))

    def _differences(
        self,
        feed: StateFeed,
        encode: Callable[[Any], Any],
        caller: str,
        may_wait: bool,
        filters: Any,
        epoch: Any,
        revision: Any,
        wait: Any,
    ) -> Any:
        """The news since a revision: [epoch, revision, whole, document, gone, digest]. Waits for them, `wait` seconds at most."""
        if not isinstance(epoch, str) or not isinstance(revision, int) or not isinstance(wait, (int, float)):
            raise RefusedCall(
                f"{DIFFERENCES} takes a filter, an epoch (text), a revision (number) and a wait (seconds)"
            )
        wanted = feed.find_filter(caller, epoch) if filters == [] else self._read_filter(filters)

        def make_view() -> CallerView:
            viewer = self._viewer(caller)

            def make_document(state: State) -> List[Any]:
                part, rules = viewer(state)
                with self._filtering:
                    return document(shareable_part(part), [*rules, wanted])

            return CallerView((encode, self._is_here(caller), *viewer(NO_STATE)[1], wanted), make_document, encode)

        answer = feed.answer(caller, wanted, make_view, epoch, revision, min(max(wait, 0.0), LONGEST_WAIT) * may_wait)
        # A packed answer is a whole state. In a list, a digest says that nothing is new.
        self.changes.add(not isinstance(answer, list) or not answer[5])
        return encode(answer) if isinstance(answer, list) else answer

    def _read_filter(self, filters: Any) -> Rules:
        """The filter of a caller."""
        try:
            with self._filtering:  # to compile a pattern takes time as well
                return read_rules(filters)
        except InvalidPattern as problem:
            raise RefusedCall(f"the filter is not usable: {problem}") from None

    def _md5sums(self, caller: str, types: Any) -> List[List[str]]:
        """The md5 sums of message types, of topics of own nodes that the caller may see."""
        if not isinstance(types, list):
            raise RefusedCall("getTopicsMd5sum takes a list of types")
        known = local_types(*self._view(caller))
        sums = ((name, self._md5sum(name)) for name in types if isinstance(name, str) and name in known)
        return [[name, md5sum] for name, md5sum in sums if md5sum]

    def _view(self, caller: str) -> Tuple[State, List[Rules]]:
        """The part of the state that a caller may see, and the rules for it."""
        return self._viewer(caller)(self._own.current())

    def _viewer(self, caller: str) -> Viewer:
        """Makes of a state the part that a caller may see, and the rules for it."""
        if self._is_here(caller):
            return lambda state: self._policy.view(state, None)
        try:
            secret = Rules(do_not_sync=secret_names(self._do_not_sync()))
        except InvalidPattern as problem:  # the secret topics are not known, so nothing is answered
            raise RefusedCall(str(problem)) from None
        return lambda state: self._policy.view(state, caller, [secret])


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return str(os.getuid())
