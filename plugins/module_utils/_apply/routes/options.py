# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The wanted routes: the option `routes` of the module, read and checked against the interfaces. Pure."""

import ipaddress
import re
import typing

from ..._base.plain_text import quote
from ..._base.problem import Problem
from ..._machine.network import NetworkInterface
from .kernel import DEFAULTS, METRICS, NO_WAY, PATH, Key, RouteSpec, format_destination, format_route, usual_scope

_LARGEST = 2**32 - 1
_LOCAL = 255  # the table local, which belongs to the kernel

Suboptions = typing.Mapping[str, typing.Any]  # one item of the option, every suboption set
Interfaces = typing.Mapping[str, NetworkInterface]  # by name
Tables = typing.Mapping[str, int]  # the numbers of the routing tables that have names
Links = typing.Callable[[int], typing.Iterable[RouteSpec]]  # version of IP -> the routes of the table main


class RouteRequest(typing.NamedTuple):
    """One route of the option, and its setting for the boot."""

    route: RouteSpec
    boot_device: str  # the interface that brings the route back at boot; "" if any interface will do
    backend: str


# From the option to routes


def parse_routes(
    wanted: typing.Iterable[Suboptions],
    interfaces: Interfaces,
    tables: Tables,
    links: Links,
) -> typing.List[RouteRequest]:
    """The routes of the option, each with its interface. A repeated item counts once.

    `links` gives routes for a gateway outside the networks of all interfaces, such as the other end of a point-to-point link.
    Raises Problem for an item that makes no sense, and for two items with one key.
    """
    items: typing.List[RouteRequest] = []
    keys: typing.Dict[Key, RouteRequest] = {}
    for number, fields in enumerate(wanted, 1):
        where = f"routes: item {number} ({fields['destination']})"
        fields = dict(fields, table=_parse_table(fields["table"], where, tables))
        item = _parse_route(fields, where, interfaces, links)
        earlier = keys.setdefault(item.route.key, item)
        if earlier is item:
            items.append(item)
        elif earlier != item:
            raise Problem(
                f"routes: found two routes to {format_destination(item.route.destination)} with metric {item.route.metric} in table "
                f"{item.route.table}, expected one: remove one of them, or give it another metric."
            )
    return items


def _parse_route(fields: Suboptions, where: str, interfaces: Interfaces, links: Links) -> RouteRequest:
    destination = _parse_destination(fields["destination"], where)
    version = 6 if ":" in destination else 4
    gateway = _parse_address(fields["gateway"], version, where, "gateway")
    source = _parse_address(fields["source"], version, where, "source")
    _check_way(fields, gateway, source, where)
    device = _choose_device(fields, gateway, where, interfaces, links)
    _check_number("metric", fields["metric"] or 0, 0, where)
    _check_number("table", fields["table"], 1, where)
    for name in PATH:
        _check_number(name, fields.get(name) or 0, 0, where)
    route = RouteSpec(
        destination=destination,
        gateway=gateway,
        device="" if fields["type"] in NO_WAY else device,
        metric=fields["metric"] or METRICS[version],
        table=fields["table"],
        source=source,
        on_link=fields["on_link"],
        type=fields["type"],
        scope=_parse_scope(fields, version, gateway, where),
        **{name: fields.get(name) or 0 for name in PATH},
    )
    return RouteRequest(route, device, fields["backend"])


def _parse_table(value: typing.Any, where: str, tables: Tables) -> int:
    """The number of a table. Its name comes from the files of iproute2."""
    text = str(value)
    if re.fullmatch(r"-?[0-9]+", text):
        return int(text)
    if text not in tables:
        names = ", ".join(map(quote, sorted(tables))) or "no names"
        raise Problem(
            f"{where}: there is no routing table {text} in rt_tables of /etc/iproute2 or /usr/share/iproute2 (found {names}): "
            "correct table, or give its number."
        )
    return tables[text]


def _parse_scope(fields: Suboptions, version: int, gateway: str, where: str) -> str:
    scope = str(fields.get("scope") or "")
    if scope and version == 6:
        raise Problem(f"{where}: found the scope {scope}, and IPv6 has no scopes of routes: remove scope.")
    if scope == "host" and gateway:
        raise Problem(f"{where}: found the scope host with a gateway, expected the scope link or global: correct it.")
    return "" if scope == usual_scope(fields["type"], gateway) else scope


def _parse_destination(value: str, where: str) -> str:
    if value == "default":
        return DEFAULTS[4]
    try:
        return str(ipaddress.ip_network(value))
    except ValueError as problem:
        raise Problem(
            f"{where}: found a destination that is no network ({problem}), expected one such as 192.168.11.0/24, "
            "fd00:11::/64, default or ::/0."
        ) from problem


def _parse_address(value: typing.Optional[str], version: int, where: str, option: str) -> str:
    if not value:
        return ""
    try:
        address = ipaddress.ip_address(value)
    except ValueError as problem:
        raise Problem(f"{where}: the {option} {value} is no address: correct it.") from problem
    if address.version != version:
        raise Problem(
            f"{where}: the {option} {value} is an IPv{address.version} address, expected IPv{version} as the destination "
            "(the default of IPv6 is ::/0)."
        )
    return str(address)


def _check_way(fields: Suboptions, gateway: str, source: str, where: str) -> None:
    """A unicast route needs a gateway or a device; a blackhole and its like have no way."""
    if fields["type"] in NO_WAY:
        if gateway or source or fields["on_link"] or any(fields.get(name) for name in ("scope",) + PATH):
            raise Problem(
                f"{where}: found the type {fields['type']} with a way, expected no gateway, source, on_link, scope or "
                f"{', '.join(PATH)}: remove them."
            )
    elif not gateway and not fields["device"]:
        raise Problem(f"{where}: found neither gateway nor device, expected one of them: add it.")


