# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Senders that are not exchanged with: asked for their names, reported once, and else ignored.

A datagram can name any sender, so an address may belong to a computer that has nothing to do with it. It is
asked over TCP twice at most, whatever is heard from there.
"""

from dataclasses import dataclass
from typing import Dict, Iterator, List, NamedTuple, Optional, Tuple

from ...protocol.plain_text import quote
from .actions import ActionOutbox
from .peer import FAR, LONG_AGO, Contact, Key

TRIES = 2  # connections to an address whose master is not known yet,
AGAIN = 30.0  # and seconds until there are two more, if it may be an allowed one that is still heard
PAUSE = 5.0  # seconds between two questions to an outsider
FORGET = 600.0  # seconds of silence
MAX_OUTSIDERS, MAX_ASKED = 256, 4  # that are remembered; that are asked at the same time
MAX_TRIED = 16384  # addresses; more are not asked


class ConnectionBudget:
    """Connections to addresses whose master is not known yet."""

    def __init__(self) -> None:
        self._spent: Dict[str, Tuple[int, float]] = {}  # address -> how many, and when the last one was

    def free(self, address: str, now: float) -> float:
        """The time from which a connection may be made."""
        count, last = self._spent.get(address, (0, LONG_AGO))
        return now if count < TRIES else max(now, last + AGAIN)

    def spend(self, address: str, now: float) -> None:
        """Note a connection."""
        count, last = self._spent.pop(address, (0, LONG_AGO))
        self._spent[address] = (1 if now - last >= AGAIN else count + 1), now
        while len(self._spent) > MAX_TRIED or now - next(iter(self._spent.values()))[1] > AGAIN:
            del self._spent[next(iter(self._spent))]

    def refund(self, address: str) -> None:
        """Give back the tries that were spent: this address has answered."""
        self._spent.pop(address, None)


class Outsider(NamedTuple):
    """A sender that is ignored, as people see it."""

    address: str
    name: str  # "" if the address told no name
    uri: str
    why: str

    def __str__(self) -> str:
        who = (
            f"{quote(self.name)} ({quote(self.uri)}) at {self.address}"
            if self.uri
            else f"the sender of heartbeats at {self.address}"
        )
        return f"{who} is ignored: {self.why}; add it to the inventory, or its address to multimaster_allow"


@dataclass
class _Outsider:
    rpc_port: int
    heard: float
    due: float  # when it is asked who it is; not while it is being asked
    asking: bool = False
    notice: Optional[Outsider] = None


class Outsiders:
    """The senders that are ignored, by their addresses."""

    def __init__(self, outbox: ActionOutbox) -> None:
        self._outbox = outbox
        self._table: Dict[str, _Outsider] = {}  # in the order in which they were last heard
        self._tries: Dict[str, Tuple[int, float]] = {}  # address -> how many, and when the last one was
        self._asking = 0

    def hear(self, address: str, rpc_port: int, now: float, may_ask: bool) -> None:
        """Take a datagram of an outsider. `may_ask`: its address is one that this computer may connect to."""
        entry = self._note(address, rpc_port, now, now if may_ask and self._has_tries(address) else FAR)
        if entry.due == FAR and entry.notice is None and not entry.asking:
            self._report(entry, Outsider(address, "", "", "it is no robot of the fleet"))

    def due(self, now: float) -> Iterator[Key]:
        """The outsiders to ask now who they are."""
        for address, entry in self._table.items():
            if self._asking >= MAX_ASKED:
                return
            if entry.due <= now and self._has_tries(address):
                entry.asking, entry.due = True, FAR
                self._asking += 1
                self._tries[address] = self._tries.pop(address, (0, now))[0] + 1, now
                yield address, 0, entry.rpc_port

    def next_due(self) -> float:
        """The time of the next question."""
        if self._asking >= MAX_ASKED:
            return FAR
        return min((entry.due for entry in self._table.values()), default=FAR)

    def take_answer(self, key: Key, contact: Optional[Contact], why: str, now: float) -> None:
        """Take the end of a question: the master that answers and the reason to ignore it, or None."""
        entry = self._table.get(key[0])
        if entry is None or not entry.asking:
            return
        entry.asking = False
        self._asking -= 1
        if contact is not None:
            self._report(entry, Outsider(key[0], contact.name, contact.uri, why))
        elif self._has_tries(key[0]):
            entry.due = now + PAUSE
        else:
            self._report(entry, Outsider(key[0], "", "", "it does not say who it is"))

    def refuse(self, key: Key, contact: Contact, why: str, now: float) -> None:
        """Note one that was asked otherwise, and is not who it should be."""
        self._report(self._note(key[0], key[2], now, FAR), Outsider(key[0], contact.name, contact.uri, why))

    def forget(self, now: float) -> None:
        """Forget those that have been silent for long."""
        for address, entry in list(self._table.items()):
            if now - entry.heard <= FORGET:
                break
            if not entry.asking:
                del self._table[address]
        while self._tries and now - next(iter(self._tries.values()))[1] > FORGET:
            del self._tries[next(iter(self._tries))]

    def list_ignored(self) -> List[Outsider]:
        """The outsiders that people are shown."""
        return [entry.notice for entry in self._table.values() if entry.notice is not None]

    def _has_tries(self, address: str) -> bool:
        if address not in self._tries and len(self._tries) >= MAX_TRIED:
            return False
        return self._tries.get(address, (0, 0.0))[0] < TRIES

    def _note(self, address: str, rpc_port: int, now: float, due: float) -> _Outsider:
        """Note that one was heard. If there are too many, the longest silent one is forgotten; its tries stay spent."""
        entry = self._table.pop(address, None) or _Outsider(rpc_port, now, due)
        while len(self._table) >= MAX_OUTSIDERS:
            del self._table[next(first for first, other in self._table.items() if not other.asking)]
        self._table[address], entry.heard = entry, now
        return entry

    def _report(self, entry: _Outsider, outsider: Outsider) -> None:
        """Log an ignored sender, once."""
        if entry.notice != outsider:
            entry.notice = outsider
            self._outbox.say("warning", f"outsider {outsider.address}", str(outsider))
