# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The plans of the shipped inventories, as Ansible reads them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from ansible.inventory.manager import InventoryManager
from ansible.parsing.dataloader import DataLoader
from ansible.template import Templar
from ansible.vars.manager import VariableManager
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.model import Inventory
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import read_fleet
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import ComputerPlan, FleetPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan

ROOT = Path(__file__).resolve().parents[2]


@cache
def read_plan(name: str) -> FleetPlan:
    """Return the plan of inventory/`name`."""
    return plan_with(name, {})


def plan_with(name: str, more: Mapping[str, Mapping[str, Any]]) -> FleetPlan:
    """Return the plan of inventory/`name` with more variables of robots."""
    loader = DataLoader()
    inventory = InventoryManager(loader=loader, sources=[str(ROOT / "inventory" / name)])
    manager = VariableManager(loader=loader, inventory=inventory)
    robots = {group.name: [host.name for host in group.hosts] for group in inventory.groups["robots"].child_groups}
    routers = [host.name for host in inventory.groups["routers"].hosts] if "routers" in inventory.groups else []
    hosts = {}
    for host in inventory.get_hosts():
        variables = manager.get_vars(host=host)
        templar = Templar(loader=loader, variables=variables)
        own = {key: value for key, value in variables.items() if key.startswith("multimaster_")}
        hosts[host.name] = {key: templar.template(value) for key, value in own.items()}
    for robot, variables in more.items():
        for computer in robots[robot]:
            hosts[computer].update(variables)
    return fleet_plan(read_fleet(Inventory(robots=robots, variables=hosts, routers=routers)))


def find_master(fleet: FleetPlan, robot: str) -> ComputerPlan:
    """Return the computer of a robot that has its discovery and sync."""
    return fleet.computers[fleet.master_of[robot].computer]