def _choose_device(fields: Suboptions, gateway: str, where: str, interfaces: Interfaces, links: Links) -> str:
    """The interface of an item: that of its device, else the one whose network holds the gateway."""
    device = fields["device"] or ""
    if device and device not in interfaces:
        raise Problem(
            f"{where}: there is no interface {device}, expected one of {_list_names(interfaces)}: correct device."
        )
    if fields["on_link"] and not (gateway and device):
        raise Problem(f"{where}: on_link needs gateway and device: add them, or remove on_link.")
    if fields["type"] not in NO_WAY and not device:
        device = _find_device(gateway, where, interfaces, links)
    return device


def _find_device(gateway: str, where: str, interfaces: Interfaces, links: Links) -> str:
    """The interface whose connected network holds the gateway. The smallest such network decides."""
    address = ipaddress.ip_address(gateway)
    if address.is_link_local:
        raise Problem(f"{where}: the gateway {gateway} is link-local, so every interface could be meant: add device.")
    names_by_prefix: typing.Dict[int, typing.Set[str]] = {}
    for name, link in interfaces.items():
        for own in link.networks:
            if not link.loopback and address in own.network:
                names_by_prefix.setdefault(own.network.prefixlen, set()).add(name)
    for route in () if names_by_prefix else links(address.version):
        network = ipaddress.ip_network(route.destination)
        if route.device in interfaces and _is_near(route, route.device) and address in network:
            names_by_prefix.setdefault(network.prefixlen, set()).add(route.device)
    if not names_by_prefix:
        raise Problem(
            f"{where}: no interface has a network with the gateway {gateway} (found {_list_addresses(interfaces)}), expected one: "
            "correct the gateway, or bring the interface up with an address there."
        )
    nearest = names_by_prefix[max(names_by_prefix)]
    if len(nearest) > 1:
        raise Problem(f"{where}: the gateway {gateway} is behind {_list_names(nearest)}: say which in device.")
    return nearest.pop()


def _check_number(option: str, value: int, least: int, where: str) -> None:
    is_table = option == "table"
    if not least <= value <= _LARGEST or (is_table and value == _LOCAL):
        but = " other than 255" if is_table else ""
        raise Problem(f"{where}: found the {option} {value}, expected a number from {least} to {_LARGEST}{but}.")


# From routes to the interfaces as they are now


def check_usable(
    items: typing.List[RouteRequest], interfaces: Interfaces, kernel_routes: typing.Iterable[RouteSpec]
) -> None:
    """Raises Problem for a route that the kernel would refuse now. `kernel_routes`: the kernel's routes."""
    own = {str(address.ip) for link in interfaces.values() for address in link.networks}
    wanted = [item.route for item in items]
    routes = wanted + list(kernel_routes)
    for route in wanted:
        _check_ends(route, interfaces, own)
        if route.gateway and not route.on_link:
            _check_gateway(route, interfaces, own, routes)


def _check_ends(route: RouteSpec, interfaces: Interfaces, own: typing.Set[str]) -> None:
    """The interface must be up, and the source must be one of our own addresses."""
    where = f"routes: {format_route(route)}"
    if route.device and not interfaces[route.device].up:
        raise Problem(f"{where}: the interface {route.device} is down, expected it up: bring it up first.")
    if route.source and route.source not in own:
        raise Problem(
            f"{where}: the source {route.source} is no address of this computer (found {_list_addresses(interfaces)}): correct it."
        )


def _check_gateway(
    route: RouteSpec, interfaces: Interfaces, own: typing.Set[str], routes: typing.Iterable[RouteSpec]
) -> None:
    """The gateway must be a different computer, in a network on the link."""
    where = f"routes: {format_route(route)}"
    if route.gateway in own:
        raise Problem(
            f"{where}: the gateway is an address of this computer itself, expected the address of another one: correct it."
        )
    link = interfaces[route.device]
    gateway = ipaddress.ip_address(route.gateway)
    broadcasts = [
        own.network.broadcast_address for own in link.networks if own.version == 4 and own.network.prefixlen < 31
    ]
    if gateway.is_multicast or gateway in broadcasts:
        raise Problem(
            f"{where}: the gateway is the address of many computers (broadcast or multicast), expected that of one: correct it."
        )
    near = [address.network for address in link.networks]
    near += [ipaddress.ip_network(other.destination) for other in routes if _is_near(other, route.device)]
    if not gateway.is_link_local and not any(gateway in network for network in near):
        raise Problem(
            f"{where}: the gateway is not in a network of {route.device} (found {_list_addresses({route.device: link})}): correct "
            "gateway or device, or set on_link if it is on that link all the same."
        )


def _is_near(route: RouteSpec, device: str) -> bool:
    """True if the destination of the route is on the link of the device."""
    return route.device == device and not route.gateway and route.destination not in DEFAULTS.values()


def _list_names(interfaces: typing.Iterable[str]) -> str:
    return ", ".join(map(quote, sorted(interfaces))) or "none"


def _list_addresses(interfaces: Interfaces) -> str:
    texts = [
        f"{quote(name)} {own}"
        for name, link in sorted(interfaces.items())
        for own in link.networks
        if not link.loopback and not own.is_link_local
    ]
    return ", ".join(texts) or "no address"
