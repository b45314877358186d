# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The content of a robot's roscore: own registrations, those for other masters, and connections with other robots."""

import collections
import json
import re
import time
import typing
import xmlrpc.client

from ..._base.commands import read_source
from ..._base.deadlines import call_all
from ..._base.foreign import last_line
from ..._base.plain_text import plain
from ..._base.problem import explain_error
from ..._contract.outcomes import Outcome
from ..._contract.ros import Exchange, UnreachedNode
from ..._machine import network
from ..._machine.outcomes import classify_error, connect
from ..ros_client import message_types, node_hosts, node_services, tcpros
from ..ros_client.documents import NODE, STATE
from ..ros_client.facts import IMPORTS
from ..ros_client.hosts import host_of, place_of, spell_host
from ..ros_client.ros import CALLER, Ros
from ..ros_client.xml_rpc import server

TYPES = 20.0  # seconds for the classes of all types
NODES = 20.0  # seconds for the connections of all nodes
NAMES = 5.0  # seconds for the addresses of all hosts
OPENS = 2.0  # seconds in which a TCP connection to a node that does not answer is to open
MOST_TRIED = 300  # nodes of other robots that are connected to; of more, one of every so many
MOST_SERVICES = 5000  # whose places are asked for
MOST_ASKED = 1000  # nodes that are asked for their connections; of more, one of every so many
# The host and the port at the other end of a connection; without bounds a long text of a stranger would be read for an hour.
OTHER_END = re.compile(r" to \[(.{1,255}):\d{1,5} on socket")

Names = typing.Dict[str, typing.List[str]]  # topic or service -> nodes


def exchange(ros: Ros, members: typing.List[typing.Dict[str, typing.Any]], own: str) -> typing.Dict[str, typing.Any]:
    """Read the roscore, split by the robot of each registration, and the connections of own nodes with other robots."""
    try:
        tables = ros.read_state()  # publishers, subscribers, services
        types = {str(topic): str(kind) for topic, kind in ros.ask("getTopicTypes")}
        uris = node_uris(ros, *tables)
        claims = _claims(ros, tables[2])
    except (OSError, TypeError, ValueError) as problem:  # or an answer in another form
        return Exchange(error=str(problem)).plain()
    imported = {
        node: master for master, nodes in claims.items() for node, uri in nodes.items() if uris.get(node) == uri
    }
    found = Exchange().plain()
    parts = _parts(tables, types, imported)
    found.update(parts.pop("", {"topics": [], "services": []}))
    found["imports"] = [dict(part, master=master) for master, part in sorted(parts.items())]
    found["types_error"], outcome = _add_sums(ros, found["topics"])
    found["types_outcome"] = outcome.value
    nodes = {node: uri for node, uri in uris.items() if node not in imported}
    named = {uri: node for node, uri in uris.items()}
    found["announced"] = _resolve(node_hosts.announced(nodes, _service_uris(ros, nodes, tables[2]), members, own))
    found["connections"], silent, asked = _connections(_sample(nodes), named, HostRobots(members), own)
    found["unreached"] = _try_imported({node: uris[node] for node in imported if node in uris})
    others = {node: uri for node, uri in nodes.items() if not _is_talker(node)}
    found["nodes"] = {"registered": len(others), "asked": asked, "hosts": node_hosts.count_hosts(others)}
    found["silent"] = _drop_ended(ros, sorted(silent), nodes)
    found["silences"] = [dict(silent[node], node=node, **_place(nodes[node])) for node in found["silent"]]
    return found


def _place(uri: str) -> typing.Dict[str, typing.Any]:
    host, port = place_of(uri)
    return {"host": host, "port": port}


def _add_sums(ros: Ros, topics: typing.List[typing.Dict[str, typing.Any]]) -> typing.Tuple[str, Outcome]:
    """Give each topic the md5 sum of its type here; return the reason if the sums are missing, else an empty text, and the outcome."""
    sums, problem, outcome = _md5sums(ros, sorted({topic["type"] for topic in topics if "/" in topic["type"]}))
    for topic in topics:
        topic["md5sum"] = sums.get(topic["type"], "")
    return problem, outcome


