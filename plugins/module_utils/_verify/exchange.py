# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""What a robot has in its roscore: what its own nodes registered, what is registered for others, and who is connected."""

import inspect
import json
import os
import time
import typing
import xmlrpc.client

from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import message_types, texts
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify.network import concurrently, resolve, server
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify.ros import CALLER, NO_SCRIPT, Ros

IMPORTS = "/rosfleet_multimaster/imports"  # the bundled master_sync writes there what it registers, and for whom
SYNC_INFO = "/get_sync_info"  # how the service ends by which upstream's tells it
TYPES = 20.0  # seconds for the classes of all types
NODES = 20.0  # seconds for the connections of all nodes

Names = typing.Dict[str, typing.List[str]]  # topic or service -> nodes
NOTHING: typing.Dict[str, typing.Any] = {
    "error": "",
    "types_error": "",
    "topics": [],
    "services": [],
    "imports": [],
    "silent": [],
    "connections": [],
}


def exchange(ros: Ros, members: typing.List[typing.Dict[str, typing.Any]], own: str) -> typing.Dict[str, typing.Any]:
    """What the roscore holds, by the robot that it is of, and what connects the own nodes with those of other robots."""
    try:
        publishers, subscribers, services = (dict(part) for part in ros.ask("getSystemState"))
        types = dict(ros.ask("getTopicTypes"))
        uris = _node_uris(ros, publishers, subscribers, services)
        claims = _claims(ros, services)
    except OSError as problem:
        return dict(NOTHING, error=str(problem))
    imported = {
        node: master for master, nodes in claims.items() for node, uri in nodes.items() if uris.get(node) == uri
    }
    found = dict(NOTHING)
    parts = _parts(publishers, subscribers, services, types, imported)
    found.update(parts.pop("", {"topics": [], "services": []}))
    found["imports"] = [dict(part, master=master) for master, part in sorted(parts.items())]
    sums, found["types_error"] = _md5sums(ros, sorted({topic["type"] for topic in found["topics"]}))
    for topic in found["topics"]:
        topic["md5sum"] = sums.get(topic["type"], "")
    nodes = {node: uri for node, uri in uris.items() if node not in imported}
    named = {uri: node for node, uri in uris.items()}
    found["connections"], found["silent"] = _connections(ros, nodes, named, Places(members), own)
    return found


def _node_uris(ros: Ros, *tables: Names) -> typing.Dict[str, str]:
    """The URIs of all nodes, asked for in one request. Raises OSError."""
    nodes = sorted({node for table in tables for users in table.values() for node in users})
    calls = [{"methodName": "lookupNode", "params": [CALLER, node]} for node in nodes]
    try:
        answers = server(ros.uri).system.multicall(calls)
        return {node: answer[0][2] for node, answer in zip(nodes, answers) if answer[0][0] == 1}
    except (OSError, xmlrpc.client.Error, LookupError, TypeError) as problem:
        raise OSError(f"{ros.uri}: {problem}") from problem


def _claims(ros: Ros, services: Names) -> typing.Dict[str, typing.Dict[str, str]]:
    """{URI of a master: {node: URI}}: which nodes master_sync has registered. Raises OSError where it cannot be known."""
    try:
        return json.loads(ros.ask("getParam", IMPORTS))["imports"]
    except (OSError, ValueError, KeyError, TypeError):
        pass  # another implementation
    service = next((name for name in sorted(services) if name.endswith(SYNC_INFO)), None)
    if service is None:
        raise OSError(f"{ros.uri}: no master_sync tells what it has registered")
    answers, error = _ask(ros, {"types": [], "service": service})
    if "service" not in answers:
        raise OSError(f"{service} does not tell what is registered: {error or 'no answer'}")
    return answers["service"]


def _md5sums(ros: Ros, types: typing.List[str]) -> typing.Tuple[typing.Dict[str, str], str]:
    answers, error = _ask(ros, {"types": [name for name in types if "/" in name], "service": ""})
    return answers.get("types", {}), error


