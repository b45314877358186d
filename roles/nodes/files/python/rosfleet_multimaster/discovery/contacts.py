# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Questions to other discovery nodes: who they are, and whether their host's name leads to them."""

import xmlrpc.client
from typing import Callable, Dict, Optional, Set, Tuple

from ..edge.addresses import address_of
from ..edge.loop import Loop, Workers
from ..edge.process import program
from ..edge.rpc_client import Rpc
from .core.actions import CONTACT_LIMIT, Ask
from .core.peer import Contact, Key, find_name_problem
from .core.strangers import MAX_ASKED

# key, contact or None, why not, it says that it has none, a fault says so; true where it is a master that is listed
Answered = Callable[[Key, Optional[Contact], str, bool, bool], bool]


class Contacts:
    """Asks others by masterContacts, and compares the names of their hosts with where they are."""

    def __init__(
        self,
        loop: Loop,
        resolvers: Workers,
        limited: program.LimitedLog,
        errors: Dict[str, str],
        known: Callable[[str], bool],
        may_ask: Callable[[str], bool],
        answered: Answered,
    ) -> None:
        """`known(uri)`: a master that others are told of. `errors` takes what is wrong with the names of these.

        `may_ask(address)`: a connection to an address that somebody else names is allowed; called in threads.
        """
        self._masters = Workers(loop, 16)  # masters that may have gone: nothing else must keep them waiting
        self._strangers = Workers(loop, MAX_ASKED)
        self._resolvers, self._limited, self._errors = resolvers, limited, errors
        self._known, self._may_ask, self._answered = known, may_ask, answered
        self._comparing: Set[str] = set()

    def ask(self, action: Ask) -> None:
        """Carry out an Ask of the core."""
        (self._strangers if action.stranger else self._masters).submit(
            lambda: _contact(action.monitor_uri, action.limit),
            lambda contact, problem: self._contacted(action.key, contact, problem),
        )

    def _contacted(self, key: Key, contact: Optional[Contact], problem: Optional[Exception]) -> None:
        fault = isinstance(problem, xmlrpc.client.Fault)
        gone = fault or isinstance(problem, ConnectionRefusedError)
        listed = self._answered(key, contact, str(problem or ""), gone, fault)
        if listed and contact is not None and contact.host not in self._comparing:
            self._comparing.add(contact.host)
            heard, _port, rpc_port = key
            self._resolvers.submit(
                lambda: _who_has(contact.host, heard, rpc_port, self._may_ask),
                lambda found, _problem: self._compare(contact, heard, *(found or ("", None))),
            )

    def _compare(self, contact: Contact, heard: str, address: str, there: Optional[Contact]) -> None:
        """Nodes of a master whose host is not where its name leads cannot be reached either."""
        self._comparing.discard(contact.host)
        problem = find_name_problem(contact, heard, address, there)
        if problem and self._known(contact.uri):  # else it would stay for ever: nobody reports that a stranger has gone
            self._errors[contact.uri] = problem
            self._limited.say("warning", f"resolve {contact.host}", problem)
        else:
            self._errors.pop(contact.uri, None)


def _who_has(host: str, heard: str, rpc_port: int, may_ask: Callable[[str], bool]) -> Tuple[str, Optional[Contact]]:
    """The address of a name, and which master answers there where that is another than the one that is heard."""
    address = address_of(host)
    try:
        return address, None if address == heard or not may_ask(address) else _contact(f"http://{address}:{rpc_port}")
    except program.FAILURES:
        return address, None


def _contact(monitor_uri: str, limit: float = CONTACT_LIMIT) -> Contact:
    return Contact.from_answer(Rpc(monitor_uri, limit).call("masterContacts"))
