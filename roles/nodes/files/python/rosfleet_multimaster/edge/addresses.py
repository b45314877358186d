# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The addresses of this computer, and those of names (IPv4 only, as ROS 1 is by default)."""

import socket
import struct
from typing import Dict, Iterable, List, Set, Tuple

_RTM_NEWADDR, _RTM_GETADDR, _NLM_ROOT_REQUEST, _NLMSG_DONE, _IFA_ADDRESS, _IFA_LOCAL = 20, 22, 0x301, 3, 1, 2


def addresses() -> List[Tuple[str, int]]:
    """(IPv4 address, index of its interface) of this computer."""
    found: List[Tuple[str, int]] = []
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, 0) as kernel:
        kernel.settimeout(2.0)
        kernel.bind((0, 0))
        kernel.send(struct.pack("=IHHII BBBBI", 24, _RTM_GETADDR, _NLM_ROOT_REQUEST, 1, 0, socket.AF_INET, 0, 0, 0, 0))
        while True:
            data = kernel.recv(65536)
            while data:
                length, kind = struct.unpack_from("=IH", data)
                if kind != _RTM_NEWADDR:
                    return found
                index, parts, at = struct.unpack_from("=I", data, 20)[0], {}, 24
                while at < length:
                    size, part = struct.unpack_from("=HH", data, at)
                    parts[part] = data[at + 4 : at + size]
                    at += (size + 3) & ~3
                address = parts.get(_IFA_LOCAL, parts.get(_IFA_ADDRESS, b""))
                if len(address) == 4:
                    found.append((socket.inet_ntoa(address), index))
                data = data[(length + 3) & ~3 :]


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


def addresses_of_all(hosts: Iterable[str]) -> Dict[str, str]:
    """Host -> IPv4 address. Hosts without one are left out."""
    found = {}
    for host in hosts:
        try:
            found[host] = address_of(host)
        except (OSError, UnicodeError):  # one that is no host name must not hide the others
            pass
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
