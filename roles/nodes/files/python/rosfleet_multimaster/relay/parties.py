# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The parties of a relay: this robot and its computers, the robots that a channel leads to, and everybody else."""

from typing import Any, Callable, Container, Dict, Iterable, List, Mapping, Set

from ..edge.addresses import local_hosts
from ..edge.clock import keep_fresh
from ..protocol.members import Members
from ..protocol.tcpros.hosts import is_address
from .core.channels import Channel

NAME = "/master_relay"  # of the node
# Fields of a header between two relays: whose it is, and the node whose messages it wants.
ROBOT, NODE = "rosfleet_relay", "rosfleet_publisher"
NOBODY, OTHERS = "", "computers of no robot"  # who has an address that belongs to no robot, and how it is called


class OwnHosts:
    """The hosts of this robot: names and addresses of its planned computers, and this computer. `in` is asked in threads, too."""

    def __init__(self, planned: Container[str], foreign: Container[str], local: Callable[[], Container[str]]) -> None:
        """`foreign`: hosts of other robots; `local`: those of this computer."""
        self._planned, self.foreign, self._local = planned, foreign, local

    @classmethod
    def from_members(cls, members: Members, robot: str, local: Callable[[], Container[str]]) -> "OwnHosts":
        """Make the hosts of a robot."""
        planned = frozenset(host for one in members.robots if one.robot == robot for host in one.hosts)
        return cls(planned, members.hosts - planned, local)

    def __contains__(self, host: object) -> bool:
        """True for a host in its only spelling (protocol/members.py)."""
        text = str(host)
        is_here = (text.startswith("127.") and is_address(text)) or text in self._local()
        return text in self._planned or (is_here and text not in self.foreign)


class Parties:
    """The robots of a relay, and whose an address is. Asked in threads, too; nothing here changes but the own addresses."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        """`values`: the parameters of the node, which have been checked."""
        self.robot = str(values["robot"])
        self.members = Members.from_parameters(values)
        self.channels = [Channel.from_entry(entry) for entry in values["channels"]]
        self.peers = {channel.peer: channel for channel in self.channels}
        self._local_hosts = keep_fresh(local_hosts)  # each connection asks for them
        self.hosts = OwnHosts.from_members(self.members, self.robot, self._local_hosts)
        self._robots = _map_hosts(self.channels, self.members)
        self.all: Set[str] = {self.robot, NOBODY, *self.peers, *self._robots.values()}

    def is_here(self, address: str) -> bool:
        """True for an address of this computer."""
        return address in self._local_hosts()

    def find_robot(self, address: str) -> str:
        """Return the robot that a computer is of; empty for a computer of no robot."""
        return self.robot if self.is_here(address) else self._robots.get(address, NOBODY)

    def is_peer(self, robot: Any, address: str) -> bool:
        """True if the relay of a robot asks, by one of its addresses."""
        return isinstance(robot, str) and robot in self.peers and address in self.peers[robot].hosts

    def list_channels(self, robot: str) -> List[Channel]:
        """List the channels to a robot."""
        return [channel for channel in self.channels if channel.peer == robot]

    def list_channels_of(self, robot: str, address: str) -> List[Channel]:
        """The same, if it is its relay that asks."""
        return self.list_channels(robot) if self.is_peer(robot, address) else []


def _map_hosts(channels: Iterable[Channel], members: Members) -> Dict[str, str]:
    """Return the robot of each host."""
    robots = {host: channel.peer for channel in channels for host in channel.hosts}
    return {**robots, **{host: one.robot for one in members.robots for host in one.hosts}}
