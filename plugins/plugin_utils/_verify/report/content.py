# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The parts of the document, as plain data: results, findings, robots with their registrations, streams, computers. Pure."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from typing import Any

from ..._base.plain import to_plain
from ..._faults.fault import list_advices, write_advices
from ..._inventory.filters import matches
from ..._inventory.flows import find_outer_name, list_names
from ..._plan.model import FleetPlan
from ..checks.engine import VERDICTS
from ..checks.table import CHECKS
from ..context.registrations import RELAY, TEST_NODES
from ..diagnose.diagnosis import Diagnosis
from ..observe.observations import Exchange, Import, Observation, Probe, SentTopic
from ..observe.uris import normalise_uri
from .summary import Summary

OWN_TOPICS = "/multimaster_verify/"  # of the verification itself
MOST = 2000  # names of a robot that are kept
#: a computer of which nothing is known
MACHINE = dict.fromkeys(("system", "kernel", "python", "ros", "provider", "list_masters", "topics"), "")
PRIVATE = ("/get_loggers", "/set_logger_level")  # services that every node has


def list_checks(summary: Summary) -> list[dict[str, Any]]:
    """List the checks of this run with the number of rows of each verdict."""
    counts = summary.counts
    return [
        {"check": check.id, "title": check.title, **{verdict: counts[check.id][verdict] for verdict in VERDICTS}}
        for check in CHECKS
        if check.id in counts
    ]


