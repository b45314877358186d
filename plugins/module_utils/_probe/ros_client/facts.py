# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The facts of roscores on this computer, and of the discovery and sync nodes at them, read without ROS.

Whatever answers on a port may be anything: each answer is bounded, and made plain.
"""

import typing
import xmlrpc.client

from ..._base.deadlines import call_all
from ..._base.plain_text import plain
from ..._base.problem import explain_error
from ..._machine import ports
from . import node_services, tcpros
from .xml_rpc import Strange, ask, read_state, server

CALLER = "/multimaster_info"
IMPORTS = "/rosfleet_multimaster/imports"  # a parameter that only the bundled master_sync writes
PATIENCE = 30.0  # seconds for all roscores
BUNDLED, UPSTREAM, SUCCESSOR = "bundled", "upstream", "fkie_mas"
SUCCESSOR_TYPES = "fkie_mas_msgs/"  # how the types of its services begin; their content is upstream's

Row = typing.Dict[str, typing.Any]


def masters(wanted: typing.List[Row], proc: str = "/proc") -> typing.List[Row]:
    """Describe the roscore on each TCP port of `wanted`; a port on which only something else answers is left out.

    Several programs may listen on one port, each at another address.
    """
    places = ports.holders([entry for entry in wanted if entry["protocol"] == "tcp"], proc)
    late = f"no answer within {PATIENCE:g} s"
    rows = call_all(lambda place: _master(place, proc), places, PATIENCE, lambda place: _entry(place, late))
    found: typing.Dict[int, Row] = {}
    for entry in filter(None, rows):
        if entry["port"] not in found or (found[entry["port"]]["error"] and not entry["error"]):
            found[entry["port"]] = entry
    return [found[port] for port in sorted(found)]


def _master(place: Row, proc: str) -> typing.Optional[Row]:
    """Describe the roscore at a place; None if something else answers there, or its program has ended meanwhile."""
    roscore = _uri_at(place)
    entry = _entry(place, "")
    try:
        entry["uri"] = plain(ask(roscore, CALLER, "getUri"))
        entry["pid"] = _number(ask(roscore, CALLER, "getPid"))
        for name in ("run_id", "rosdistro", "rosversion"):
            entry[name] = plain(_parameter(roscore, "/" + name, "")).strip()
        publishers, subscribers, services = tables = read_state(roscore, CALLER)
    except Strange:
        return None
    except OSError as problem:
        if not _is_there(place, proc):
            return None
        return dict(entry, error=plain(explain_error(problem)))
    nodes = {node for table in tables for users in table.values() for node in users}
    entry.update(nodes=len(nodes), topics=len({*publishers, *subscribers}), services=len(services))
    provided = {name: users[0] for name, users in services.items() if users}
    own = [
        [(name, provided[name]) for name in node_services.find_own(roscore, CALLER, provided, end)]
        for end in (node_services.LIST_MASTERS, node_services.SYNC_INFO)
    ]
    entry["discovery"] = [_discovery(roscore, entry["uri"], *pair) for pair in own[0]]
    entry["sync"] = [_sync(roscore, *pair) for pair in own[1]]
    return entry


def _is_there(place: Row, proc: str) -> bool:
    """Return True if a program still listens at a place."""
    return any(
        (one.port, one.address, one.state) == (place["port"], place["address"], ports.LISTEN)
        for one in ports.read_sockets("tcp", proc)
    )


def _entry(place: Row, error: str) -> Row:
    return {
        "port": place["port"],
        "process": {key: place[key] for key in ("pid", "command", "user", "unit", "container")},
        "uri": "",
        "pid": 0,
        "run_id": "",
        "rosdistro": "",
        "rosversion": "",
        "nodes": 0,
        "topics": 0,
        "services": 0,
        "discovery": [],
        "sync": [],
        "error": error,
    }


def _uri_at(place: Row) -> str:
    """Return the URI at which this computer reaches a socket that is bound to an address."""
    address = "127.0.0.1" if place["address"] in ("0.0.0.0", "::") else place["address"]
    return f"http://{f'[{address}]' if ':' in address else address}:{place['port']}/"


def _parameter(uri: str, name: str, default: typing.Any) -> typing.Any:
    """Return a parameter of a roscore, or the default if the roscore does not give it."""
    try:
        return ask(uri, CALLER, "getParam", name)
    except OSError:
        return default


def _call(roscore: str, service: str, node: str, known: tcpros.Types) -> typing.Tuple[Row, typing.List[Row], str]:
    """Begin the description of a node with a call of its service; also return the list in the answer, and the type of the service."""
    entry: Row = {"node": plain(node), "service": plain(service), "error": ""}
    try:
        return (entry, *tcpros.call_by_name(roscore, service, known, CALLER))
    except OSError as problem:
        return dict(entry, error=plain(explain_error(problem))), [], ""


def _discovery(roscore: str, uri: str, service: str, node: str) -> Row:
    """Describe a discovery node, by its list of masters and its parameters at the roscore."""
    entry, masters_there, kind = _call(roscore, service, node, tcpros.LIST_MASTERS)
    entry["masters"] = masters_there
    own = [master for master in masters_there if master["uri"].rstrip("/") == uri.rstrip("/")]
    entry["uri"] = own[0]["monitoruri"] if own else ""
    entry["implementation"] = SUCCESSOR if kind.startswith(SUCCESSOR_TYPES) else _implementation(entry["uri"])
    entry["group"] = plain(_parameter(roscore, f"{node}/mcast_group", ""))
    entry["group_port"] = _number(_parameter(roscore, f"{node}/mcast_port", 0))
    return entry


def _implementation(uri: str) -> str:
    """Name the kind of the discovery node at a URI; empty without an answer. Only the bundled one has getOutsiders."""
    if not uri.startswith("http://"):
        return ""
    try:
        server(uri).getOutsiders()
        return BUNDLED
    except xmlrpc.client.Fault:
        return UPSTREAM
    except Exception:  # whatever answers there
        return ""


def _sync(roscore: str, service: str, node: str) -> Row:
    """Describe a sync node, by its report of its imports."""
    entry, hosts, kind = _call(roscore, service, node, tcpros.GET_SYNC_INFO)
    entry["imports"] = [_count_imports(host) for host in hosts]
    if kind.startswith(SUCCESSOR_TYPES):
        entry["implementation"] = SUCCESSOR
    else:
        entry["implementation"] = BUNDLED if _parameter(roscore, IMPORTS, None) is not None else UPSTREAM
    return entry


def _count_imports(host: Row) -> Row:
    """Count the registrations for another master."""
    entries = [*host["publisher"], *host["subscriber"], *host["services"]]
    return {
        "master": plain(host["masteruri"]),
        "nodes": len({entry["node"] for entry in entries}),
        "topics": len({entry["topic"] for entry in [*host["publisher"], *host["subscriber"]]}),
        "services": len(host["services"]),
    }


def _number(value: typing.Any) -> int:
    """Return a foreign value if it is a whole number, else 0."""
    return value if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 1 << 31 else 0
