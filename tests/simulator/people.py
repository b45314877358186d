# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The nodes that people have started, as the roscore and the computers of their robot show them."""

from __future__ import annotations

from dataclasses import replace

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe import observations as seen
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome

from tests.simulator.network import CONNECTED, NODES

UNITS = {"unit": "people.service", "container": "docker-0badcafe.scope"}  # of what has started a node
PORT = 41233  # of the first; each other one has the next


def hosts_of(fleet, robot):
    """The planned names and addresses of a robot's computers."""
    members = (member for member in fleet.members if member.robot == robot)
    return {text for one in members for text in (one.name, str(one.address), str(one.discovery_address))}


def _nodes(state):
    every = (node for its in state.robots.values() for node in its.people)
    return {node: PORT + number for number, node in enumerate(every)}


def _type(node):
    """The type of a node's topic. One that hangs, or takes no connections, has none: filters leave its topic out, so it is nowhere else."""
    return "" if node.hung or node.fenced or node.apart else "std_msgs/String"


def add(ros, computer, exchange):
    """The content of a roscore, with the nodes of people beside the others."""
    state, fleet = ros.state, ros.fleet
    robot = fleet.computers[computer].robot
    nodes = [node for node in state.robots[robot].people if node.registered]
    places, silences = _nodes(state), []
    for node in nodes:
        is_dropped = node.fenced and node.computer != computer
        error = "timed out" if node.hung or is_dropped else "" if node.fenced else _connect(ros, computer, node)
        if error:
            outcome = Outcome.NO_ANSWER if node.hung or is_dropped else CONNECTED.get(error, Outcome.UNKNOWN_NAME)
            opens = Outcome.OPEN if node.hung else outcome
            silences.append(seen.SilentNode(node.name, node.host, error, outcome, opens, places[node]))
    odd = [node for node in nodes if node.host not in hosts_of(fleet, robot) or node.services]
    return replace(
        exchange,
        topics=(
            *exchange.topics,
            *(seen.RegisteredTopic(f"/people{one.name}", _type(one), (one.name,)) for one in nodes),
        ),
        silent=(*exchange.silent, *(entry.node for entry in silences)),
        silences=(*exchange.silences, *silences),
        unreached=tuple(_list_unreached(ros, robot, places)),
        announced=tuple(seen.AnnouncedHost(one.name, one.host, places[one], services=one.services) for one in odd),
    )


def _list_unreached(ros, robot, places):
    """The nodes of other robots that take no connections from here."""
    for other, its in ros.state.robots.items():
        for node in its.people if other != robot else ():
            if node.fenced:
                yield seen.UnreachedNode(node.name, node.host, places[node], "no answer", Outcome.NO_ANSWER)


def _connect(ros, computer, node):
    """Return the error of a connection to the place that a node announces; empty if the node takes it."""
    if node.host.startswith("127.") or node.host == "localhost":
        return "" if node.computer == computer else "Connection refused"
    robots = {plan.robot for plan in ros.fleet.computers.values()}
    if all(node.host not in hosts_of(ros.fleet, robot) for robot in robots):
        return "timed out" if node.host[0].isdigit() else "Name or service not known"
    is_there = node.host in hosts_of(ros.fleet, ros.fleet.computers[node.computer].robot) and not node.apart
    return ros.reach(computer, node.host, NODES)[0] or ("" if is_there else "Connection refused")


def unregistered(ros, computer):
    """The nodes of a computer that are registered nowhere, if its roscore answers."""
    state, answers = ros.state, not ros.asks(computer)[0]
    lone = [
        seen.NodeHost(
            node.host,
            node.source,
            UNITS.get(node.starter, "session-4.scope"),
            (port,),
            node.name.rpartition("/")[2],
            starter=node.starter,
            pid=port,
            topics=(f"/people{node.name}",),
        )
        for node, port in _nodes(state).items()
        if answers
        and node.computer == computer
        and not node.registered
        and not (node.master or node.hung or node.apart)
    ]
    return seen.UnregisteredNodes(tuple(lone), len(lone), len(lone))


def processes(state, computer):
    """The processes of nodes on a computer that are not as planned."""
    found = []
    for node, port in _nodes(state).items():
        member = next(one for one in state.fleet.members if one.name == node.computer)
        own = {member.name, str(member.address), str(member.discovery_address)}
        if node.computer == computer and (node.host not in own or node.master or node.hung or node.apart):
            name, unit = node.name.rpartition("/")[2], UNITS.get(node.starter, "session-4.scope")
            process = seen.NodeHost(node.host, node.source, unit, (port,), name, node.master, node.starter)
            found.append(replace(process, stopped=node.hung, apart=node.apart))
    return tuple(found)
