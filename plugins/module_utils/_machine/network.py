# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The network of this machine: its interfaces with their addresses, and the routes that the kernel takes.

Only this file reads the output of `ip address`, `ip link`, `ip route get` and `ip route show default`.
(`_apply/routes/kernel.py` reads whole routing tables, because it must be able to make each route again.)
"""

import contextlib
import ipaddress
import json
import re
import socket
import typing

from .._base.commands import run, text
from .._base.plain_text import quote

WITH_PORTS = ("bridge", "bond", "team")  # kinds of interfaces whose packets come and go by their ports (ip-link(8))
PERMANENT = 0x4  # the flag of a neighbour set by hand or by a program (ATF_PERM)


class Address(typing.NamedTuple):
    """An address of an interface, with the length of its network's prefix."""

    address: str
    prefix: int
    family: str  # "inet" or "inet6", as `ip` says it

    @property
    def interface(self) -> typing.Union[ipaddress.IPv4Interface, ipaddress.IPv6Interface]:
        """The address together with its network."""
        return ipaddress.ip_interface(f"{self.address}/{self.prefix}")


class NetworkInterface(typing.NamedTuple):
    """A network interface."""

    name: str
    index: int = 0  # type: ignore[assignment]  # hides tuple.index, which has no use here
    up: bool = False
    multicast: bool = False
    loopback: bool = False
    mtu: int = 0  # bytes
    point_to_point: bool = False  # a link with two ends, such as a tunnel: no computer is asked for by ARP
    addresses: typing.Tuple[Address, ...] = ()
    port_of: str = ""  # the bridge or bond above it, which gets the packets
    macvlan_of: str = ""  # the interface below it, if it is a macvlan: both have a hardware address on one wire

    @property
    def networks(self) -> typing.List[typing.Any]:
        """The addresses of the interface with their networks (ipaddress)."""
        return [address.interface for address in self.addresses]

    def plain(self) -> typing.Dict[str, typing.Any]:
        """The interface as multimaster_info returns it."""
        fields = self._asdict()
        del fields["index"]
        return dict(fields, addresses=[dict(address._asdict()) for address in self.addresses])


class RouteTo(typing.NamedTuple):
    """The route that the kernel takes to a destination. A field is None if `ip route` does not name it."""

    destination: str
    gateway: typing.Optional[str] = None
    device: typing.Optional[str] = None
    source: typing.Optional[str] = None  # the address with which this machine sends there
    metric: typing.Optional[str] = None
    error: str = ""  # the kernel's words if there is no route

    def plain(self) -> typing.Dict[str, typing.Optional[str]]:
        """The route as multimaster_info returns it."""
        fields = self._asdict()
        del fields["metric"]
        return dict(fields)


# Interfaces


def interfaces() -> typing.List[NetworkInterface]:
    """Read the network interfaces with their addresses. Raises OSError if `ip` fails."""
    for words in ("-details",), ():  # old versions of ip write the details of some links as broken JSON
        answer = run(["ip", "-json", *words, "address"])
        with contextlib.suppress(ValueError):
            return from_json(answer.output.decode("utf-8") if answer.status == 0 else "")
    raise OSError(f"the interfaces' addresses cannot be read: {quote(answer.error) or 'ip failed'}")


def from_json(output: str) -> typing.List[NetworkInterface]:
    """Read the interfaces in the output of `ip -json address`. Raises ValueError for anything else."""
    data = json.loads(output)
    if not isinstance(data, list):
        raise ValueError("expected a list of interfaces")
    links = [link for link in data if "ifname" in link]  # old versions leave empty objects
    above = _find_with_ports(links)
    return [
        NetworkInterface(
            name=link["ifname"],
            index=link.get("ifindex", 0),
            up="UP" in link.get("flags", ()),
            multicast="MULTICAST" in link.get("flags", ()),
            loopback="LOOPBACK" in link.get("flags", ()),
            mtu=link.get("mtu", 0),
            point_to_point="POINTOPOINT" in link.get("flags", ()),
            addresses=tuple(
                Address(entry["local"], entry["prefixlen"], entry["family"])
                for entry in link.get("addr_info", ())
                if "local" in entry
            ),
            port_of=link["master"] if link.get("master") in above else "",
            macvlan_of=link.get("link", "") if link.get("linkinfo", {}).get("info_kind") == "macvlan" else "",
        )
        for link in links
    ]


