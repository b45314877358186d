# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A fleet that is not there: its inventory, its plan, and the answers of its computers, which the connection `recorded` gives.

A robot has a gateway, which runs its roscore, and three computers behind it. All have the packet filter of the fleet. The answers
are those of a fleet in which everything works: `machine.json` is the machine of a real computer, and the observations are made
of the plan.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import fleets
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import read_fleet
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import ComputerPlan, FleetPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.pairs import AUTO, choose_pairs
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.registrations import Flows

MACHINE = Path(__file__).with_name("machine.json")
NOTHING = {"changed": False, "unconfirmed": False, "same_connection": False, "concerns": {}, "diff": []}
FILTERED = {"changed": False, "backend": "nftables", "members": [], "networks": [], "guards": []}


def make_inventory(computers: int, answers: Path) -> dict[str, Any]:
    """Make the inventory of Ansible. `answers` is the folder with the answers of each computer."""
    fleet = fleets.behind_gateways(computers)
    shared = {
        "ansible_connection": "recorded",
        "ansible_user": "root",
        "ansible_python_interpreter": "/usr/bin/python3",
        "recorded_answers": str(answers),
    }
    robots = {
        robot: {"hosts": {name: fleet.variables[name] for name in names}} for robot, names in fleet.robots.items()
    }
    return {"robots": {"children": robots, "vars": shared}}


def make_plan(computers: int) -> FleetPlan:
    """Make the plan of the same fleet, by the functions behind the action fleet_plan, which sorts robots: the sample has their order."""
    fleet = fleets.behind_gateways(computers)
    return fleet_plan(read_fleet(replace(fleet, robots=dict(sorted(fleet.robots.items())))))


def list_answers(plan: FleetPlan) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each computer with its answers: by module, or by module and action."""
    tried = choose_pairs({member.name: str(member.network) for member in plan.members}, plan.computers, AUTO)
    flows = Flows(plan)
    for name, own in plan.computers.items():
        machine = _describe_machine(plan, own)
        started = {
            "changed": False,
            "machine": machine,
            "multicast": {},
            "talker": {"running": True},
            "msg": "A talker runs.",
        }
        yield (
            name,
            {
                "multimaster_info": machine,
                "multimaster_computer": {**NOTHING, "msg": "All is as planned."},
                "firewall": {**FILTERED, "msg": "The rules of nftables were right."},
                "multimaster_verify start": started,
                "multimaster_verify collect": _describe_view(plan, own, tried[name], flows),
            },
        )


def _describe_machine(plan: FleetPlan, own: ComputerPlan) -> dict[str, Any]:
    """Return the answer of multimaster_info on a computer that is as planned."""
    text = MACHINE.read_text(encoding="utf-8")
    master = plan.master_of[own.robot].computer
    address = own.common_address or own.address
    for word, value in (("@ADDRESS@", str(address)), ("@NAME@", own.computer), ("@MASTER@", master)):
        text = text.replace(word, value)
    found: dict[str, Any] = json.loads(text)
    loopback, ethernet = found["interfaces"]
    interfaces = [
        {
            **ethernet,
            "name": f"eth{number}",
            "addresses": [{"address": str(entry.address), "prefix": entry.network.prefixlen, "family": "inet"}],
        }
        for number, entry in enumerate(own.networks)
    ]
    ports = found["ports"] if own.is_master else []
    return {
        **found,
        "interfaces": [loopback, *interfaces],
        "ports": ports,
        "filters": {"readable": True, "chains": [], "arp": []},
    }


def _describe_view(plan: FleetPlan, own: ComputerPlan, tried: Collection[str], flows: Flows) -> dict[str, Any]:
    """Return the measurements of a computer that has tried these others."""
    me = next(member for member in plan.members if member.name == own.computer)
    members = tuple(member for member in plan.members if member.name in tried or member is me)
    probe = _make_plain(fleets.good_probe(replace(plan, members=members), me, own))
    probe["topics"] = [_make_plain(topic) for topic in fleets.heard_topics(plan, me, flows) if topic.computer in tried]
    if own.is_master:  # its roscore has what all talkers give, also those that it does not try
        probe.update(
            exchange=_make_plain(fleets.exchange(plan, own.robot)), sources=[_make_plain(fleets.own_source(plan, own))]
        )
    multicast = _make_plain(fleets.good_multicast(plan, me, own)) if me.discovery else {}  # all hear the group
    return {"changed": False, "msg": "Measured.", **probe, "multicast": multicast}


def _make_plain(record: Any) -> Any:
    """Return a record as a module returns it, where nothing is null."""
    return to_plain(asdict(record))
