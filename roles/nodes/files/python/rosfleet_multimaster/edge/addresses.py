# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The addresses of this computer, and those of names (IPv4 only, as ROS 1 is by default)."""

import contextlib
import math
import os
import socket
import struct
from functools import partial
from typing import Dict, Iterable, Iterator, List, NamedTuple, Set, Tuple

from ..protocol.tcpros.hosts import host_of
from .clock import monotonic
from .patience import run_with_limit

# linux/netlink.h
REQUEST, ACKNOWLEDGE, ALL = 0x1, 0x4, 0x300  # flags of a question; the last one: all there are, NLM_F_DUMP
_ERROR, _DONE = 2, 3  # kinds of messages that end an answer
# linux/rtnetlink.h, linux/if_link.h, linux/if_addr.h and net/if.h
_RTM_GETLINK, _RTM_GETADDR, _RTM_GETROUTE = 18, 22, 26
_IFA_ADDRESS, _IFA_LOCAL, _RTA_DST, _RTN_LOCAL, _IFF_RUNNING = 1, 2, 1, 2, 0x40
NO_ADDRESS = (socket.gaierror, UnicodeError)  # of a name that no resolver knows, and of one that is no host name
_GROUPS = 0x1 | 0x10 | 0x40  # RTMGRP_LINK | RTMGRP_IPV4_IFADDR | RTMGRP_IPV4_ROUTE


class Network(NamedTuple):
    """The network of this computer at one moment."""

    interfaces: Dict[str, int]  # IPv4 address of an interface -> its index
    own: Set[str]  # addresses that lead to this computer itself; one may be a local route, without an interface
    running: Set[int]  # interfaces that are up and have a carrier


def network() -> Network:
    """The network of this computer as the kernel reports it now. Raises OSError."""
    of = dict(addresses())
    own, running = set(of), set()
    for head, parts in _list(_RTM_GETROUTE, 12):
        length, kind = head[1], head[7]
        if kind == _RTN_LOCAL and length == 32 and len(parts.get(_RTA_DST, b"")) == 4:
            own.add(socket.inet_ntoa(parts[_RTA_DST]))
    for head, _parts in _list(_RTM_GETLINK, 16, socket.AF_UNSPEC):
        index, flags = struct.unpack_from("=iI", head, 4)
        if flags & _IFF_RUNNING:
            running.add(index)
    return Network(of, own, running)


def networks() -> List[str]:
    """The networks of this computer's interfaces, as 192.168.1.2/24; not the loopback's."""
    found = []
    for head, parts in _list(_RTM_GETADDR, 8):
        address = parts.get(_IFA_ADDRESS, b"")  # the other end's, on a point-to-point link
        if len(address) == 4 and address[0] != 127:
            found.append(f"{socket.inet_ntoa(address)}/{head[1]}")
    return found


def addresses() -> List[Tuple[str, int]]:
    """(IPv4 address, index of its interface) of this computer."""
    found: List[Tuple[str, int]] = []
    for head, parts in _list(_RTM_GETADDR, 8):
        address = parts.get(_IFA_LOCAL, parts.get(_IFA_ADDRESS, b""))
        if len(address) == 4:
            found.append((socket.inet_ntoa(address), struct.unpack_from("=I", head, 4)[0]))
    return found


def _list(request: int, size: int, family: int = socket.AF_INET) -> Iterator[Tuple[bytes, Dict[int, bytes]]]:
    """The lists of the kernel (rtnetlink(7)): each message, which begins with a head of this size, and its attributes."""
    for message in ask_kernel(socket.NETLINK_ROUTE, request, REQUEST | ALL, struct.pack("=B15x", family)):
        yield message, attributes(message, size)


