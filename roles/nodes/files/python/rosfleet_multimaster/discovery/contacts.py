# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Questions to other discovery nodes: their contacts, and whether the name of their host leads to them."""

import xmlrpc.client
from contextlib import closing
from functools import partial
from typing import Callable, Dict, Optional, Set, Tuple

from ..edge.addresses import NO_ADDRESS, address_of
from ..edge.clock import monotonic, wall_clock
from ..edge.loop import Loop, Workers
from ..edge.process import program
from ..edge.rpc_client import Rpc
from ..protocol.messages import AnnouncedMaster
from .core.actions import CONTACT_LIMIT, Ask
from .core.health import LIMIT, ClockAnswer, Health, read_answer
from .core.newcomers import MAX_ASKED
from .core.peer import Contact, Key, find_name_problem

# (key, contact or None, problem, the master has gone, a fault says so) -> True for a master of the list
OnAnswer = Callable[[Key, Optional[Contact], str, bool, bool], bool]


class Contacts:
    """Asks others by masterContacts, and compares the names of their hosts with their addresses."""

    def __init__(
        self,
        loop: Loop,
        resolvers: Workers,
        limited: program.LimitedLog,
        errors: Dict[str, str],
        is_known: Callable[[str], bool],
        may_ask: Callable[[str], bool],
        on_answer: OnAnswer,
    ) -> None:
        """`is_known(uri)`: true for a master of the list. `errors` takes the problems of the names of these.

        `may_ask(address)`: a connection to an address that another computer names is allowed; called in threads.
        """
        self._masters = Workers(loop, 16)  # for masters that may have gone: these questions wait for no others
        self._newcomers = Workers(loop, MAX_ASKED)
        self._resolvers, self._limited, self._errors = resolvers, limited, errors
        self._is_known, self._may_ask, self._on_answer = is_known, may_ask, on_answer
        self._comparing: Set[str] = set()

    def ask(self, action: Ask) -> None:
        """Carry out an Ask of the core."""
        (self._newcomers if action.newcomer else self._masters).submit(
            lambda: _ask_contact(action.monitor_uri, action.limit),
            lambda contact, problem: self._on_contact(action.key, contact, problem),
        )

    def _on_contact(self, key: Key, contact: Optional[Contact], problem: Optional[Exception]) -> None:
        fault = isinstance(problem, xmlrpc.client.Fault)
        gone = fault or isinstance(problem, ConnectionRefusedError)
        is_master = self._on_answer(key, contact, str(problem or ""), gone, fault)
        if is_master and contact is not None and contact.host not in self._comparing:
            self._comparing.add(contact.host)
            heard, _port, rpc_port = key
            self._resolvers.submit(
                lambda: _find_host(contact.host, heard, rpc_port, self._may_ask),
                partial(self._on_host, contact, heard),
            )

    def _on_host(
        self, contact: Contact, heard: str, host: Optional[Tuple[str, Optional[Contact]]], problem: Optional[Exception]
    ) -> None:
        self._comparing.discard(contact.host)
        if host is not None or isinstance(problem, NO_ADDRESS):  # else it was not asked: there were too many questions
            self._compare(contact, heard, *(host or ("", None)))

    def _compare(self, contact: Contact, heard: str, address: str, there: Optional[Contact]) -> None:
        """Note a host name that leads elsewhere: the nodes of that master cannot be reached by it either."""
        problem = find_name_problem(contact, heard, address, there)
        if problem and self._is_known(contact.uri):  # no event would remove the error of a newcomer
            self._errors[contact.uri] = problem
            self._limited.say("warning", f"resolve {contact.host}", problem)
        else:
            self._errors.pop(contact.uri, None)


def _find_host(host: str, heard: str, rpc_port: int, may_ask: Callable[[str], bool]) -> Tuple[str, Optional[Contact]]:
    """The address of a name, and the master that answers there, if it is not the address that is heard."""
    address = address_of(host)
    try:
        return address, None if address == heard or not may_ask(address) else _ask_contact(
            f"http://{address}:{rpc_port}"
        )
    except program.FAILURES:
        return address, None


def _ask_contact(monitor_uri: str, limit: float = CONTACT_LIMIT) -> Contact:
    return Contact.from_answer(Rpc(monitor_uri, limit).call("masterContacts"))


def ask_time(master: AnnouncedMaster, workers: Workers, health: Health) -> None:
    """Ask a master for its time in a worker, and hand the answer to `health`: the round trip, and the offset of its clock."""

    def ask() -> ClockAnswer:
        began, wall = monotonic(), wall_clock()
        with closing(Rpc(master.monitor_uri, LIMIT)) as rpc:
            return read_answer(rpc.call("getCurrentTime"), wall, monotonic() - began)

    workers.submit(ask, lambda answer, _problem: health.take_answer(master.uri, answer))
