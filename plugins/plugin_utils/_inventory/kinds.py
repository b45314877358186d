# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Kinds of values: each function reads one value of an inventory and returns it as a type, or raises UnexpectedValue."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Mapping, Sequence
from ipaddress import IPv4Address, IPv4Network, IPv6Address, ip_address, ip_network
from typing import Any, NamedTuple, TypeVar

from .._base import hosts
from .._base.sentences import UnexpectedValue, nearest
from . import exports
from .filters import Filters, InvalidPattern

T = TypeVar("T")

FILTERS = tuple(sorted(exports.FILTERS))

_NAME = re.compile(r"(?!-)[a-z0-9-]{1,63}(?<!-)(\.(?!-)[a-z0-9-]{1,63}(?<!-))*", re.IGNORECASE)


def text(value: Any) -> str:
    """Read a text that is not empty."""
    if not isinstance(value, str) or not value:
        raise UnexpectedValue("a text that is not empty")
    return str(value)


def _parse(kind: Callable[[str], T], value: Any, expected: str) -> T:
    try:
        return kind(text(value))
    except ValueError:
        raise UnexpectedValue(expected) from None


def _items(value: Any, expected: str) -> Sequence[Any]:
    if not isinstance(value, (list, tuple)):
        raise UnexpectedValue(expected)
    return value


def is_host_name(value: Any) -> bool:
    """Return True for a host name (RFC 1123) that is no address."""
    return isinstance(value, str) and bool(_NAME.fullmatch(value)) and hosts.is_host_name(value.lower())


def is_given_name(value: Any) -> bool:
    """Return True for a name that a computer has already: also with underscores, which hosts files, rospy and roscpp take."""
    return isinstance(value, str) and hosts.is_host_name(value.lower())


def name(value: Any) -> str:
    """Read a host name (RFC 1123)."""
    if not is_host_name(value):
        raise UnexpectedValue("a host name: letters, digits and hyphens (RFC 1123), and no address")
    return str(value)


def given_names(value: Any) -> list[str]:
    """Read a list of names that a computer has already."""
    names = _items(value, "a list of host names")
    if not all(map(is_given_name, names)):
        raise UnexpectedValue("a list of host names: letters, digits, hyphens and underscores, and no address")
    return list(map(str, names))


def address(value: Any) -> IPv4Address:
    """Read the IPv4 address of one computer."""
    parsed = _parse(ip_address, value, "an IPv4 address such as 192.168.1.229")
    if isinstance(parsed, IPv6Address):
        raise UnexpectedValue(
            "an IPv4 address such as 192.168.1.229, since the nodes of ROS 1 are reached only by IPv4 here"
        )
    if not isinstance(parsed, IPv4Address) or parsed.is_loopback or parsed.is_multicast or parsed.is_unspecified:
        raise UnexpectedValue("the IPv4 address of one computer, such as 192.168.1.229")
    return parsed


def endpoint(value: Any) -> IPv4Address | None:
    """Read the IPv4 address of one computer; `none` for a computer whose address changes."""
    if value == "none":
        return None
    end = address(value)
    if any(end in network for network in NOBODYS):
        raise UnexpectedValue("the IPv4 address of one computer, such as 192.168.1.229")
    return end


