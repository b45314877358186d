# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The values that the plan and the answers of the computers give to the words of an advice, so that its commands can be pasted. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from ..._base import advice
from ..._plan.model import COMMON
from ..components.component import Component
from .check_context import FleetState


def name_values(component: Component, state: FleetState) -> Mapping[str, str]:
    """Return the known values, by the words of `_faults.fault.UNREAD`; an advice keeps the placeholder of a word that is left out."""
    found: Mapping[str, str] = _name_members(component.place, state)
    if component.place in state.run:
        group = str(state.fleet.multicast_group)
        found = {**_name_neighbour(component, state), "beyond": _find_beyond(component, state), "group": group}
    return {word: text for word, text in found.items() if text}


def _name_neighbour(component: Component, state: FleetState) -> Mapping[str, str]:
    """Name the address of a computer, and another computer of its network with the interface there. Alone, its own interface."""
    own = state.run[component.place]
    network = state.ways.network_of(own.name)
    values = {
        "address": str(own.plan.address),
        "device": _find_device(component.place, component.what or network, state),
    }
    if (component.kind, component.mode) != ("interface", "duplicate"):
        return values
    others = (name for name in state.run if name != own.name and state.ways.is_in(name, network))
    seen = ((name, _find_device(name, network, state)) for name in others)
    return {
        **values,
        **next(({"neighbour": name, "device": device} for name, device in seen if device), {"device": ""}),
    }


def _find_device(name: str, network: str, state: FleetState) -> str:
    interface = state.run[name].interface_on.get(network)
    return advice.format_value("device", interface.interface) if interface else ""


def _find_beyond(component: Component, state: FleetState) -> str:
    """Find the address of a computer in the network to which packets go; that of any other robot if the network is not known."""
    robot = state.ways.robot_of(component.place)
    network = component.what if component.kind == "route" else ""
    return next(
        (
            state.ways.addresses[name]
            for name in state.ways.members
            if state.ways.robot_of(name) != robot and network in ("", state.ways.network_of(name))
        ),
        "",
    )


def _name_members(network: str, state: FleetState) -> Mapping[str, str]:
    """Name a computer in a network, and the address there of another one."""
    names = [name for name in state.ways.members if state.ways.is_in(name, network)]
    if not names:
        return {}
    addresses = state.ways.discovery_addresses if network == COMMON else state.ways.addresses
    return {"there": names[0], "other": addresses[names[1]] if len(names) > 1 else ""}
