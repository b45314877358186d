# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A run of the verification: the results that its tasks registered on the computers of a fleet. Pure: Ansible's variables in."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..._base.plain import from_plain
from ..._base.plain_text import LINE, quote
from ..._plan.model import FleetPlan
from ..checks.engine import UNKNOWN_INVENTORY as UNKNOWN
from ..checks.engine import InventorySource
from ..context.pairs import ALL
from ..observe.observations import Observation
from ..observe.task_results import KEY, Registered, find_result, list_plan_names, read_observation
from . import content

FIRST_LOOK = (
    "fleet",
    "multicast",
    "probe",
    "earlier",
    "packet_filter",
    "plan",
    "pairs",
    "machine",
    "streams",
    "least_mbit_s",
)
OPTIONS = (*FIRST_LOOK, "follow", "sent", "followed", "since_last_s")


@dataclass(frozen=True)
class Run:
    """The results about a fleet. `about` has the time and the versions of the controller, `machines` those of each computer."""

    fleet: FleetPlan
    observations: Mapping[str, Observation]
    machines: Mapping[str, Mapping[str, str]]
    about: Mapping[str, str]
    logs: Mapping[str, str] = field(default_factory=dict)
    inventory: InventorySource = UNKNOWN  # of the person who runs it, for the advice; no bundle has it


def gather_run(
    options: Mapping[str, Any], hostvars: Mapping[str, Any], hosts: Collection[str], about: Mapping[str, str]
) -> Run:
    """Read the registered results. `options` are the OPTIONS of an action: names of variables. Raises Mismatch."""
    fleet = from_plain(FleetPlan, options.get("fleet"))
    names = {option: options.get(option) or "" for option in (*OPTIONS, "logs")}
    planned_names = list_plan_names(fleet)
    registered = {host: Registered(hostvars, host) for host in fleet.computers if host in hosts}
    observations = {host: read_observation(host, of_it, names, planned_names) for host, of_it in registered.items()}
    infos = {host: find_result(of_it, names["machine"]) for host, of_it in registered.items()}
    logs = (
        {host: _lines(find_result(of_it, names["logs"])) for host, of_it in registered.items()} if names["logs"] else {}
    )
    machines = content.describe_machines(fleet, observations, infos)
    numbers = {option: str(names[option] or 0) for option in ("least_mbit_s", "since_last_s")}
    choices = {"pairs": names["pairs"] or ALL, **numbers}
    return Run(fleet, observations, machines, {**about, **choices}, logs)


def _lines(result: Mapping[str, Any]) -> str:
    """Return the logs of a computer as one text."""
    parts = [f"problem: {quote(problem, LINE)}" for problem in result.get("problems") or []]
    if result.get("msg") and not result.get("logs"):
        parts.append(f"problem: {quote(result['msg'], 500)}")
    for service, lines in dict(result.get("logs") or {}).items():
        parts += [f"== {service if KEY.fullmatch(service) else quote(service)}"]
        parts += [quote(line, LINE) for line in lines] if isinstance(lines, list) else []
    return "".join(f"{part}\n" for part in parts)
