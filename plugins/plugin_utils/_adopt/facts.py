# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A machine as people have set it up by hand: the return of `multimaster_info` as types.

A machine may answer anything. Values that are no address, network or number are refused, texts are plain and short, lists bounded.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from ipaddress import IPv4Address, IPv4Interface, IPv4Network
from typing import Any

from .._base.features import load_hooks
from .._base.hosts import is_address, is_host_name, place_of
from .._base.plain_text import plain, quote
from .._base.sentences import UnexpectedValue
from .._inventory import kinds
from .hooks import AdoptHooks

Info = Mapping[str, Any]

NEEDED = ("interfaces", "routing", "forwarding", "masters")
MOST = 64  # of interfaces, roscores, discovery nodes, assignments
MOST_ROUTES = 2000
# Networks inside a computer: containers and virtual machines. Docker names a network of a user by its number, such as
# br-3f2a1b4c5d6e, and br-lan is a bridge of a person.
INSIDE = re.compile(r"(docker|virbr|veth|lxcbr|lxdbr|cni|podman|kube|cali|flannel|nodelocaldns).*|br-[0-9a-f]{4,12}")
# Links to a provider, over which no other robot is reached.
MOBILE = re.compile(r"(ppp|wwan|wwp|rmnet).*")
SINGLE = 32  # the prefix length of an address in no network: a VPN such as Tailscale, or batman-adv, has routes to the others
CARRIER_GRADE = IPv4Network("100.64.0.0/10")  # RFC 6598; Tailscale has all of it


class StrangeMachine(ValueError):
    """The answer of a machine cannot be understood."""


@dataclass(frozen=True)
class FoundRoute:
    """A route by a next hop."""

    destination: IPv4Network
    gateway: IPv4Address


@dataclass(frozen=True)
class Uri:
    """A host and a port."""

    host: str
    port: int

    @property
    def is_address(self) -> bool:
        """Return True if the host is an address of IPv4."""
        return is_address(self.host)


@dataclass(frozen=True)
class FoundDiscovery:
    """A discovery node; the group and the ports are None or 0 if its parameters do not set them."""

    uri: Uri | None
    group: IPv4Address | None
    group_port: int


@dataclass(frozen=True)
class FoundRoscore:
    """A roscore, its starter, and the nodes at it."""

    port: int
    uri: Uri | None
    runs: str  # its unit, else its command
    discovery: tuple[FoundDiscovery, ...] = ()
    syncs: bool = False  # a sync node is there
    contained: bool = False  # it runs in a container
    makes: frozenset[str] = frozenset()  # whose nodes these are: bundled, upstream, fkie_mas


@dataclass(frozen=True)
class FoundMachine:
    """A machine of the list."""

    name: str  # in the list
    hostname: str = ""
    addresses: tuple[IPv4Interface, ...] = ()
    singles: Mapping[IPv4Address, str] = field(default_factory=dict)  # addresses in no network, and their interfaces
    aside: tuple[str, ...] = ()  # addresses that no other computer reaches it by
    # Its addresses that have no multicast, by their interfaces or since they are in no network, and the interfaces.
    mute: Mapping[IPv4Address, str] = field(default_factory=dict)
    # The address from which packets to each of its own networks leave: with several there, the kernel takes one.
    sources: Mapping[IPv4Network, IPv4Address] = field(default_factory=dict)
    hops: tuple[FoundRoute, ...] = ()
    forwards: bool = False
    roscores: tuple[FoundRoscore, ...] = ()
    masters: tuple[Uri, ...] = ()  # the masters that its files and shells name, the ones that count most first
    ours: bool = False  # the collection runs services there
    features: Mapping[str, Any] = field(default_factory=dict)  # the facts of each optional feature


def read_machine(name: str, info: Info) -> FoundMachine:
    """Return a machine with the values that were read on it. Raises StrangeMachine."""
    missing = [part for part in NEEDED if part not in info] if isinstance(info, Mapping) else ["everything"]
    if missing:
        raise StrangeMachine(f"{', '.join(missing)} could not be read")
    try:
        usable, singles, aside, mute = _addresses(info["interfaces"])
        return FoundMachine(
            name=name,
            hostname=plain(info.get("hostname") or "", 64),
            addresses=tuple(usable),
            singles=singles,
            aside=tuple(aside),
            mute=mute,
            sources=_read_sources(info["routing"]["routes"]),
            hops=tuple(_hops(info["routing"]["routes"])),
            forwards=info["forwarding"]["ip_forward"] == 1,
            roscores=tuple(_roscore(entry) for entry in info["masters"][:MOST] if not entry["error"]),
            masters=tuple(_read_masters(info)),
            features={name: hooks.read(info) for name, hooks in load_hooks("adopt", AdoptHooks).items()},
            ours=any(str(record).startswith("services-") for record in info.get("owned") or ()),
        )
    except (LookupError, TypeError, ValueError, AttributeError) as problem:
        raise StrangeMachine(f"its answer cannot be understood ({quote(problem)})") from None


