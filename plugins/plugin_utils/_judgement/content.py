# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The declarations of the robots, the registrations that were found, and what ran on each computer. Pure: plain data out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._case.exchange import TEST_NODES
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._observed.observations import Exchange, Observation
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._observed.uris import normalise_uri
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import FleetPlan

OWN_TOPICS = "/multimaster_verify/"  # of the verification itself
MOST = 2000  # names of a robot that are kept
NOTHING = dict.fromkeys(("system", "kernel", "python", "ros", "provider", "list_masters", "topics"), "")  # of a machine
PRIVATE = ("/get_loggers", "/set_logger_level")  # services that every node has


def robots(fleet: FleetPlan, observations: Mapping[str, Observation]) -> list[dict[str, Any]]:
    """List the robots with their computers, what they provide, and what they hold of others."""
    by_uri = {normalise_uri(master.uri): master.robot for master in fleet.masters}
    found = []
    for robot, master in fleet.master_of.items():
        seen = observations.get(master.computer)
        exchange = seen.probe.exchange if seen and seen.probe and not seen.probe.exchange.error else None
        found.append(
            {
                "robot": robot,
                "master": master.computer,
                "computers": [name for name, plan in fleet.computers.items() if plan.robot == robot],
                "declares": master.declared,
                "gives": [
                    {"to": list(flow.to), "topics": list(flow.topics), "services": list(flow.services)}
                    for flow in fleet.flows
                    if robot in flow.givers
                ],
                "read": exchange is not None,
                **_registered(exchange, by_uri),
            }
        )
    return found


def _registered(exchange: Exchange | None, by_uri: Mapping[str, str]) -> dict[str, Any]:
    if exchange is None:
        return {"topics": [], "services": [], "takes": []}
    takes = [
        {
            "robot": by_uri.get(normalise_uri(entry.master), entry.master),
            "topics": _names(topic.name for topic in entry.topics if _others(topic.publishers)),
            "services": _names(service.name for service in entry.services),
        }
        for entry in exchange.imports
    ]
    return {
        "topics": _names(topic.name for topic in exchange.topics if _others(topic.publishers)),
        "services": _names(service.name for service in exchange.services),
        "takes": takes,
    }


def _others(nodes: Iterable[str]) -> bool:
    """True where a node has it that is none of the verification."""
    return any(not node.startswith(TEST_NODES) for node in nodes)


def _names(names: Iterable[str]) -> list[str]:
    mine = {name for name in names if not name.startswith(OWN_TOPICS) and TEST_NODES not in name}
    return sorted(name for name in mine if not name.endswith(PRIVATE))[:MOST]


def throughput(observations: Mapping[str, Observation]) -> list[dict[str, Any]]:
    """List what was measured between computers, in Mbit/s."""
    return [
        {"from": name, "to": stream.computer, "mbit_s": stream.mbit_s}
        for name, seen in observations.items()
        for stream in (seen.streams.streams if seen.streams else ())
        if stream.mbit_s is not None
    ]


def machines(
    fleet: FleetPlan, observations: Mapping[str, Observation], infos: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, str]]:
    """Name system, ROS and nodes of each computer of the run, and how long it took; `infos` is of multimaster_info."""
    found = {}
    for name, seen in observations.items():
        probe, info = seen.probe, infos.get(name, {})
        topics = [topic.seconds for topic in probe.topics if topic.seconds is not None] if probe else []
        asked = probe.list_masters.seconds if probe and not probe.list_masters.error else 0.0
        found[name] = {
            "system": _text(info, "os", "name"),
            "kernel": _text(info, "kernel"),
            "python": _text(info, "python"),
            "ros": _text(info, "ros", "chosen", "distro"),
            "provider": "" if fleet.computers[name].is_router else fleet.computers[name].provider,
            "list_masters": f"{asked:.2f} s" if asked else "",
            "topics": f"{max(topics):.2f} s" if topics else "",
        }
    return found


def _text(info: Any, *keys: str) -> str:
    for key in keys:
        info = info.get(key) if isinstance(info, Mapping) else None
    return info if isinstance(info, str) else ""
