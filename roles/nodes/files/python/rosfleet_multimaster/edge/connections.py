# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The TCP connections of this computer, whichever process has them: seen, and ended (Linux's sock_diag by netlink).

Any process may see them. Ended means SOCK_DESTROY: the process gets ECONNABORTED, and the other side a reset. It needs CAP_NET_ADMIN and a kernel
with CONFIG_INET_DIAG_DESTROY. IPv4 only, as ROS 1 is by default.
"""

import contextlib
import errno
import socket
import struct
from typing import Callable, FrozenSet, List, NamedTuple, Tuple

from ..protocol.members import LOWEST
from .addresses import ACKNOWLEDGE, ALL, REQUEST, addresses, ask_kernel, attributes

_NETLINK_SOCK_DIAG, _SOCK_DIAG_BY_FAMILY, _SOCK_DESTROY = 4, 20, 21
_LISTEN, _TIME_WAIT, _STATES = 10, 6, 12  # states of TCP, numbered from 1
_INFO = 2  # the attribute with struct tcp_info; asked for by bit 1
_INFO_LAST_DATA_RECEIVED = 52  # bytes into it: milliseconds since data came, and then since an acknowledgement came
_MESSAGE = struct.Struct("=BBBB48s20x")  # struct inet_diag_msg
_OWNER = 64  # bytes into it: the user


class Tcp(NamedTuple):
    """A TCP connection."""

    local: Tuple[str, int]
    remote: Tuple[str, int]
    silent: float  # seconds since anything came from the other side
    identity: bytes  # struct inet_diag_sockid


def connections() -> List[Tcp]:
    """The connections of this network namespace, half open ones too. Raises OSError."""
    states = ((1 << _STATES) - 1) & ~(1 | 1 << _LISTEN | 1 << _TIME_WAIT)
    body = struct.pack("=BBBBI48x", socket.AF_INET, socket.IPPROTO_TCP, 1 << (_INFO - 1), 0, states)
    return [_tcp(message) for message in ask_kernel(_NETLINK_SOCK_DIAG, _SOCK_DIAG_BY_FAMILY, REQUEST | ALL, body)]


def owner(local: Tuple[str, int], remote: Tuple[str, int]) -> int:
    """The user (its number) whose process has this end of a connection. Raises OSError if it is not of this computer."""
    family = socket.AF_INET6 if ":" in local[0] else socket.AF_INET
    ends = [socket.inet_pton(family, address).ljust(16, b"\0") for address, _port in (local, remote)]
    identity = struct.pack(">HH16s16s", local[1], remote[1], *ends) + struct.pack("=III", 0, 0xFFFFFFFF, 0xFFFFFFFF)
    body = struct.pack("=BBBBI48s", family, socket.IPPROTO_TCP, 0, 0, 0xFFFFFFFF, identity)
    for message in ask_kernel(_NETLINK_SOCK_DIAG, _SOCK_DIAG_BY_FAMILY, REQUEST, body):
        return int(struct.unpack_from("=I", message, _OWNER)[0])
    raise OSError(errno.ENOENT, "there is no such connection")


def end(connection: Tcp) -> bool:
    """End a connection; False if it has ended already. Raises OSError, PermissionError without CAP_NET_ADMIN."""
    body = struct.pack("=BBBBI48s", socket.AF_INET, socket.IPPROTO_TCP, 0, 0, 0xFFFFFFFF, connection.identity)
    try:
        list(ask_kernel(_NETLINK_SOCK_DIAG, _SOCK_DESTROY, REQUEST | ACKNOWLEDGE, body))
    except FileNotFoundError:
        return False
    return True


def end_all(wanted: Callable[[Tcp], bool]) -> List[Tcp]:
    """End the connections between nodes that `wanted` names, and return them. Raises OSError if it could end no connection."""
    ended, problem = [], None
    for connection in connections():
        if min(connection.local[1], connection.remote[1]) >= LOWEST and wanted(connection):
            try:
                ended += [connection] if end(connection) else []
            except OSError as refusal:  # the other connections are ended as before
                problem = refusal
    if problem is not None and not ended:
        raise problem
    return ended


def check() -> None:
    """Raise OSError if connections cannot be ended here. It is tried with an own one."""
    with contextlib.ExitStack() as opened:
        server = opened.enter_context(socket.socket())
        server.bind(("127.0.0.1", 0))
        server.listen(1)
        client = opened.enter_context(socket.socket())
        client.settimeout(1.0)
        client.connect(server.getsockname())
        port = client.getsockname()[1]
        if not end_all(lambda connection: connection.local[1] == port and connection.remote == server.getsockname()):
            raise OSError(errno.ENOENT, "the kernel does not list its connections")


def addresses_of(host: str) -> FrozenSet[str]:
    """The IPv4 addresses of another computer. Raises OSError; none of this computer's own is among them."""
    found = frozenset(socket.gethostbyname_ex(host)[2]) - {address for address, _index in addresses()}
    return frozenset(address for address in found if not address.startswith("127."))


def _tcp(message: bytes) -> Tcp:
    _family, _state, _timer, _retransmits, identity = _MESSAGE.unpack_from(message)
    sport, dport, source, destination = struct.unpack_from(">HH4s12x4s", identity)
    info = attributes(message, _MESSAGE.size).get(_INFO, b"")
    times = (
        struct.unpack_from("=II", info, _INFO_LAST_DATA_RECEIVED) if len(info) >= _INFO_LAST_DATA_RECEIVED + 8 else (0,)
    )
    silent = min(times) / 1000.0
    return Tcp((socket.inet_ntoa(source), sport), (socket.inet_ntoa(destination), dport), silent, identity)
