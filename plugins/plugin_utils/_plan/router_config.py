# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Configuration of routers and gateways of other makes: the way to the networks of the robots, in their dialects.

Section 4.2 of the report asks for the routes. Two more things of such a device keep robots from each other. It may
translate source addresses, but ROS nodes call back the address that they see. The router may send ICMP redirects, since
it sends packets back to the common network.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network
from typing import Any

from .dialects import DIALECTS, GATEWAY, MARK, PEERS, ROUTER, ROUTES, Block, Dialect
from .model import FleetPlan


class RouterConfigProblem(ValueError):
    """The request cannot be rendered. The text is one sentence."""


# A network of the fleet, by the names that templates use. One with a gateway is the destination of a route.
Network = Mapping[str, Any]


def describe_network(robot: str, network: IPv4Network, gateway: IPv4Address | None = None) -> Network:
    """Return a network of the fleet. The robot's name has the letters that every dialect takes."""
    return {
        "robot": re.sub(r"[^A-Za-z0-9_.-]", "_", robot) or "common network",
        "network": network,
        "gateway": gateway,
        "section": f"rosfleet_{re.sub('[./]', '_', str(network))}",
    }


@dataclass(frozen=True)
class Device:
    """A router or gateway of another make: its routes, and the networks that must see unchanged addresses."""

    folder: str  # of its files
    kind: str  # ROUTER or GATEWAY
    title: str
    own: IPv4Network  # the network behind it; the common network for the router
    routes: tuple[Network, ...]
    peers: tuple[Network, ...]  # networks that it must not translate addresses towards


def list_devices(plan: FleetPlan) -> list[Device]:
    """Return the router and every gateway outside the inventory. Nothing if no robot has a network of its own."""
    common = describe_network("", plan.common_network)
    networks = tuple(describe_network(entry.robot, entry.network, entry.common_address) for entry in plan.networks)
    if not networks:
        return []
    address = f" ({plan.router.address})" if plan.router else ""
    devices = [
        Device(
            folder=ROUTER,
            kind=ROUTER,
            title=f"the router of the common network {plan.common_network}{address}",
            own=plan.common_network,
            routes=networks,
            peers=networks,
        )
    ]
    for entry, network in zip(plan.networks, networks, strict=True):
        if entry.device:
            others = tuple(other for other in networks if other != network)
            devices.append(
                Device(
                    folder=f"{GATEWAY}-{network['robot']}",
                    kind=GATEWAY,
                    title=f"the gateway of {network['robot']} ({entry.gateway}, {entry.common_address})",
                    own=entry.network,
                    routes=others,
                    peers=(common, *others),
                )
            )
    return devices


def render_config(plan: FleetPlan, names: Sequence[str], interfaces: Mapping[str, Any] | None) -> list[dict[str, str]]:
    """Return the files of all devices in the dialects of these names: `path` below a folder of the caller's choice, and `content`.

    `interfaces` is device -> dialect -> interface of the common network, if it is not the maker's usual one. Raises
    RouterConfigProblem.
    """
    by_device = interfaces or {}
    devices = list_devices(plan)
    _check_names("router_config_dialects", names, DIALECTS)
    _check_names("router_config_interfaces", by_device, [device.folder for device in devices])
    for folder, by_dialect in by_device.items():
        _check_interfaces(f"router_config_interfaces.{folder}", by_dialect)
    return [
        {"path": f"{device.folder}/{file}", "content": content}
        for device in devices
        for name in names
        for file, content in _render_files(device, name, by_device.get(device.folder, {}).get(name, "")).items()
    ]


def _check_interfaces(variable: str, names: Any) -> None:
    """Check the interfaces of one device, by dialect. Raises RouterConfigProblem."""
    if not isinstance(names, Mapping):
        raise RouterConfigProblem(f"{variable} is {names!r}; expected a mapping such as {{openwrt: lan}}: correct it.")
    _check_names(variable, names, [name for name in DIALECTS if DIALECTS[name].interfaces])
    for dialect, name in names.items():
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_./:-]*", str(name)):
            raise RouterConfigProblem(
                f"{variable}.{dialect} is '{name}'; expected one word of letters, digits and ./:_-, such as "
                "GigabitEthernet0/1: correct it."
            )


def _check_names(variable: str, names: Iterable[str], expected: Iterable[str]) -> None:
    for name in names:
        if name not in expected:
            raise RouterConfigProblem(
                f"{variable} has '{name}', which is not known; expected some of {', '.join(expected) or 'none'}: correct it."
            )


def _render_files(device: Device, name: str, interface: str) -> dict[str, str]:
    """Return the file of a dialect for a device, and its way back."""
    dialect = DIALECTS[name]
    interface = interface or dialect.interfaces.get(device.kind, "")
    add, remove = f"{name}.{dialect.suffix}", f"{name}.remove.{dialect.suffix}"
    about = [
        f"{MARK}: the way to the networks of the robots, for {device.title}.",
        f"{dialect.title}. {dialect.use}",
        f"To take it back: {remove}. {dialect.again}",
        "",
        *(f"  {route['robot']}: {route['network']} by {route['gateway']}" for route in device.routes),
        "",
    ]
    if interface:
        about.append(f"The interface of the common network: {interface} (router_config_interfaces sets another).")
    if device.kind in dialect.notes:
        about += dialect.notes[device.kind].splitlines()
    about_remove = [f"{MARK}: takes {add} back, for {device.title}.", f"{dialect.title}. {dialect.use}"]
    return {
        add: _render_text(dialect, about, _render_lines(dialect.add, device, interface)),
        remove: _render_text(dialect, about_remove, _render_lines(dialect.remove, device, interface)),
    }


def _render_text(dialect: Dialect, about: Sequence[str], lines: Sequence[str]) -> str:
    first = ["#!/bin/sh"] if dialect.suffix == "sh" else []
    comment = [f"{dialect.comment}{line}".rstrip() for line in "\n".join(about).rstrip().split("\n")]
    return "\n".join([*first, *comment, *lines, ""])


def _render_lines(blocks: Sequence[Block], device: Device, interface: str) -> list[str]:
    shared = {"own": device.own, "interface": interface, "mark": MARK}
    repeated = {ROUTES: device.routes, PEERS: device.peers, "": ({},)}
    return [
        block.text.format(**shared, **fields)
        for block in blocks
        if device.kind in block.kinds
        for fields in repeated[block.each]
    ]