def _ask(ros: Ros, questions: typing.Dict[str, typing.Any]) -> typing.Tuple[typing.Dict[str, typing.Any], str]:
    """What `_probe_types` answers under the Python of ROS, and an error or ''."""
    paths = [os.path.join(ros.folder, name) for name in ("asked.py", "questions.json")]
    for path, text in zip(paths, (inspect.getsource(message_types), json.dumps(questions))):
        with open(path, "w") as stream:
            stream.write(text)
        os.chmod(path, 0o644)
    words = ros.python()
    if not words:
        return {}, NO_SCRIPT
    output, error = ros.program("the Python of ROS", words + paths, TYPES)
    answers: typing.Dict[str, typing.Any] = {}
    for line in output.splitlines():
        try:
            answers.update(json.loads(line))
        except ValueError:  # what somebody's package prints when it is imported
            continue
    return answers, error


def _parts(
    publishers: Names,
    subscribers: Names,
    services: Names,
    types: typing.Dict[str, str],
    imported: typing.Dict[str, str],
) -> typing.Dict[str, typing.Dict[str, typing.List[typing.Dict[str, typing.Any]]]]:
    """{URI of a master, or '' for the own one: its topics and services}."""
    topics: typing.Dict[typing.Tuple[str, str], typing.Dict[str, typing.Any]] = {}
    parts: typing.Dict[str, typing.Dict[str, typing.List[typing.Dict[str, typing.Any]]]] = {}

    def part(node: str) -> typing.Dict[str, typing.List[typing.Dict[str, typing.Any]]]:
        return parts.setdefault(imported.get(node, ""), {"topics": [], "services": []})

    for kind, table in (("publishers", publishers), ("subscribers", subscribers)):
        for name, nodes in sorted(table.items()):
            for node in sorted(nodes):
                key = imported.get(node, ""), name
                if key not in topics:
                    topics[key] = {"name": name, "type": types.get(name, ""), "publishers": [], "subscribers": []}
                    part(node)["topics"].append(topics[key])
                topics[key][kind].append(node)
    for name, nodes in sorted(services.items()):
        for node in nodes:
            part(node)["services"].append({"name": name, "node": node})
    return parts


# Connections


def _connections(
    ros: Ros, nodes: typing.Dict[str, str], named: typing.Dict[str, str], places: "Places", own: str
) -> typing.Tuple[typing.List[typing.Dict[str, str]], typing.List[str]]:
    """The connections of own nodes ({node: URI}) with nodes of other robots, and the nodes that do not answer.

    A node of this roscore that runs on another robot's computer, as an operator's tool does, is an own one.
    """
    robot = places.robot(own.lower())
    found, silent = [], []
    answers = concurrently(_bus_info, sorted(nodes.items()), NODES, lambda node: [])
    for node, answer in zip(sorted(nodes), answers):
        if answer is None:
            silent.append(node)
        for link in texts.links(answer or []):
            link = link._replace(peer=named.get(link.peer, link.peer))
            other = places.robot(link.host)
            if other in ("", robot) or (link.peer in nodes and places.robot(texts.host(nodes[link.peer])) == other):
                continue
            found.append(dict(link._asdict(), node=node, robot=other))
    return found, _still_registered(ros, silent, nodes)


def _bus_info(item: typing.Tuple[str, str]) -> typing.Optional[typing.List]:
    """What a node says of its connections, or None."""
    try:
        return server(item[1]).getBusInfo(CALLER)[2]
    except Exception:  # whatever a dead or strange node makes of it
        return None


def _still_registered(ros: Ros, silent: typing.List[str], nodes: typing.Dict[str, str]) -> typing.List[str]:
    """Without the nodes that have ended properly meanwhile."""
    if not silent:
        return []
    time.sleep(1.0)
    try:
        now = _node_uris(ros, {"": silent})
    except OSError:
        return silent
    return [node for node in silent if now.get(node) == nodes[node]]


class Places:
    """Which robot a host text of a URI is of."""

    def __init__(self, members: typing.List[typing.Dict[str, typing.Any]]) -> None:
        self._robots: typing.Dict[str, str] = {}
        for member in members:
            for text in (member["name"].lower(), member["address"], member["discovery_address"]):
                if text:
                    self._robots[text] = member["robot"]

    def robot(self, host: str) -> str:
        """The robot of a host, or empty; a name that is nobody's is looked up, once."""
        if host and host not in self._robots:
            addresses = concurrently(resolve, [host], 5.0, lambda name: ([], ""))[0][0]
            self._robots[host] = next((self._robots[found] for found in addresses if found in self._robots), "")
        return self._robots.get(host, "")