def _resolve(rows: typing.List[typing.Dict[str, typing.Any]]) -> typing.List[typing.Dict[str, typing.Any]]:
    """Add the addresses of nodes' hosts, as looked up here: a name that the plan does not have may lead to its computer all the same."""
    names = sorted({row["host"] for row in rows if not network.is_address(row["host"])})
    found = dict(zip(names, call_all(network.resolve, names, NAMES, lambda name: ([], ""))))
    return [dict(row, addresses=found.get(row["host"], ([], ""))[0]) for row in rows]


def _try_imported(nodes: typing.Dict[str, str]) -> typing.List[typing.Dict[str, typing.Any]]:
    """Connect to nodes of other robots ({node: URI}), as subscribers here do, and list those to which no connection opens."""
    tried = _sample({node: uri for node, uri in nodes.items() if not _is_talker(node)}, MOST_TRIED)
    places = sorted((node, place_of(uri)) for node, uri in tried.items())
    wanted = [(node, host, port) for node, (host, port) in places if host and port]
    answers = call_all(lambda place: connect(place[1], place[2], OPENS), wanted, NODES, lambda place: None)
    return [
        UnreachedNode(node, host=plain(host), port=port, error=plain(answer.words), outcome=answer.outcome).plain()
        for (node, host, port), answer in zip(wanted, answers)
        if answer is not None and answer.outcome != Outcome.OPEN
    ]