def list_findings(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """List the findings with their rows."""
    return [
        {
            "id": entry.component.fault.id,
            "page": entry.component.fault.page,
            "kind": entry.component.kind,
            "place": entry.component.place_text,
            "mode": entry.component.mode,
            "what": entry.subjects,
            "verdict": entry.verdict,
            "sentence": entry.sentence(),
            "do": list_advices(entry.do),
            "look": list_advices(entry.look),
            "remedy": write_advices(entry.do or entry.look),
            "decide": write_advices(entry.look or entry.do),  # until version 2.0.0
            "sure": entry.sure,
            "followed": [end.words for end in entry.followed],
            "ways": [to_plain(end.way) for end in entry.followed],
            "since": entry.since,
            "rivals": [
                {
                    "id": component.fault.id,
                    "kind": component.kind,
                    "place": component.place_text,
                    "mode": component.mode,
                    "sentence": component.sentence(),
                }
                for component in entry.rivals
            ],
            "because": to_plain(entry.because) if entry.because else {},
            "seen": [row._asdict() for row in entry.proof],
            "follows": [row._asdict() for row in entry.rows],
        }
        for entry in diagnosis.findings
    ]


def list_robots(fleet: FleetPlan, observations: Mapping[str, Observation]) -> list[dict[str, Any]]:
    """List the robots: computers, own topics and services, and imported ones."""
    by_uri = {normalise_uri(uri): robot for robot, uris in fleet.master_uris.items() for uri in uris}
    robots = []
    for robot, master in fleet.master_of.items():
        seen = observations.get(master.computer)
        exchange = seen.probe.exchange if seen and seen.probe and not seen.probe.exchange.error else None
        channels = (fleet.computers[master.computer].relay or {}).get("channels", ())
        robots.append(
            {
                "robot": robot,
                "master": master.computer,
                "computers": [name for name, plan in fleet.computers.items() if plan.robot == robot],
                "declares": master.declared,
                "gives": [
                    *_list_flows(fleet, robot, channels),
                    *(
                        {"to": [entry["peer"]], **names, "changed": _describe_changes(entry)}
                        for entry in channels
                        if any((names := _name_crossing(entry, given=True)).values())
                    ),
                ],
                "read": exchange is not None,
                **_list_registrations(exchange, by_uri, channels),
            }
        )
    return robots


def _list_flows(fleet: FleetPlan, robot: str, channels: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """List what a robot declares for others, without what its relay gives to all of them by another name: that has a row of its own."""
    renamed: dict[str, set[str]] = defaultdict(set)
    for channel in channels:
        renamed[channel["peer"]].update(_name_own(channel))
    rows = []
    for flow in (flow for flow in fleet.flows if robot in flow.givers):
        by_relay = set[str].intersection(*(renamed[peer] for peer in flow.to)) if flow.to else set()
        topics = [name for name in flow.topics if name not in by_relay]
        services = [name for name in flow.services if name not in by_relay]
        if topics or services or flow.parameters:
            row = {"to": list(flow.to), "topics": topics, "services": services}
            rows.append({**row, "parameters": list(flow.parameters)} if flow.parameters else row)
    return rows


def _name_own(channel: Mapping[str, Any]) -> set[str]:
    """Name what a relay gives as its own robot has it."""
    names = (name for kind in ("topics", "services") for name in list_names(channel, kind, given=True))
    return {name if channel["inner"] else find_outer_name(channel, name) for name in names}


def _name_crossing(channel: Mapping[str, Any], *, given: bool) -> dict[str, list[str]]:
    """Name the topics that the robot of a relay gives, or takes, as the receiving robot names them."""
    return {
        kind: [
            find_outer_name(channel, name) if channel["inner"] == given else name
            for name in list_names(channel, kind, given=given)
        ]
        for kind in ("topics", "services")
    }


def _describe_changes(channel: Mapping[str, Any]) -> dict[str, str]:
    """Return for each topic and service that a relay gives by another name or at a rate its own name, and the rate."""
    rate = f"at {channel['rate']:g} messages/s" if channel.get("rate") else ""
    newest = "only the newest" if channel.get("newest") else ""
    described = {}
    for kind in ("topics", "services"):
        for name in list_names(channel, kind, given=True):
            other = find_outer_name(channel, name)
            own, shown = (name, other) if channel["inner"] else (other, name)
            words = [f"here {own}" if own != shown else "", *((rate, newest) if kind == "topics" else ())]
            if text := ", ".join(filter(None, words)):
                described[shown] = text
    return described


def _list_registrations(
    exchange: Exchange | None, by_uri: Mapping[str, str], channels: Iterable[Mapping[str, Any]]
) -> dict[str, Any]:
    if exchange is None:
        return {"topics": [], "services": [], "takes": []}
    takes = [
        {"robot": by_uri.get(normalise_uri(entry.master), entry.master), **_name_registrations(entry)}
        for entry in exchange.imports
    ]
    takes += [_list_crossed(exchange, channel) for channel in channels]
    return {**_name_registrations(exchange), "takes": takes}


def _name_registrations(component: Exchange | Import) -> dict[str, list[str]]:
    """Name the published topics and the services, by own nodes or by nodes of another master."""
    return {
        "topics": _clean_names(topic.name for topic in component.topics if _has_publisher(topic.publishers)),
        "services": _clean_names(service.name for service in component.services),
    }


def _list_crossed(exchange: Exchange, channel: Mapping[str, Any]) -> dict[str, Any]:
    """List the topics and services that a relay has of another robot."""
    names = _name_crossing(channel, given=False)
    topics = (topic.name for topic in exchange.topics if RELAY in topic.publishers)
    services = (service.name for service in exchange.services if service.node == RELAY)
    return {
        "robot": channel["peer"],
        "topics": _clean_names(name for name in topics if matches(names["topics"], name)),
        "services": _clean_names(name for name in services if matches(names["services"], name)),
    }


def _has_publisher(nodes: Iterable[str]) -> bool:
    """Return True if a node publishes that is not of the verification itself."""
    return any(not node.startswith(TEST_NODES) for node in nodes)


def _clean_names(names: Iterable[str]) -> list[str]:
    """Return the names without those of the verification, and without services that every node has."""
    own = {name for name in names if OWN_TOPICS not in name and TEST_NODES not in name}
    return sorted(name for name in own if not name.endswith(PRIVATE))[:MOST]


def list_streams(observations: Mapping[str, Observation]) -> list[dict[str, Any]]:
    """List the throughput between computers, in Mbit/s."""
    return [
        {"from": name, "to": stream.computer, "mbit_s": stream.mbit_s}
        for name, seen in observations.items()
        for stream in (seen.streams.streams if seen.streams else ())
        if stream.mbit_s is not None
    ]


def list_remarks(observations: Mapping[str, Observation]) -> list[str]:
    """List the warnings of preflight, as Ansible shows it during the run: sentences, once each."""
    remarks = (text for seen in observations.values() if seen.found is not None for text in seen.found.warned)
    return list(islice(dict.fromkeys(remarks), MOST))


def list_traffic(fleet: FleetPlan, observations: Mapping[str, Observation]) -> dict[str, Any]:
    """List the topics that robots send to each other, the dearest first. Bytes and messages are summed over all connections."""
    flows: dict[tuple[str, str], list[SentTopic]] = defaultdict(list)
    seconds = 0.0
    for robot, master in fleet.master_of.items():
        traffic = (observations.get(master.computer, Observation()).probe or Probe()).traffic
        seconds = max(seconds, traffic.seconds)
        for flow in traffic.flows:
            if flow.robot in fleet.master_of:
                flows[robot, flow.topic].append(flow)

    def rank(item: tuple[tuple[str, str], list[SentTopic]]) -> tuple[float, str, str]:
        (robot, topic), group = item
        return -sum(flow.bytes_s for flow in group), topic, robot

    order = sorted(flows.items(), key=rank)[:MOST]
    return {"seconds": seconds, "topics": [_sum_flows(robot, topic, group) for (robot, topic), group in order]}


def _sum_flows(robot: str, topic: str, flows: Sequence[SentTopic]) -> dict[str, Any]:
    """Sum the traffic of a robot's nodes on a topic to all others."""
    to = Counter[str]()
    for flow in flows:
        to[flow.robot] += flow.subscribers
    return {
        "topic": topic,
        "from": robot,
        "nodes": sorted({flow.node for flow in flows}),
        "to": dict(sorted(to.items())),
        "messages_s": round(sum((flow.messages_s for flow in flows), 0.0), 1),
        "bytes_s": round(sum((flow.bytes_s for flow in flows), 0.0), 1),
    }


def describe_machines(
    fleet: FleetPlan, observations: Mapping[str, Observation], infos: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, str]]:
    """Return system, ROS, nodes and times of each computer of the run. `infos` has the results of multimaster_info."""
    machines = {}
    for name, seen in observations.items():
        probe, info = seen.probe or Probe(), infos.get(name, {})
        topics = [topic.seconds for topic in probe.topics if topic.seconds is not None]
        seconds = 0.0 if probe.list_masters.error else probe.list_masters.seconds
        machines[name] = {
            "system": _text(info, "os", "name"),
            "kernel": _text(info, "kernel"),
            "python": _text(info, "python"),
            "ros": _text(info, "ros", "chosen", "distro"),
            "provider": "" if fleet.computers[name].is_router else fleet.computers[name].provider,
            "list_masters": f"{seconds:.2f} s" if seconds else "",
            "topics": f"{max(topics):.2f} s" if topics else "",
        }
    return machines


def _text(info: Any, *keys: str) -> str:
    """Return the text at a path of keys; empty if the document has no text there."""
    for key in keys:
        info = info.get(key) if isinstance(info, Mapping) else None
    return info if isinstance(info, str) else ""
