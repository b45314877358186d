# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Multicast routing in the plan of a gateway, and the sentence of preflight if a machine cannot have it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from ..._base.plain_text import quote
from ..._inventory.model import Computer, Fleet, Robot
from ..._plan.hooks import PlanHooks
from ..._plan.model import ComputerPlan
from ..._plan.plan import list_behind
from ..._plan.preflight import find_interfaces
from .model import MulticastRouting


def make_routing(fleet: Fleet, robot: Robot, computer: Computer) -> MulticastRouting | None:
    """Return the multicast routing of a gateway between the robot's network and the common network."""
    if fleet.multicast_routing == "none" or computer.common_address is None or not list_behind(robot, computer):
        return None
    return MulticastRouting(fleet.variables.multicast_group, (computer.address, computer.common_address))


def find_routing_problems(plan: ComputerPlan, info: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for a machine without two interfaces or smcrouted, and for another program that passes multicast on."""
    planned = MulticastRouting.find(plan)
    if planned is None:
        return
    interfaces, routing = find_interfaces(plan, info)[0], info["multicast_routing"]
    inner, common = (interfaces[address] for address in planned.addresses)
    if inner and inner == common:
        yield (
            f"{plan.computer}: multimaster_multicast_routing is 'smcroute', but both its addresses are on {quote(inner)}; expected an interface "
            "for each network, since multicast is passed on between interfaces: give the common network its own, or set "
            "multimaster_multicast_routing to 'none'."
        )
    elif not routing["smcrouted"]:
        yield (
            f"{plan.computer}: multimaster_multicast_routing is 'smcroute', but there is no smcrouted; expected it on a gateway: install "
            "it (apt-get install smcroute)."
        )
    elif routing["others"]:
        yield (
            f"{plan.computer}: {', '.join(map(quote, routing['others']))} passes multicast on already, and the kernel takes one program for that; "
            "expected none but the collection's: stop it for good (systemctl disable --now smcroute.service smcroute-helper.service, "
            "if it is Debian's smcroute), or set multimaster_multicast_routing to 'none'."
        )


def add_interfaces(plan: ComputerPlan, planned: MulticastRouting, info: Mapping[str, Any]) -> MulticastRouting:
    """Return the multicast routing with the names of the interfaces."""
    interfaces = find_interfaces(plan, info)[0]
    return replace(planned, interfaces=tuple(interfaces[address] for address in planned.addresses))


HOOKS = PlanHooks(
    make_part=make_routing,
    list_facts=lambda fleet: ("multicast_routing",),
    find_problems=find_routing_problems,
    fill=add_interfaces,
)
