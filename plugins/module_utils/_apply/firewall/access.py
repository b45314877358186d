# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The access that a packet filter must not close: that of the controller, and that of people by ssh.

Ports of ssh are not touched: those on which an ssh server of root listens, and the port of this connection. The module refuses
if the connection comes by a program other than ssh, on a port that the filter closes.
"""

import contextlib
import ipaddress
import os
import re
import typing

from ..._base.commands import text
from ..._base.plain_text import quote
from ..._base.processes import SSH_SERVERS, ancestors
from ..._machine import ports, systemd
from .packet_filter import FIRST, PacketFilter

_SOCKETS = ("ssh.socket", "sshd.socket")  # units of systemd that listen for one
_NUMBER = re.compile(r"[0-9]{1,5}\Z")


class Session(typing.NamedTuple):
    """A connection from outside through which this process was started."""

    port: int  # here
    peer: str  # the address of the other end
    program: str  # the process that serves it


class Access(typing.NamedTuple):
    """The ports and connections that a packet filter must not close."""

    ssh: typing.List[int]  # ports
    sessions: typing.List[Session]

    def refusal(self, packet_filter: PacketFilter) -> str:
        """The sentence if the filter would cut the controller off, else an empty text; pure."""
        members = [ipaddress.ip_network(member) for member in packet_filter.members]
        open_ports = packet_filter.list_open_ports("tcp")
        for session in self.sessions:
            peer = ipaddress.ip_address(session.peer)
            closed = session.port >= FIRST and session.port not in open_ports
            if closed and not peer.is_loopback and not any(peer in network for network in members):
                return (
                    f"The controller at {peer} reaches this computer on TCP port {session.port} of {quote(session.program)}, which is no "
                    "ssh server, and the packet filter would cut it off; expected ssh, or an address that is let in: add it to "
                    "multimaster_allow, or reach the computer by ssh."
                )
        return ""


def _read_sockets(proc: str) -> typing.List[ports.Socket]:
    """Read the TCP sockets of this computer; an IPv4 peer of an IPv6 socket has its own form."""
    sockets = ports.read_sockets("tcp", proc)
    return [entry._replace(peer=re.sub("^::ffff:", "", entry.peer)) for entry in sockets]


def read_access(proc: str = "/proc") -> Access:
    """Read the connections and ssh servers of this computer."""
    sockets = _read_sockets(proc)
    listeners = [entry for entry in sockets if entry.state == ports.LISTEN]
    listening = {entry.port for entry in listeners}
    connections = [entry for entry in sockets if entry.state == ports.ESTABLISHED]
    sessions = _find_sessions(connections, listening, proc)
    ssh = _find_ssh_servers({port for port in listening if port >= FIRST}, proc)
    ssh |= {session.port for session in sessions if session.program in SSH_SERVERS} | _find_systemd_ports()
    # The port in SSH_CONNECTION counts if only root listens there.
    ssh |= _read_ssh_connection(connections) & (listening - {entry.port for entry in listeners if entry.uid != 0})
    return Access(sorted(port for port in ssh if port >= FIRST), sessions)


def _find_sessions(
    connections: typing.Iterable[ports.Socket], listening: typing.Container[int], proc: str
) -> typing.List[Session]:
    """The connections that this process's ancestors serve, of those to ports at which a program listens."""
    by_inode = {connection.inode: connection for connection in connections if connection.port in listening}
    sessions: typing.List[Session] = []
    for pid, name, _start in ancestors(proc):
        if pid <= 1:  # the first process (init) belongs to no login
            break
        with contextlib.suppress(OSError):  # the process has ended, or root in a container may not look
            served = [by_inode.pop(inode) for inode in ports.list_inodes(pid, proc) if inode in by_inode]
            sessions += [Session(connection.port, connection.peer, name) for connection in served]
    return sessions


def _find_ssh_servers(candidates: typing.Set[int], proc: str) -> typing.Set[int]:
    """The candidates on which an ssh server of root listens. Other users do not count: every user may call a program sshd."""
    queries = [{"protocol": "tcp", "port": port} for port in candidates]
    return {
        holder["port"]
        for holder in (ports.holders(queries, proc) if queries else [])
        if holder["user"] == "root" and holder["pid"] and text(f"{proc}/{holder['pid']}/comm").strip() in SSH_SERVERS
    }


def _read_ssh_connection(connections: typing.Iterable[ports.Socket]) -> typing.Set[int]:
    """The port of SSH_CONNECTION, if one of these connections has this port and this peer; else an empty set.

    Every user may write the variable. An ssh server behind a pipe, as of a ProxyCommand, writes "UNKNOWN 65535 UNKNOWN 65535".
    """
    words = os.environ.get("SSH_CONNECTION", "").split()
    if len(words) != 4 or not all(map(_NUMBER.match, words[1::2])):
        return set()
    try:
        peer, _here = (ipaddress.ip_address(word.partition("%")[0]) for word in words[::2])
    except ValueError:
        return set()
    port = int(words[3])
    return {other.port for other in connections if other.port == port and ipaddress.ip_address(other.peer) == peer}


def _find_systemd_ports() -> typing.Set[int]:
    """The ports on which systemd itself listens for ssh."""
    return {
        int(port)
        for unit in systemd.show(_SOCKETS, ["ActiveState", "Listen"]).units
        if unit.get("ActiveState") == "active"
        for port in re.findall(r":([0-9]+) \(Stream\)", unit.get("Listen", ""))
    }