def _addresses(
    interfaces: Sequence[Info],
) -> tuple[list[IPv4Interface], dict[IPv4Address, str], list[str], dict[IPv4Address, str]]:
    """Return the addresses in networks, single ones, those that are left aside, and those by which no multicast goes, as of a VPN."""
    usable: list[IPv4Interface] = []
    singles: dict[IPv4Address, str] = {}
    aside: list[str] = []
    mute: dict[IPv4Address, str] = {}
    for entry in interfaces[:MOST]:
        for address in entry["addresses"][:MOST]:
            if address["family"] != "inet" or entry["loopback"]:
                continue
            found, device = IPv4Interface(f"{address['address']}/{address['prefix']}"), quote(entry["name"], 32)
            if entry.get("multicast") is False:
                mute[found.ip] = device
            why = _explain_aside(found, str(entry["name"]), entry["up"])
            if why:
                aside.append(f"{found} of {device}, {why}")
            elif found.network.prefixlen == SINGLE:
                singles[found.ip] = device
            else:
                usable.append(found)
    for address in [one for one in singles if any(one in other.network for other in usable)]:
        # Such as that of keepalived, which moves from one computer to another.
        aside.append(f"{address}/{SINGLE} of {singles.pop(address)}, beside an address in the network of which it is")
    return usable, singles, aside, {**mute, **singles}


def _explain_aside(address: IPv4Interface, device: str, up: Any) -> str:
    if INSIDE.fullmatch(device):
        return "a network inside the computer"
    if not up:
        return "which is switched off"
    if address.ip.is_link_local or address.network.prefixlen == SINGLE - 1:
        return "a network of one connection"
    if address.network.prefixlen == SINGLE and MOBILE.fullmatch(device):
        return "a link to a provider"
    if address.network.prefixlen == SINGLE and not (address.ip.is_private or address.ip in CARRIER_GRADE):
        return "a single public address"
    return ""


def _hops(routes: Sequence[Info]) -> Iterable[FoundRoute]:
    for entry in sorted(routes[:MOST_ROUTES], key=lambda entry: int(entry["metric"])):
        gateway = str(entry["gateway"] or "")
        if gateway and ":" not in gateway:
            yield FoundRoute(IPv4Network(str(entry["destination"])), IPv4Address(gateway))


def _read_sources(routes: Sequence[Info]) -> dict[IPv4Network, IPv4Address]:
    """Read the sources of the routes to own networks; of several to one, that with the lowest metric counts."""
    found: dict[IPv4Network, IPv4Address] = {}
    for entry in sorted(routes[:MOST_ROUTES], key=lambda entry: int(entry["metric"])):
        source = str(entry.get("source") or "")
        if source and not entry["gateway"]:
            found.setdefault(IPv4Network(str(entry["destination"])), IPv4Address(source))
    return found


def _roscore(entry: Info) -> FoundRoscore:
    process = entry["process"]
    discovery, sync = entry["discovery"][:MOST], entry["sync"][:MOST]
    return FoundRoscore(
        port=_port(entry["port"]),
        uri=uri(entry["uri"]),
        runs=quote(process["unit"] or process["command"], 100),
        discovery=tuple(map(_discovery, discovery)),
        syncs=bool(sync),
        contained=process.get("container") is True,
        makes=frozenset(str(node.get("implementation", "")) for node in (*discovery, *sync)),
    )


def _discovery(entry: Info) -> FoundDiscovery:
    return FoundDiscovery(
        uri=uri(entry.get("uri", "")),
        group=_group(entry.get("group", "")),
        group_port=_port(entry.get("group_port", 0)),
    )


def _group(text: Any) -> IPv4Address | None:
    """Return a multicast group; upstream's may say for which robots it is (`name@226.0.0.0`), or be anything."""
    try:
        return kinds.group(text)
    except UnexpectedValue:
        return None


def _port(number: Any) -> int:
    return int(number) if 0 < int(number) < 65536 else 0


def _read_masters(info: Info) -> Iterable[Uri]:
    """Find the values of ROS_MASTER_URI: the values in shells first, then those in files."""
    shells = sorted((info.get("environment") or {}).items(), key=lambda item: item[0] != "login")
    texts = [(variables or {}).get("ROS_MASTER_URI", "") for _kind, variables in shells]
    exports = (info.get("exports") or ())[:MOST]
    texts += [entry["value"] for entry in exports if entry["variable"] == "ROS_MASTER_URI"]
    return filter(None, map(uri, texts))


def uri(text: Any) -> Uri | None:
    """Return host and port of a URI such as http://tibi-nav:11311; None if the text is no such URI."""
    host, port = place_of(str(text))
    if not str(text).lower().startswith("http:") or not (is_host_name(host) or is_address(host)):
        return None
    return Uri(host, port or 11311)
