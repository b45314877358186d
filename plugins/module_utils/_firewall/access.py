# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The ways by which the controller and other people come in, that a packet filter must not close.

Ports of ssh are not touched: those on which an ssh server of root listens, and that of this connection. Where the
connection comes by another program, on a port that the filter closes, the module refuses.
"""

import ipaddress
import os
import re
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._firewall.wanted import FIRST, Wanted
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import ports, systemd
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.plain_text import quote
from ansible_collections.rosfleet.multimaster.plugins.module_utils._process.commands import text

_SERVERS = ("sshd", "sshd-session", "dropbear")  # processes that serve ssh
_SOCKETS = ("ssh.socket", "sshd.socket")  # units of systemd that listen for one
_ESTABLISHED, _LISTEN = "01", "0A"  # include/net/tcp_states.h
_SOCKET = re.compile(r"socket:\[([0-9]+)\]")
_NUMBER = re.compile(r"[0-9]{1,5}\Z")
_ANCESTORS = 64  # at most


class Connection(typing.NamedTuple):
    """A TCP connection of this computer."""

    port: int  # here
    peer: str  # the address of the other end
    inode: str


class Way(typing.NamedTuple):
    """A connection by which somebody came in to start this process."""

    connection: Connection
    program: str  # that serves it

    @property
    def is_ssh(self) -> bool:
        """True where an ssh server serves it."""
        return self.program in _SERVERS


class Access(typing.NamedTuple):
    """What a packet filter must not close."""

    ssh: typing.List[int]  # ports
    ways: typing.List[Way]

    def refusal(self, wanted: Wanted) -> str:
        """The sentence where the filter would cut the controller off, else an empty text; pure."""
        let_in = [ipaddress.ip_network(member) for member in wanted.members]
        stay_open = wanted.open("tcp")
        for way in self.ways:
            peer = ipaddress.ip_address(way.connection.peer)
            closed = way.connection.port >= FIRST and way.connection.port not in stay_open
            if closed and not peer.is_loopback and not any(peer in network for network in let_in):
                return (
                    f"The controller at {peer} reaches this computer on TCP port {way.connection.port} of {quote(way.program)}, which is no "
                    "ssh server, and the packet filter would cut it off; expected ssh, or an address that is let in: add it to "
                    "multimaster_allow, or reach the computer by ssh."
                )
        return ""


def look(proc: str = "/proc") -> Access:
    """Look at this computer."""
    rows = [row for table in ("tcp", "tcp6") for row in _rows(text(f"{proc}/net/{table}", 1 << 24))]
    listening = {int(row[1].rpartition(":")[2], 16) for row in rows if row[3] == _LISTEN}
    connections = [_connection(row) for row in rows if row[3] == _ESTABLISHED]
    ways = _ways([found for found in connections if found.port in listening], proc)
    ssh = _listeners({port for port in listening if port >= FIRST}, proc)
    ssh |= {way.connection.port for way in ways if way.is_ssh} | _by_systemd()
    ssh |= _told(connections) & _of_root(rows)
    return Access(sorted(port for port in ssh if port >= FIRST), ways)


def _rows(table: str) -> typing.List[typing.List[str]]:
    rows = [line.split() for line in table.splitlines()[1:]]
    return [row for row in rows if len(row) >= 10]


def _connection(row: typing.Sequence[str]) -> Connection:
    peer = ports.address_of(row[2].rpartition(":")[0])
    return Connection(int(row[1].rpartition(":")[2], 16), peer[7:] if peer.startswith("::ffff:") else peer, row[9])


def _ways(connections: typing.Iterable[Connection], proc: str) -> typing.List[Way]:
    """The connections that this process's ancestors serve."""
    by_inode = {connection.inode: connection for connection in connections}
    found = []
    for pid, name in _ancestors(proc):
        for inode in _inodes(f"{proc}/{pid}/fd"):
            if inode in by_inode:
                found.append(Way(by_inode.pop(inode), name))
    return found


def _ancestors(proc: str) -> typing.Iterator[typing.Tuple[int, str]]:
    """This process's ancestors, without the first process: their numbers and names."""
    pid = os.getppid()
    for _generation in range(_ANCESTORS):
        # proc(5): pid (name) state parent ...; a name may hold blanks and brackets
        found = re.match(r"\d+ \((.*)\) \S (\d+) ", text(f"{proc}/{pid}/stat"), re.S)
        if found is None or pid <= 1:
            return
        yield pid, found.group(1)
        pid = int(found.group(2))


def _inodes(folder: str) -> typing.List[str]:
    """The sockets that a process has open."""
    found = []
    try:
        for name in os.listdir(folder):
            socket = _SOCKET.match(os.readlink(os.path.join(folder, name)))
            found += [socket.group(1)] if socket else []
    except OSError:  # it has ended, or root in a container may not look
        return found
    return found


def _listeners(candidates: typing.Set[int], proc: str) -> typing.Set[int]:
    """The ports of these on which an ssh server of root listens: anybody may call a program sshd."""
    wanted = [{"protocol": "tcp", "port": port} for port in candidates]
    return {
        holder["port"]
        for holder in (ports.holders(wanted, proc) if wanted else [])
        if holder["user"] == "root" and holder["pid"] and _name(holder["pid"], proc) in _SERVERS
    }


def _name(pid: int, proc: str) -> str:
    return text(f"{proc}/{pid}/comm").strip()


def _of_root(rows: typing.Iterable[typing.Sequence[str]]) -> typing.Set[int]:
    """The ports on which root alone listens."""
    listeners = [(int(row[1].rpartition(":")[2], 16), row[7]) for row in rows if row[3] == _LISTEN]
    return {port for port, _user in listeners} - {port for port, user in listeners if user != "0"}


def _told(connections: typing.Iterable[Connection]) -> typing.Set[int]:
    """The port that the ssh server names in the environment, if one of these connections is the named one.

    Anybody may write a variable, and an ssh server behind a pipe, as of a ProxyCommand, writes "UNKNOWN 65535 UNKNOWN 65535".
    """
    words = os.environ.get("SSH_CONNECTION", "").split()
    if len(words) != 4 or not all(map(_NUMBER.match, words[1::2])):
        return set()
    try:
        peer, _here = (ipaddress.ip_address(word.partition("%")[0]) for word in words[::2])
    except ValueError:
        return set()
    port = int(words[3])
    return {found.port for found in connections if found.port == port and ipaddress.ip_address(found.peer) == peer}


def _by_systemd() -> typing.Set[int]:
    """The ports on which systemd itself listens for ssh."""
    found = set()
    for unit in systemd.show(_SOCKETS, ["ActiveState", "Listen"]).units:
        if unit.get("ActiveState") == "active":
            found |= {int(port) for port in re.findall(r":([0-9]+) \(Stream\)", unit.get("Listen", ""))}
    return found
