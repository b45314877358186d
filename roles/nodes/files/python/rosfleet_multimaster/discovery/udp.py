# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The UDP sockets of discovery."""

import socket
import struct
from typing import List, NamedTuple, Optional, Tuple

from ..edge.addresses import addresses

_IP_PKTINFO = 8
_TTL = 20

Socket = socket.socket


class Datagram(NamedTuple):
    """A received datagram."""

    data: bytes
    source: Tuple[str, int]
    multicast: bool


class Udp:
    """The sockets of discovery. They send from the port of the protocol, and receive at it."""

    def __init__(self, group: str, port: int, interface: str, multicast: bool) -> None:
        """`interface`: the address of the only interface to use, "" for the kernel's choice. Raises OSError."""
        self.group, self.port, self.interface = group, port, interface
        self.sockets: List[socket.socket] = []
        self._index = dict(addresses()).get(interface, 0) if interface else 0
        if interface and not self._index:
            raise OSError(f"no interface of this computer has the address {interface}")
        try:
            self._sender = self._open(interface)
            if multicast and interface:
                self._join(self._open(group))
            elif multicast:
                self._join(self._sender)
        except OSError:
            self.close()
            raise

    def _open(self, address: str) -> socket.socket:
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.sockets.append(opened)
        opened.setblocking(False)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        opened.setsockopt(socket.IPPROTO_IP, _IP_PKTINFO, 1)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, _TTL)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
        if self.interface:
            opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(self.interface))
        opened.bind((address, self.port))
        return opened

    def _join(self, member: socket.socket) -> None:
        request = struct.pack("4s4si", socket.inet_aton(self.group), b"\0\0\0\0", self._index)
        member.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, request)

    def close(self) -> None:
        """Close the sockets."""
        for opened in self.sockets:
            opened.close()
        self.sockets = []

    def send(self, datagram: bytes, host: Optional[str]) -> None:
        """Send to the group (None) or to an address. Raises OSError."""
        self._sender.sendto(datagram, (self.group if host is None else host, self.port))

    def receive(self, readable: socket.socket, most: int = 64) -> List[Datagram]:
        """Read the datagrams that have arrived, `most` at a time. Multicast of other interfaces than the own one is dropped."""
        datagrams: List[Datagram] = []
        for _count in range(most):
            try:
                data, ancillary, _flags, source = readable.recvmsg(1024, socket.CMSG_SPACE(12))
            except BlockingIOError:
                break
            except OSError:  # an ICMP error: an earlier datagram did not arrive
                continue
            index, to = 0, b"\0\0\0\0"
            for level, kind, value in ancillary:
                if (level, kind) == (socket.IPPROTO_IP, _IP_PKTINFO):
                    index, _local, to = struct.unpack("i4s4s", value[:12])
            multicast = 224 <= to[0] <= 239
            if not (multicast and self._index and index != self._index):
                datagrams.append(Datagram(data, source, multicast))
        return datagrams
