# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Multicast routing of a fleet: its gateways pass the group on, unless no router does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from ..._inventory.heartbeats import LOCAL_GROUPS
from ..._inventory.hooks import InventoryHooks
from ..._inventory.model import Fleet, Inventory
from .variables import RoutingVariables


def have_routed(fleet: Fleet, inventory: Inventory) -> Fleet:
    """Return the fleet with the program that passes the group on at its gateways."""
    return replace(fleet, multicast_routing=RoutingVariables.read(fleet.variables).multicast_routing)


def find_local_group(fleet: Fleet) -> Iterator[str]:
    """Yield a sentence for a group that no router passes on."""
    group = fleet.variables.multicast_group
    if fleet.multicast_routing == "smcroute" and group in LOCAL_GROUPS:
        yield (
            f"multimaster_multicast_group is {group}, which no router passes on (RFC 5771, 224.0.0.0/24), and "
            "multimaster_multicast_routing is 'smcroute'; expected a group outside 224.0.0.0/24: set it in group_vars/robots.yml, "
            "for example 239.255.0.1."
        )


HOOKS = InventoryHooks(change_fleet=have_routed, find_contradictions=find_local_group)
