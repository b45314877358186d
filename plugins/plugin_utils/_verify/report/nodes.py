# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The nodes of people: how many there are at each roscore, and a row for each with which something is wrong. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from ..._base.sentences import shorten_list
from ..._plan.model import FleetPlan
from ..context.announcements import Misplaced, find_misplaced, find_strays
from ..context.registrations import COLLECTION, TEST_NODES
from ..context.ways import Ways
from ..observe.observations import Exchange, NodeHost, Observation, Probe, SilentNode
from ..observe.outcomes import Outcome

HEADINGS = ("node", "computer", "announces", "started by", "at the roscore of", "answers", "refused by")
ROWS = 20  # nodes on a terminal
MOST = 500  # that are kept
NAMED = 4  # robots in a cell

Row = dict[str, Any]


def list_nodes(fleet: FleetPlan, observations: Mapping[str, Observation]) -> dict[str, Any]:
    """List the numbers of nodes at each roscore that was read, and the nodes with which something is wrong."""
    probes = {name: seen.probe for name, seen in observations.items() if seen.probe is not None}
    ways = Ways(fleet)
    misplaced = find_misplaced(fleet, probes)
    roscores, odd = [], list[Row]()
    for robot, master in fleet.master_of.items():
        probe = probes.get(master.computer)
        if probe is None or probe.roscore.error or probe.exchange.error:
            continue
        roscores.append(_count_nodes(robot, probe, ways))
        odd += _list_odd(robot, probe, misplaced.get(robot, {}), ways)
    strays = find_strays(fleet, probes, misplaced)
    odd += [_make_stray_row(one) for nodes in strays.values() for one in nodes]
    return {"roscores": roscores, "odd": odd[:MOST], "left_out": max(0, len(odd) - MOST)}


def _count_nodes(robot: str, probe: Probe, ways: Ways) -> Row:
    """Count the nodes of a roscore by computer; a host that the plan does not have counts as itself."""
    nodes = probe.exchange.nodes
    computers = Counter[str]()
    for entry in nodes.hosts:
        computers[ways.name_at(entry.host) or entry.host or "no host"] += entry.nodes
    silent = sum(not node.startswith(TEST_NODES) for node in probe.exchange.silent)
    counts = {"registered": nodes.registered, "asked": nodes.asked, "silent": silent}
    counts["people"] = len(_name_people_nodes(probe.exchange))
    return {"robot": robot, **counts, "computers": dict(sorted(computers.items()))}


def _name_people_nodes(exchange: Exchange) -> set[str]:
    """Name the robot's own nodes that neither the collection nor the verification has started."""
    of_topics = {node for topic in exchange.topics for node in (*topic.publishers, *topic.subscribers)}
    names = of_topics | {service.node for service in exchange.services}
    return {name for name in names - COLLECTION if not name.startswith(TEST_NODES)}


def _list_odd(robot: str, probe: Probe, misplaced: Mapping[str, Misplaced], ways: Ways) -> Iterator[Row]:
    silences = {entry.node: entry for entry in probe.exchange.silences}
    for node, one in sorted(misplaced.items()):
        yield _make_row(one, robot, _describe_silence(silences.get(node)))
    for node, entry in sorted(silences.items()):
        if node not in misplaced and not node.startswith(TEST_NODES):
            computer = ways.name_at(entry.host) or entry.host
            yield _make_row(Misplaced(node, entry.host, "silent", computer), robot, _describe_silence(entry))


def _make_row(one: Misplaced, robot: str, silence: str) -> Row:
    announces = f"{one.host}, services {one.detail}" if one.mode == "services" else one.host
    return {
        "node": one.node,
        "computer": one.computer,
        "announces": announces + (f" ({one.process.source})" if one.process.source else ""),
        "started_by": _describe_start(one.process),
        "roscore": robot or one.process.master,
        "answers": silence,
        "refused_by": dict(one.refused),
        "mode": one.mode,
    }


def _make_stray_row(one: Misplaced) -> Row:
    row = _make_row(one, "", "")
    return (
        {**row, "node": f"{one.node} (process {one.process.pid})", "roscore": "none", "answers": "yes"}
        if one.mode == "unregistered"
        else row
    )


def _describe_start(process: NodeHost) -> str:
    words = [word for word in (process.starter, process.launch, process.unit) if word]
    return f"{words[0]}: {', '.join(words[1:])}" if len(words) > 1 else "".join(words)


def _describe_silence(entry: SilentNode | None) -> str:
    """Describe a node's answer to its roscore's computer, or the reason why the answer is missing."""
    if entry is None:
        return "yes"
    if entry.tcp_outcome == Outcome.OPEN:
        return "no: it hangs"
    return f"no: {entry.error}" if entry.error else "no"


def describe_nodes(nodes: Mapping[str, Any]) -> str:
    """Describe the number of nodes, and their faults; empty if no node is known."""
    roscores = nodes["roscores"]
    if not nodes["odd"] and not any(entry["registered"] for entry in roscores):
        return ""
    total, asked = (sum(entry[key] for entry in roscores) for key in ("registered", "asked"))
    counts = shorten_list((f"{entry['robot']} {entry['registered']}" for entry in roscores), 8)
    sample = f"; {asked} of them were asked, which is a sample" if asked < total else ""
    if any(entry["people"] for entry in roscores):
        return f"{total} ({counts}){sample}: {_describe_faults(nodes, ' of them', ', at places of their robots')}"
    return (
        f"{total} ({counts}), all of the collection: no node of yours is registered{sample}; {_describe_faults(nodes)}"
    )


def _describe_faults(nodes: Mapping[str, Any], of_them: str = "", places: str = "") -> str:
    """Describe with how many nodes something is wrong; those without a registration are none of the registered ones."""
    lone = sum(row["mode"] == "unregistered" for row in nodes["odd"])
    number = len(nodes["odd"]) + nodes["left_out"] - lone
    well = f"something is wrong with {number}{of_them}" if number else f"all answer{places}"
    more = f"; {lone} more {'runs' if lone == 1 else 'run'} without a registration" if lone else ""
    return f"{well}{more}{':' if number or lone else '.'}"


def list_cells(nodes: Mapping[str, Any]) -> Iterable[tuple[str, ...]]:
    """Yield the cells below HEADINGS of each node with which something is wrong."""
    for row in nodes["odd"]:
        cells = (row[key] or "?" for key in ("node", "computer", "announces", "started_by", "roscore", "answers"))
        yield (*cells, shorten_list(row["refused_by"], NAMED) or "-")
