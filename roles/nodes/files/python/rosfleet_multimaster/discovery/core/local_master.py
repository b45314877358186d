# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""This computer and its own master: its announced state, and the addresses that it may connect to."""

from collections import deque
from typing import Container, Deque, FrozenSet, Iterable, Optional

from ...protocol.heartbeat import Heartbeat, Kind, Stamp, encode
from ...protocol.members import Members
from ...protocol.messages import AnnouncedMaster
from ...protocol.parameters import Settings


class LocalMaster:
    """This computer, and the state of its own master."""

    def __init__(self, settings: Settings, addresses: Iterable[str], rpc_port: int, members: Members) -> None:
        self.settings = settings
        self.addresses: FrozenSet[str] = frozenset(addresses)
        self.networks: Optional[Container[str]] = None  # of this computer; None if they do not matter
        self.rpc_port = rpc_port
        self.master: Optional[AnnouncedMaster] = None
        self.since = 0.0  # when its first state came
        self.beats: Deque[float] = deque(maxlen=512)  # when its own heartbeats were heard
        self._members = members

    @property
    def uri(self) -> Optional[str]:
        """The URI of the own master, None as long as it is not known."""
        return self.master.uri if self.master else None

    @property
    def online(self) -> bool:
        """True if the own master has a state to announce."""
        return self.master is not None and self.master.online

    def take(self, master: AnnouncedMaster, now: float) -> Optional[AnnouncedMaster]:
        """Take the state of the own master. The one before."""
        before, self.master = self.master, master
        if before is None:
            self.since = now
        return before

    def lose(self) -> None:
        """Note that the own roscore does not answer."""
        if self.master is not None:
            self.master = self.master._replace(online=False)

    def is_own(self, address: str) -> bool:
        """True for an address of this computer."""
        return address in self.addresses or address.startswith("127.")

    def is_this_node(self, address: str, rpc_port: int) -> bool:
        """True for a heartbeat of this node itself."""
        return rpc_port == self.rpc_port and self.is_own(address)

    def may_ask(self, address: str) -> bool:
        """True if a connection to an address may be made that another computer names: never to this computer itself.

        Also called in other threads.
        """
        if address.startswith("127.") or address == "0.0.0.0":
            return False
        if self.networks is None:
            return True
        own = self._members.master(self.uri or "")
        if address in self.addresses or (own is not None and address in own.addresses):
            return False  # also a planned address that no interface has yet
        if self._members.member_at(address) is not None or address in self._members.allow:
            return True
        return address in self.networks or address in self.settings.robot_hosts

    def admits(self, address: str) -> bool:
        """True if the sender may be an allowed stranger."""
        return self._members.admits(address) and self.may_ask(address)

    def record(self, kind: Kind) -> bytes:
        """A datagram about the own master."""
        if kind is not Kind.STATE or self.master is None:
            return encode(Heartbeat(kind, self.rpc_port))
        stamp, local = Stamp.from_seconds(self.master.stamp), Stamp.from_seconds(self.master.local_stamp)
        return encode(Heartbeat(kind, self.rpc_port, self.settings.heartbeat_hz, stamp, local))