def _find_with_ports(links: typing.Iterable[typing.Dict[str, typing.Any]]) -> typing.Dict[str, str]:
    """Find the bridges and bonds, with their hardware addresses."""
    return {
        link["ifname"]: link.get("address", "")
        for link in links
        if link.get("linkinfo", {}).get("info_kind") in WITH_PORTS
    }


class UpperInterface(typing.NamedTuple):
    """The bridge or bond above an interface."""

    master: str
    mac: str  # its hardware address


def read_ports() -> typing.Dict[str, UpperInterface]:
    """Read the interfaces that are ports of a bridge or a bond: by name; empty if `ip` does not show them."""
    answer = run(["ip", "-json", "-details", "link"])
    try:
        return list_ports(answer.output.decode("utf-8") if answer.status == 0 else "")
    except ValueError:
        return {}


def list_ports(output: str) -> typing.Dict[str, UpperInterface]:
    """Read the ports in the output of `ip -json -details link`. Raises ValueError for anything else."""
    data = json.loads(output)
    if not isinstance(data, list):
        raise ValueError("expected a list of interfaces")
    links = [link for link in data if "ifname" in link]
    macs = _find_with_ports(links)
    return {
        link["ifname"]: UpperInterface(link["master"], macs[link["master"]])
        for link in links
        if link.get("master") in macs
    }


# Routes


def route_to(destination: str) -> RouteTo:
    """Read the route that the kernel takes to an IPv4 address (ip-route(8), get)."""
    if not is_address(destination):
        return RouteTo(destination, error="this is no IPv4 address")
    answer = run(["ip", "-4", "-oneline", "route", "get", destination])
    if answer.status != 0:
        return RouteTo(destination, error=answer.last_error.replace("RTNETLINK answers: ", "") or "no route")
    return route_from_text(answer.text, destination)


def is_address(text: str) -> bool:
    """True for an IPv4 address in its usual spelling: 010 is 8 for some programs, and 10 for some versions of Python."""
    try:
        return str(ipaddress.IPv4Address(text)) == text
    except ValueError:
        return False


def default_routes() -> typing.List[RouteTo]:
    """Read the default routes of IPv4 in the table main."""
    output = run(["ip", "-4", "route", "show", "default"]).text
    return [route_from_text(line, "default") for line in output.splitlines() if line.startswith("default")]


def policy_rules() -> typing.List[str]:
    """Read the rules of IPv4 without the kernel's own three (ip-rule(8))."""
    output = run(["ip", "-4", "rule", "show"]).text
    lines = (" ".join(line.split()) for line in output.splitlines())
    return [line for line in lines if not re.fullmatch(r"\d+: from all lookup (local|main|default)", line)]


def route_from_text(output: str, destination: str) -> RouteTo:
    """Read the route in the output of `ip route get`, or in a line of `ip route show`."""
    # A route to an IPv4 address may go by a gateway that has an IPv6 address: `via inet6 fe80::1`.
    matches = [re.search(rf"\b{word} (\S+)", output) for word in ("via(?: inet6)?", "dev", "src", "metric")]
    gateway, device, source, metric = (match.group(1) if match else None for match in matches)
    return RouteTo(destination, gateway, device, source, metric)


def neighbours(path: str = "/proc/net/arp") -> typing.Dict[str, typing.Tuple[str, bool]]:
    """Read {address: (hardware address, set by hand)} of the neighbours that the kernel knows (proc(5), linux/if_arp.h)."""
    rows = [line.split() for line in text(path).splitlines()[1:]]
    known = [row for row in rows if len(row) >= 6 and row[3] != "00:00:00:00:00:00"]
    return {row[0]: (row[3], bool(int(row[2], 16) & PERMANENT)) for row in known}


# Names


def resolve(name: str) -> typing.Tuple[typing.List[str], str]:
    """Look up the IPv4 addresses of a name, as other programs here do. Without an address, the second value says why."""
    try:
        answers = socket.getaddrinfo(name, None, socket.AF_INET, socket.SOCK_STREAM)
    except (OSError, UnicodeError) as problem:
        return [], getattr(problem, "strerror", None) or str(problem)
    return list(dict.fromkeys(str(answer[4][0]) for answer in answers)), ""