def _sample(nodes: typing.Dict[str, str], most: int = MOST_ASKED) -> typing.Dict[str, str]:
    """Take one of every so many nodes, if there are very many."""
    step = -(-len(nodes) // most) or 1
    return {node: nodes[node] for node in sorted(nodes)[::step]}


def node_uris(ros: Ros, *tables: Names) -> typing.Dict[str, str]:
    """Ask for the URIs of all nodes in one request. Raises OSError."""
    return _look_up(ros, "lookupNode", sorted({node for table in tables for users in table.values() for node in users}))


def _look_up(ros: Ros, method: str, names: typing.List[str]) -> typing.Dict[str, str]:
    """Ask the roscore for the URIs of many names in one request. Raises OSError."""
    calls = [{"methodName": method, "params": [CALLER, name]} for name in names]
    try:
        answers = server(ros.uri, STATE).system.multicall(calls)
        return {name: str(answer[0][2]) for name, answer in zip(names, answers) if answer[0][0] == 1}
    except (OSError, xmlrpc.client.Error, LookupError, TypeError) as problem:
        raise OSError(f"{ros.uri}: {explain_error(problem)}") from problem


def _service_uris(ros: Ros, nodes: typing.Dict[str, str], services: Names) -> typing.Dict[str, str]:
    """Ask for the URIs of the services of nodes ({node: URI}): {node: URI of one that is elsewhere, or else of any}. Empty without an answer."""
    providers = {name: users[0] for name, users in sorted(services.items()) if users and users[0] in nodes}
    names = list(providers)[:MOST_SERVICES]
    try:
        uris = _look_up(ros, "lookupService", names) if names else {}
    except OSError:
        return {}
    found: typing.Dict[str, str] = {}
    for name, uri in sorted(uris.items()):
        node = providers[name]
        if node not in found or host_of(uri) != host_of(nodes[node]):
            found[node] = uri
    return found


def _claims(ros: Ros, services: Names) -> typing.Dict[str, typing.Dict[str, str]]:
    """Read the nodes that master_sync has registered: {URI of a master: {node: URI}}. Raises OSError without an answer."""
    try:
        # Any program may set a parameter. A number of some millions of digits would keep a processor for minutes as an int.
        value = json.loads(ros.ask("getParam", IMPORTS), parse_int=float)["imports"]
        if isinstance(value, dict) and all(map(_are_texts, value.values())):
            return value
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        pass  # another implementation
    own = node_services.find_own(ros.uri, CALLER, services, node_services.SYNC_INFO)
    if not own:
        raise OSError(f"{ros.uri}: no master_sync reports its registrations")
    found: typing.Dict[str, typing.Dict[str, str]] = {}
    for host in tcpros.call_by_name(ros.uri, own[0], tcpros.GET_SYNC_INFO, CALLER)[0]:
        nodes = found.setdefault(host["masteruri"], {})
        for entry in host["publisher"] + host["subscriber"] + host["services"]:
            nodes[entry["node"]] = entry["nodeuri"]
    return found


def _md5sums(ros: Ros, types: typing.List[str]) -> typing.Tuple[typing.Dict[str, str], str, Outcome]:
    """Ask the Python of ROS for the md5 sums of message types; return {type: md5 sum}, an error or '', and the outcome."""
    try:
        output, error = ros.run_python(read_source(message_types), TYPES, json.dumps(types))
    except OSError as problem:
        return {}, plain(explain_error(problem)), classify_error(problem)[0]
    sums = last_line(output.encode())
    return sums if _are_texts(sums) else {}, error, Outcome.FAILED if error else Outcome.ANSWERED


def _are_texts(value: typing.Any) -> bool:
    """Return True for {text: text}."""
    return isinstance(value, dict) and all(isinstance(text, str) for text in value.values())


def _parts(
    tables: typing.List[Names], types: typing.Dict[str, str], imported: typing.Dict[str, str]
) -> typing.Dict[str, typing.Dict[str, typing.Any]]:
    """Split the registrations: {URI of a master, or '' for the own one: its topics and services}."""
    parts: typing.Dict[str, typing.Any] = collections.defaultdict(lambda: {"topics": {}, "services": []})
    for kind, table in zip(("publishers", "subscribers"), tables):
        for name, nodes in sorted(table.items()):
            topic = {"name": name, "type": types.get(name, "")}
            for node in sorted(nodes):
                topics = parts[imported.get(node, "")]["topics"]
                topics.setdefault(name, dict(topic, publishers=[], subscribers=[]))[kind].append(node)
    for name, nodes in sorted(tables[2].items()):
        for node in nodes:
            parts[imported.get(node, "")]["services"].append({"name": name, "node": node})
    return {master: dict(part, topics=list(part["topics"].values())) for master, part in parts.items()}


# Connections


def _connections(
    nodes: typing.Dict[str, str], named: typing.Dict[str, str], places: "HostRobots", own: str
) -> typing.Tuple[typing.List[typing.Dict[str, str]], typing.Dict[str, typing.Dict[str, str]], int]:
    """Ask own nodes ({node: URI}) for connections with nodes of other robots; return those, {silent node: why, outcomes}, and the number asked.

    A node of this roscore that runs on another robot's computer, as an operator's tool does, is an own one.
    """
    robot = places.robot(own.lower())
    found, silent = [], {}
    lengths: typing.Counter[str] = collections.Counter()  # robot -> characters of the connections with it
    answers = call_all(_bus_info, sorted(nodes.items()), NODES, lambda node: BusInfo([], Outcome.NOT_TRIED))
    known = [links(answer.entries) for answer in answers]
    places.look_up([*map(host_of, nodes.values()), *(link["host"] for each in known for link in each)])
    for node, answer, each in zip(sorted(nodes), answers, known):
        if answer.error:
            silent[node] = {
                "error": answer.error,
                "outcome": answer.outcome.value,
                "tcp_outcome": answer.tcp_outcome.value,
            }
        for link in each:
            peer = named.get(link["peer"], link["peer"])
            other = places.robot(link["host"])
            if other in ("", robot) or (peer in nodes and places.robot(host_of(nodes[peer])) == other):
                continue
            del link["number"]
            link.update(peer=peer, node=node, robot=other)
            lengths[other] += len(json.dumps(link))
            if lengths[other] <= NODE:  # else a robot with many long names would have the whole answer refused
                found.append(link)
    asked = (node for node, answer in zip(sorted(nodes), answers) if answer.outcome != Outcome.NOT_TRIED)
    return found, silent, sum(not _is_talker(node) for node in asked)


def _is_talker(node: str) -> bool:
    """Return True if a node is of the verification itself."""
    return node.startswith(f"{CALLER}_")


class BusInfo(typing.NamedTuple):
    """The answer of a node that was asked for its connections."""

    entries: typing.Any
    outcome: Outcome
    error: str = ""  # why it does not answer
    tcp_outcome: Outcome = Outcome.NOT_TRIED  # that of a mere connection, if no answer came


def _bus_info(item: typing.Tuple[str, str]) -> BusInfo:
    """Ask a node for its connections. One that does not answer hangs if a connection to it opens."""
    try:
        return BusInfo(server(item[1], NODE).getBusInfo(CALLER)[2], Outcome.ANSWERED)
    except OSError as problem:
        error, outcome = problem.strerror or str(problem) or type(problem).__name__, classify_error(problem)[0]
    except Exception as problem:  # any kind, raised by the answer of a strange node
        return BusInfo([], Outcome.FAILED, plain(str(problem)) or type(problem).__name__)
    if outcome != Outcome.NO_ANSWER:
        return BusInfo([], outcome, error, outcome)
    host, port = place_of(item[1])
    return BusInfo([], outcome, error, connect(host, port, OPENS).outcome if host else Outcome.NOT_TRIED)


def _drop_ended(ros: Ros, silent: typing.List[str], nodes: typing.Dict[str, str]) -> typing.List[str]:
    """Leave out the nodes that have ended properly meanwhile."""
    if not silent:
        return []
    time.sleep(1.0)
    try:
        now = node_uris(ros, {"": silent})
    except OSError:
        return silent
    return [node for node in silent if now.get(node) == nodes[node]]


class HostRobots:
    """The robots of hosts, as hosts are in URIs."""

    def __init__(self, members: typing.List[typing.Dict[str, typing.Any]]) -> None:
        self._robots: typing.Dict[str, str] = {}
        for member in members:
            for text in (member["name"].lower(), member["address"], member["discovery_address"]):
                if text:
                    self._robots[text] = member["robot"]

    def robot(self, host: str) -> str:
        """Return the robot of a host, or empty. The name of no known computer is looked up, once."""
        self.look_up([host])
        return self._robots.get(host, "")

    def look_up(self, hosts: typing.Iterable[str]) -> None:
        """Look up the names of no known computers, all at once: without a name server each takes seconds, and any node may name many."""
        unknown = sorted({host for host in hosts if host and host not in self._robots})
        for host, (addresses, _error) in zip(unknown, call_all(network.resolve, unknown, NAMES, lambda name: ([], ""))):
            self._robots[host] = next((self._robots[found] for found in addresses if found in self._robots), "")


def links(entries: typing.Any) -> typing.List[typing.Dict[str, typing.Any]]:
    """Read the connections in an answer to getBusInfo (ROS Slave API); the last element, a text, is missing before kinetic.

    Each has the node's number of it, its direction ("in" from a publisher), topic, peer (the publisher's URI, or the subscriber's name), and the peer's host.
    """
    found = []
    for entry in entries if isinstance(entries, list) else []:
        if not isinstance(entry, list) or len(entry) < 5 or not all(isinstance(text, str) for text in entry[1:5]):
            continue
        peer, inward = entry[1], entry[2] == "i"
        text = entry[6] if len(entry) > 6 else ""
        end = OTHER_END.search(text if isinstance(text, str) else "")
        place = spell_host(end.group(1)) if end else host_of(peer if inward else "")
        direction = "in" if inward else "out"
        found.append({"number": entry[0], "direction": direction, "topic": entry[4], "peer": peer, "host": place})
    return found
