# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The traffic from the nodes of a robot to nodes of other robots: their own counters (getBusStats), read twice.

A node is on the robot whose computer its URI names, so a tool on the computer of another robot counts there.
"""

import time
import typing

from ..._base.deadlines import call_all
from ..._base.plain_text import LONGEST
from ..._contract.ros import NodeTraffic
from ..ros_client.documents import NODE
from ..ros_client.hosts import host_of
from ..ros_client.ros import CALLER, Ros
from ..ros_client.xml_rpc import server
from .exchange import HostRobots, links, node_uris

SECONDS = 3.0  # between the two readings
READING = 3.0  # seconds for a reading of all nodes; a node that answers later is left out
MOST_NODES = 300  # whose counters are read
MOST_FLOWS = 200  # of the result: those with most bytes

NOTHING = NodeTraffic().plain()

Counters = typing.Dict[int, typing.Tuple[int, int]]  # number of a connection -> bytes, messages
Reading = typing.Tuple[float, Counters]  # monotonic seconds, and the counters of a node
Sent = typing.Dict[int, typing.Tuple[str, str]]  # number of a connection -> topic, robot of the subscriber
NO_READING: Reading = (0.0, {})


def measure_traffic(
    ros: Ros, members: typing.List[typing.Dict[str, typing.Any]], own: str
) -> typing.Dict[str, typing.Any]:
    """Read the counters of the robot's publishers twice; return the seconds between, and a flow for each node, topic and other robot.

    The verification's own nodes are left out. Without a roscore there is nothing.
    """
    places = HostRobots(members)
    robot = places.robot(own.lower())
    try:
        uris = node_uris(ros, ros.read_state()[0])
    except OSError:  # exchange says why
        return NOTHING
    publishers = [(node, uri) for node, uri in sorted(uris.items()) if not node.startswith(CALLER)]
    found = call_all(lambda item: _find_sent(item[1], places, robot), publishers, READING, lambda item: {})
    senders = [(node, uri, sent) for (node, uri), sent in zip(publishers, found) if sent][:MOST_NODES]
    if not senders:
        return NOTHING
    first = _read_all(senders)
    time.sleep(SECONDS)
    second = _read_all(senders)
    flows = [
        flow for (node, _uri, sent), *both in zip(senders, first, second) for flow in list_flows(node, sent, *both)
    ]
    spans = [late[0] - early[0] for early, late in zip(first, second) if early[1] and late[1]]
    flows.sort(key=lambda flow: -flow["bytes_s"])
    return {"seconds": round(max(spans, default=0.0), 1), "flows": flows[:MOST_FLOWS]}


def _find_sent(uri: str, places: HostRobots, robot: str) -> Sent:
    """Ask a node of the robot for its connections with subscribers of other robots; an empty list without an answer."""
    try:
        answer = server(uri, NODE).getBusInfo(CALLER)[2] if places.robot(host_of(uri)) == robot else []
    except Exception:  # whatever a strange node makes of it; exchange names the nodes that do not answer
        return {}
    sent = {}
    for link in links(answer):
        other = places.robot(link["host"]) if link["direction"] == "out" else ""
        if other not in ("", robot) and isinstance(link["number"], int) and len(link["topic"]) <= LONGEST:
            sent[link["number"]] = link["topic"], other
    return sent


def _read_all(senders: typing.Sequence[typing.Tuple[str, str, Sent]]) -> typing.List[Reading]:
    return call_all(lambda item: _read_counters(item[1]), senders, READING, lambda item: NO_READING)


def _read_counters(uri: str) -> Reading:
    began = time.monotonic()
    try:
        found = counters(server(uri, NODE).getBusStats(CALLER))
        return (began + time.monotonic()) / 2, found
    except Exception:  # as above
        return NO_READING


def counters(answer: typing.Any) -> Counters:
    """Read the counters of all outgoing connections in an answer to getBusStats (ROS Slave API).

    rospy: [1, "", [publishers, ...]]; a publisher is [topic, bytes, connections], a connection [number, bytes, messages, connected].
    roscpp: [publishers, ...], since it overwrites code and text; a publisher is [topic, connections], a connection [number, bytes, bytes, messages, 0].
    """
    parts = answer[2] if isinstance(answer, list) and len(answer) == 3 and isinstance(answer[0], int) else answer
    publishers = parts[0] if isinstance(parts, list) and parts else ()
    found = {}
    for publisher in publishers if isinstance(publishers, list) else ():
        connections = publisher[-1] if isinstance(publisher, list) and publisher else ()
        for entry in connections if isinstance(connections, list) else ():
            if isinstance(entry, list) and len(entry) > 3 and all(map(_is_number, entry)):
                found[entry[0]] = entry[1], entry[-2]
    return found


def _is_number(value: typing.Any) -> bool:
    return isinstance(value, int) and abs(value) < 1 << 63


def list_flows(node: str, sent: Sent, first: Reading, second: Reading) -> typing.List[typing.Dict[str, typing.Any]]:
    """Return the rates of a node's traffic, by topic and robot, summed over the subscribers.

    A counter that went back gives no rate: the connection is another one, or the 32 bits of roscpp are over.
    """
    seconds = second[0] - first[0]
    flows: typing.Dict[typing.Tuple[str, str], typing.Dict[str, typing.Any]] = {}
    for number in sorted(sent.keys() & first[1].keys() & second[1].keys()):
        grown = [late - early for early, late in zip(first[1][number], second[1][number])]
        if min(grown) < 0 or seconds <= 0:
            continue
        topic, robot = sent[number]
        nothing = {"node": node, "topic": topic, "robot": robot, "subscribers": 0, "bytes_s": 0.0, "messages_s": 0.0}
        flow = flows.setdefault(sent[number], nothing)
        flow["subscribers"] += 1
        flow["bytes_s"] = round(flow["bytes_s"] + grown[0] / seconds, 1)
        flow["messages_s"] = round(flow["messages_s"] + grown[1] / seconds, 2)
    return list(flows.values())
