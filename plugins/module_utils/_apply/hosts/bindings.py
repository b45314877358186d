# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Bindings of an address to names: read from the options of the module, and from a line as libc reads it."""

import ipaddress
import re
import socket
import typing

from ..._base.problem import Problem

# RFC 1123, and underscores, which libc, Python and roscpp take in names of computers (my_robot).
_LABEL = re.compile(r"[a-z0-9_]([a-z0-9_-]{0,61}[a-z0-9_])?\Z")
_LOCAL_NAMES = frozenset(
    ["localhost4", "localhost6", "loopback", "broadcasthost"]
    + [f"ip6-{name}" for name in ("localhost", "loopback", "localnet", "mcastprefix", "allnodes", "allrouters")]
)
_UNFIT = ("loopback", "multicast", "unspecified")

Address = typing.Union[ipaddress.IPv4Address, ipaddress.IPv6Address]


class Binding(typing.NamedTuple):
    """An address and its names, the canonical one first."""

    address: Address
    names: typing.Tuple[str, ...]

    @property
    def keys(self) -> typing.List[typing.Tuple[int, str]]:
        """The keys of a lookup by libc: family and name; the case of letters means nothing (RFC 4343)."""
        return [(self.address.version, name.lower()) for name in self.names]


def address_of(text: str) -> typing.Optional[Address]:
    """Read an address as libc does (inet_pton(3)), or return None; an IPv4-mapped one is its IPv4 address."""
    for family in (socket.AF_INET, socket.AF_INET6):
        try:
            address = ipaddress.ip_address(socket.inet_pton(family, text))
        except (OSError, ValueError):
            continue
        return getattr(address, "ipv4_mapped", None) or address
    return None


def parse(line: bytes) -> typing.Optional[Binding]:
    """Read the binding of a line as libc does (hosts(5)), or return None if there is no address or no name."""
    fields = line.partition(b"#")[0].split()
    address = address_of(fields[0].decode("latin-1")) if len(fields) > 1 else None
    return None if address is None else Binding(address, tuple(name.decode("latin-1") for name in fields[1:]))


def bindings_of(entries: typing.List[typing.Dict[str, typing.Any]]) -> typing.List[Binding]:
    """Read the module's option `entries`. Raises Problem on the first entry that is wrong."""
    bindings: typing.List[Binding] = []
    place_of_address: typing.Dict[Address, str] = {}
    place_of_name: typing.Dict[typing.Tuple[int, str], typing.Tuple[str, Address]] = {}
    for index, entry in enumerate(entries):
        place = f"entries[{index}]"
        address = address_of(entry["address"])
        wrong = _wrong_address(entry["address"], address) or _wrong_names(entry["names"])
        if address is None or wrong:
            raise Problem(f"{place}: {wrong}")
        if address in place_of_address:
            raise Problem(
                f"{place_of_address[address]} and {place} both have the address {address}; expected one entry per "
                "address: give it all the names, or correct one address."
            )
        place_of_address[address] = place
        binding = Binding(address, tuple(entry["names"]))
        for key in binding.keys:
            if key in place_of_name:
                version, name = key
                other, other_address = place_of_name[key]
                raise Problem(
                    f"{place} gives the name {name} the address {address}, but {other} gives it {other_address}; "
                    f"expected one IPv{version} address per name: remove the name from one of them."
                )
            place_of_name[key] = (place, address)
        bindings.append(binding)
    return bindings


def _wrong_address(text: str, address: typing.Optional[Address]) -> str:
    if address is None:
        return f"the address is {text!r}, expected an IPv4 or IPv6 address, such as 192.168.1.229."
    for kind in _UNFIT:
        if getattr(address, f"is_{kind}"):
            return f"the address {text} is {kind}, expected one at which other computers reach it."
    return ""


def _wrong_names(names: typing.List[str]) -> str:
    if not names:
        return "names is empty, expected at least the name of the computer, such as [kobuki1computer]."
    earlier: typing.Set[str] = set()
    for name in names:
        lower = name.lower()
        if lower in _LOCAL_NAMES or "localhost" in (lower.split(".")[0], lower.split(".")[-1]):
            return f"the name {name!r} belongs to every machine itself, expected the name of a computer."
        if len(name) > 253 or not all(_LABEL.match(label) for label in lower.split(".")):
            return (
                f"the name {name!r} is no host name; expected letters, digits, hyphens and underscores, at most 63 in a "
                "row between dots, and no hyphen at the beginning or end of a part (RFC 1123)."
            )
        if _is_read_as_address(lower):
            return f"the name {name!r} is read as an address, expected a name that ends with a part that is no number."
        if lower in earlier:
            return f"the name {name!r} is given twice, expected each name once: remove one of them."
        earlier.add(lower)
    return ""


def _is_read_as_address(name: str) -> bool:
    """True for a name that programs take for an IPv4 address, as getaddrinfo(3) does with 10, 1.2 and 0x7f."""
    try:
        return bool(socket.inet_aton(name))
    except OSError:
        return name.split(".")[-1].isdigit()
