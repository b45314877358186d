# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A bundle of what a run has registered, and what the report says about one. Pure: Ansible's variables and plain data."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._bundle.bundle import Bundle
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._case.pairs import ALL, AUTO
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._checks.engine import Verification
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._data.plain import from_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.plain_text import LINE, quoted
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._judgement.judged import Judged, judge
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._observed.gathered import (
    KEY,
    observation,
    planned_names,
    registered,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import FleetPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._report import content

OPTIONS = (
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


def gathered(
    given: Mapping[str, Any], hostvars: Mapping[str, Any], hosts: Collection[str], about: Mapping[str, str]
) -> Bundle:
    """Read what the tasks of a run registered; `given` are the OPTIONS of an action. Raises Mismatch."""
    fleet = from_plain(FleetPlan, given.get("fleet"))
    names = {option: given.get(option) or "" for option in (*OPTIONS, "logs")}
    planned = planned_names(fleet)
    seen = {
        host: observation(
            hostvars[host],
            names["multicast"],
            names["probe"],
            names["earlier"],
            names["packet_filter"],
            names["plan"],
            names["streams"],
            names["machine"],
            planned,
        )
        for host in fleet.computers
        if host in hosts
    }
    infos = {host: registered(hostvars[host], names["machine"]) for host in seen}
    logs = {host: _lines(registered(hostvars[host], names["logs"])) for host in seen} if names["logs"] else {}
    machines = content.machines(fleet, seen, infos)
    asked = {"pairs": names["pairs"] or ALL, "least_mbit_s": str(names["least_mbit_s"] or 0)}
    return Bundle(fleet, seen, machines, {**about, **asked}, logs)


def _lines(result: Mapping[str, Any]) -> str:
    """Return the logs of a computer as one text."""
    parts = [f"problem: {quoted(problem, LINE)}" for problem in result.get("problems") or []]
    if result.get("msg") and not result.get("logs"):
        parts.append(f"problem: {quoted(result['msg'], 500)}")
    for service, lines in dict(result.get("logs") or {}).items():
        parts += [f"== {service if KEY.fullmatch(service) else quoted(service)}"]
        parts += [quoted(line, LINE) for line in lines] if isinstance(lines, list) else []
    return "".join(f"{part}\n" for part in parts)


def verdict(bundle: Bundle, pages: bool, everything: bool) -> Judged:
    """Judge what is in a bundle."""
    pairs = AUTO if bundle.about.get("pairs") == AUTO else ALL
    least = float(bundle.about.get("least_mbit_s") or 0)
    return judge(Verification(CHECKS, bundle.fleet, bundle.observations, pairs, least), pages, everything)


def document(bundle: Bundle, judged: Judged) -> dict[str, Any]:
    """Return all that the report says, as data."""
    return {
        **judged.document(),
        "time": bundle.about.get("time", ""),
        "collection": bundle.about.get("collection", ""),
        "ansible": bundle.about.get("ansible", ""),
        "durations": bundle.about.get("durations", ""),
        "robots": content.robots(bundle.fleet, bundle.observations),
        "throughput": content.throughput(bundle.observations),
        "machines": {name: {**content.NOTHING, **bundle.machines.get(name, {})} for name in bundle.observations},
    }