def ask_kernel(protocol: int, request: int, flags: int, body: bytes) -> Iterator[bytes]:
    """The messages of the kernel's answer by netlink(7): a list, or at most one. Raises OSError."""
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, protocol) as kernel:
        kernel.settimeout(2.0)
        kernel.send(struct.pack("=IHHII", 16 + len(body), request, flags, 1, 0) + body)
        while True:
            data = kernel.recv(1 << 16)
            while len(data) >= 16:
                length, kind = struct.unpack_from("=IH", data)
                (code,) = struct.unpack_from("=i", data, 16) if kind == _ERROR else (0,)
                if code:
                    raise OSError(-code, os.strerror(-code))
                if kind in (_ERROR, _DONE):  # an error of the number 0 says that it is done
                    return
                yield data[16:length]
                if not flags & ALL:
                    return
                data = data[(length + 3) & ~3 :]


def attributes(message: bytes, at: int) -> Dict[int, bytes]:
    """The attributes of a message from there on, by their kind."""
    found = {}
    while at + 4 <= len(message):
        size, kind = struct.unpack_from("=HH", message, at)
        found[kind] = message[at + 4 : at + size]
        at += max((size + 3) & ~3, 4)
    return found


class AddressChanges:
    """A socket that can be read as soon as an interface, an address or a route has changed."""

    def __init__(self) -> None:
        """Raises OSError if the kernel reports nothing."""
        self.socket = socket.socket(socket.AF_NETLINK, socket.SOCK_RAW | socket.SOCK_NONBLOCK, 0)
        self.socket.bind((0, _GROUPS))

    def clear(self) -> None:
        """Forget the changes until now."""
        with contextlib.suppress(OSError):  # no more, or more than the socket holds
            while self.socket.recv(65536):
                pass


def resolve(name: str) -> str:
    """The IPv4 address of a host name or of a network device. Raises OSError."""
    for index, device in socket.if_nameindex():
        if device == name:
            for address, of in addresses():
                if of == index:
                    return address
    return socket.gethostbyname(name)


def address_of(host: str) -> str:
    """The IPv4 address of a host name. Raises OSError."""
    return socket.gethostbyname(host)


def addresses_of_all(hosts: Iterable[str], seconds: float = math.inf) -> Dict[str, str]:
    """Host -> IPv4 address. Hosts without one are left out, and those whose turn would come after so many seconds."""
    found, until = {}, monotonic() + seconds
    for host in hosts:
        if monotonic() > until:
            break
        with contextlib.suppress(OSError, UnicodeError):  # one that is no host name must not hide the others
            found[host] = address_of(host)
    return found


def source_address(group: str, port: int, own: Set[str]) -> str:
    """The address from which the kernel sends to the group; without a route any address of this computer."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((group, port))
            return str(probe.getsockname()[0])
    except OSError:
        return next(
            (address for address in sorted(own) if address[0].isdigit() and not address.startswith("127.")), "127.0.0.1"
        )


def find_own_host() -> str:
    """The name of this computer in URIs, as ROS has it: ROS_HOSTNAME, ROS_IP or its own name."""
    return os.environ.get("ROS_HOSTNAME") or os.environ.get("ROS_IP") or socket.gethostname()


def local_hosts() -> Set[str]:
    """Names, in small letters, and addresses of this computer."""
    names = {socket.gethostname(), "localhost", os.environ.get("ROS_IP", ""), os.environ.get("ROS_HOSTNAME", "")}
    own = {name.lower() for name in names if name}
    try:
        return own | network().own
    except OSError:
        return own


def local_uris(uris: Iterable[str], seconds: float) -> Set[str]:
    """Those URIs that lead to this computer, as far as their names can be resolved in this time."""
    own, hosts = local_hosts(), {uri: host_of(uri) for uri in uris}
    others = {host for host in hosts.values() if host and host not in own}
    try:
        known = run_with_limit(seconds, partial(addresses_of_all, others))
    except TimeoutError:  # a name server that does not answer
        known = {}
    own |= {host for host in others if host.startswith("127.") or known.get(host) in own}
    return {uri for uri, host in hosts.items() if host in own}
