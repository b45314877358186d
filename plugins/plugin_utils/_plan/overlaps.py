# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Interfaces of a computer that lead into the network of another robot: a bridge of containers, a VPN, a hotspot.

Pure: the networks of the plan, and the facts of `multimaster_info`, in. It does not matter which route counts today: the order of
routes may be another one after the next boot, and then packets for that robot end at this computer. A wider network than the robot's
is harmless if the plan has a route to the robot's: the narrower one counts, in whatever order.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from ipaddress import IPv4Interface, IPv4Network
from typing import Any, NamedTuple

from .._base.plain_text import quote
from .._base.sentences import shorten_list
from .model import ComputerPlan, RobotNetwork

NAMED = 4  # overlaps of one computer that a sentence names
MOST = 64  # that are kept

#: the beginning of an interface's name -> where its network is changed
_PLACES = (
    (re.compile(r"docker|br-[0-9a-f]{12}$"), "bip or default-address-pools in /etc/docker/daemon.json"),
    (re.compile(r"virbr"), "virsh net-edit"),
    (re.compile(r"wg|tun|tap|zt|tailscale|ppp|nordlynx"), "the networks in the configuration of the VPN"),
    (re.compile(r"wl|ap[0-9]"), "the network of the hotspot (nmcli connection modify NAME ipv4.addresses)"),
)
_ELSEWHERE = "the configuration of that interface"


class Overlap(NamedTuple):
    """An interface that leads into the network of another robot."""

    interface: str
    what: str  # its address or route
    network: IPv4Network
    robot: str

    def __str__(self) -> str:
        return f"{quote(self.interface)} has {self.what}, in the network of {self.robot} ({self.network})"

    @property
    def place(self) -> str:
        """The place where its network is changed, as far as the name of the interface shows it."""
        return next((place for form, place in _PLACES if form.match(self.interface)), _ELSEWHERE)


def find_overlaps(plan: ComputerPlan, networks: Iterable[RobotNetwork], info: Mapping[str, Any]) -> list[Overlap]:
    """Find the addresses, and the routes of other interfaces, that lead into the networks of other robots; one for each pair."""
    own = {entry.network for entry in plan.networks}
    others = [_make_range(entry) for entry in networks if entry.robot != plan.robot and entry.network not in own]
    found: dict[tuple[str, str], Overlap] = {}
    if others:
        for overlap in (*_list_addresses(plan, others, info), *_list_routes(plan, others, info)):
            found.setdefault((overlap.interface, overlap.robot), overlap)
    return list(found.values())


class _Range(NamedTuple):  # a machine may have thousands of routes, and a comparison of numbers is fast
    first: int
    last: int
    entry: RobotNetwork


def _make_range(entry: RobotNetwork) -> _Range:
    return _Range(int(entry.network.network_address), int(entry.network.broadcast_address), entry)


def _list_addresses(plan: ComputerPlan, others: Sequence[_Range], info: Mapping[str, Any]) -> Iterator[Overlap]:
    """Yield the addresses whose network has addresses of another robot's. A planned address has a check of its own."""
    planned = {str(entry.address) for entry in plan.networks}
    routed = {destination for destination, _gateways in _list_ways(plan)}
    for interface in info["interfaces"]:
        for entry in interface["addresses"]:
            if ":" in entry["address"] or entry["address"] in planned:
                continue
            place = IPv4Interface(f"{entry['address']}/{entry['prefix']}")
            first, last = int(place.network.network_address), int(place.network.broadcast_address)
            for other in others:
                if first <= other.last and last >= other.first and not _is_harmless(plan, place, other.entry, routed):
                    yield Overlap(interface["name"], str(place), other.entry.network, other.entry.robot)


def _is_harmless(plan: ComputerPlan, place: IPv4Interface, other: RobotNetwork, routed: Collection[str]) -> bool:
    """Return True for a router that is the gateway of a robot, and for a wider network, which counts behind a planned route."""
    is_gateway = plan.is_router and place.ip == other.gateway
    is_wider = place.network.prefixlen < other.network.prefixlen and place.ip not in other.network
    return is_gateway or (is_wider and str(other.network) in routed)


def _list_routes(plan: ComputerPlan, others: Sequence[_Range], info: Mapping[str, Any]) -> Iterator[Overlap]:
    """Yield the routes of all tables into another robot's network, by an interface that the plan does not have."""
    routing = info.get("routing") or {}
    tables = [routing.get("routes", ()), *(entry["routes"] for entry in routing.get("tables", ()))]
    planned = _list_interfaces(plan, others, info)
    of_earlier = _list_of_earlier_plans(plan, planned, tables[0], info)
    for route in (route for table in tables for route in table):
        if not route["device"] or route["device"] in planned or (route["destination"], route["gateway"]) in of_earlier:
            continue
        destination = IPv4Network(route["destination"])
        first, last = int(destination.network_address), int(destination.broadcast_address)
        for other in others:
            if first >= other.first and last <= other.last:
                yield Overlap(route["device"], f"a route to {destination}", other.entry.network, other.entry.robot)


def _list_interfaces(plan: ComputerPlan, others: Sequence[_Range], info: Mapping[str, Any]) -> set[str]:
    """Name the interfaces with an address of the plan, those that features make, and those of a router that is a robot's gateway."""
    planned = {str(entry.address) for entry in plan.networks}
    planned |= {str(other.entry.gateway) for other in others if plan.is_router}
    has = (one["name"] for one in info["interfaces"] if planned & {entry["address"] for entry in one["addresses"]})
    return {*has, *(one.name for one in plan.interfaces_to_come)}


def _list_ways(plan: ComputerPlan) -> list[tuple[str, set[str]]]:
    """List the destinations of the routes that a run makes, each with its gateways."""
    made = [(str(route.destination), {str(route.gateway)}) for route in plan.routes]
    carried = plan.routes_expected if plan.carrier else ()  # its program makes them
    return made + [(str(route.destination), set(map(str, route.gateways))) for route in carried]


def _list_of_earlier_plans(
    plan: ComputerPlan, planned: set[str], main: Sequence[Mapping[str, Any]], info: Mapping[str, Any]
) -> set[tuple[str, str]]:
    """List the routes (destination, gateway) that may be of an earlier plan, which the run of this one takes away.

    A tunnel was turned on or off, or the computer has the common network at another interface. As soon as all routes of the plan
    are there, no other one is the collection's.
    """
    there = {(route["destination"], route["gateway"]) for route in main if route["device"] in planned}
    is_applied = all(any((destination, gateway) in there for gateway in of) for destination, of in _list_ways(plan))
    if is_applied or not info.get("owned"):
        return set()
    return {(route["destination"], route["gateway"]) for route in main if route["gateway"]}


def describe_overlaps(plan: ComputerPlan, overlaps: Sequence[Overlap]) -> list[str]:
    """Describe the overlaps of a computer in one sentence; an empty list without overlaps."""
    if not overlaps:
        return []
    robots = shorten_list(dict.fromkeys(overlap.robot for overlap in overlaps))
    places = shorten_list(dict.fromkeys(overlap.place for overlap in overlaps))
    return [
        f"{plan.computer}: {shorten_list(map(str, overlaps), NAMED)}; expected none, since packets for {robots} end at this computer as soon as "
        f"its routes have another order, as after a boot: change {places}, or give the robot another network in the inventory."
    ]