class SealedComputer(NamedTuple):
    """A computer where Ansible does not log in: its address, and its further names."""

    address: IPv4Address
    aliases: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return the address and the names, for a sentence."""
        return " ".join([str(self.address), *self.aliases])


def seals(value: Any) -> Mapping[str, SealedComputer]:
    """Read the sealed computers of a robot: each name with its address, or with `address` and `aliases`."""
    expected = "names of computers with their addresses, such as {hsrb: 192.168.1.40}"
    if not isinstance(value, Mapping):
        raise UnexpectedValue(expected)
    for key, entry in value.items():
        if not is_given_name(key) or key.lower() == "localhost":
            raise UnexpectedValue(f"{expected}, but '{key}' is no name")
        unknown = sorted(map(str, set(entry) - set(SealedComputer._fields))) if isinstance(entry, Mapping) else []
        if unknown:
            raise UnexpectedValue(
                f"'address' and 'aliases' of '{key}'{nearest(unknown[0], SealedComputer._fields)}, but '{unknown[0]}' is neither"
            )
    return {str(key): _seal(entry) for key, entry in value.items()}


def _seal(entry: Any) -> SealedComputer:
    if isinstance(entry, Mapping):
        return SealedComputer(address(entry.get("address")), tuple(given_names(entry.get("aliases", ()))))
    return SealedComputer(address(entry))


def gateway(value: Any) -> str | IPv4Address:
    """Read the name of a computer, or the address of another device."""
    for kind in (name, address):
        with contextlib.suppress(UnexpectedValue):
            return kind(value)
    raise UnexpectedValue("the name of a computer of the robot, or the address of another device")


# No computer has an address of these: this network, the computer itself, groups and reserved ones (RFC 6890).
NOBODYS = tuple(map(IPv4Network, ("0.0.0.0/8", "127.0.0.0/8", "224.0.0.0/3")))


def network(value: Any) -> IPv4Network:
    """Read an IPv4 network of several addresses."""
    parsed = _parse(ip_network, value, "an IPv4 network such as 192.168.1.0/24, without host bits")
    if not isinstance(parsed, IPv4Network) or parsed.prefixlen > 30 or any(map(parsed.overlaps, NOBODYS)):
        raise UnexpectedValue("an IPv4 network of several addresses, such as 192.168.1.0/24")
    return parsed


def sources(value: Any) -> tuple[IPv4Network, ...]:
    """Read a list of addresses and networks; an address is a network of one."""
    expected = "a list of IPv4 addresses and networks, such as [192.168.1.77, 192.168.2.0/24]"
    return tuple(map(_source, _items(value, expected)))


def _source(value: Any) -> IPv4Network:
    expected = "IPv4 addresses and networks without host bits, such as [192.168.1.77, 192.168.2.0/24]"
    parsed = _parse(ip_network, value, f"{expected}, but '{value}' is neither")
    if not isinstance(parsed, IPv4Network) or parsed.is_loopback or parsed.is_multicast or parsed.is_unspecified:
        raise UnexpectedValue(f"IPv4 addresses and networks of computers, but '{value}' is none")
    if parsed.prefixlen == 0:
        raise UnexpectedValue(
            f"networks of known computers, but '{value}' is everybody: set multimaster_strangers to 'allow'"
        )
    return parsed


_PORT = re.compile(r"([1-9][0-9]{0,4})/(tcp|udp)")


def ports(value: Any) -> tuple[str, ...]:
    """Read a list of ports with their protocols."""
    wanted = "a list of ports with their protocols, such as [51820/udp]"
    for entry in _items(value, wanted):
        match = _PORT.fullmatch(text(entry))
        if not match or int(match[1]) > 65535:
            raise UnexpectedValue(f"{wanted}, but '{entry}' is none")
    return tuple(value)


def group(value: Any) -> IPv4Address:
    """Read an IPv4 multicast group."""
    parsed = _parse(ip_address, value, "an IPv4 multicast group between 224.0.0.0 and 239.255.255.255")
    if not isinstance(parsed, IPv4Address) or not parsed.is_multicast or parsed == IPv4Address("224.0.0.0"):
        raise UnexpectedValue("an IPv4 multicast group between 224.0.0.1 and 239.255.255.255")
    return parsed


def number(kind: type[int] | type[float], low: float, high: float) -> Callable[[Any], float]:
    """Return a reader of numbers of this kind, from `low` to `high`. The text of a number is read too."""

    def read(value: Any) -> float:
        expected = UnexpectedValue(f"{'a whole number' if kind is int else 'a number'} from {low} to {high}")
        if isinstance(value, bool) or not isinstance(value, (kind, int, str)):
            raise expected
        try:
            parsed = kind(value)
        except ValueError:
            raise expected from None
        if not low <= parsed <= high:
            raise expected
        return parsed

    return read


def switch(value: Any) -> bool:
    """Read true or false, in the words of YAML."""
    word = str(value).lower() if isinstance(value, (bool, str)) else ""
    if word not in ("true", "yes", "on", "false", "no", "off"):
        raise UnexpectedValue("true or false")
    return word in ("true", "yes", "on")


def choice(*choices: str) -> Callable[[Any], str]:
    """Return a reader of one of these words."""

    def read(value: Any) -> str:
        if value not in choices:
            raise UnexpectedValue("one of " + ", ".join(choices))
        return str(value)

    return read


def setup(value: Any) -> str:
    """Read the place of ROS: `auto`, `debian`, or an absolute path."""
    if value in ("auto", "debian"):
        return str(value)
    if not isinstance(value, str) or not value.startswith("/") or ".." in value.split("/"):
        raise UnexpectedValue("auto, debian, or the absolute path of a set-up file such as /opt/ros/noetic/setup.bash")
    return str(value)


_FOLDER = re.compile(r"(/[A-Za-z0-9_][A-Za-z0-9._-]*)+")


def folder(value: Any) -> str:
    """Read the absolute path of a folder, in letters without a meaning to systemd."""
    if not isinstance(value, str) or not _FOLDER.fullmatch(value):
        raise UnexpectedValue(
            "the absolute path of a folder: letters, digits, '.', '_' and '-', as in /var/lib/prometheus/node-exporter"
        )
    return str(value)


def filters(value: Any) -> dict[str, list[str]]:
    """Read filters: lists of patterns, by the names in FILTERS."""
    if not isinstance(value, Mapping):
        raise UnexpectedValue("a mapping of filters, such as {ignore_topics: [/tf]}")
    read: dict[str, list[str]] = {}
    for key, patterns in value.items():
        if key not in FILTERS:
            raise UnexpectedValue(
                f"filters named {', '.join(FILTERS)}, but there is '{key}'{nearest(str(key), FILTERS)}"
            )
        texts = _items(patterns, f"a list of patterns at '{key}', such as [/tf, '/camera/*']")
        if not all(isinstance(pattern, str) and pattern.strip() for pattern in texts):
            raise UnexpectedValue(f"patterns at '{key}' that are texts and not empty")
        read[str(key)] = [str(pattern) for pattern in texts]
        try:
            Filters(exports.make_node_filters(read)).check()  # as the nodes check them at their start
        except InvalidPattern as problem:
            raise UnexpectedValue(f"regular expressions at '{key}', but {problem}") from None
    return read
