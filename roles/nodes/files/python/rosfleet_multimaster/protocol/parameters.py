# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The private parameters of the two nodes: names, defaults, types, and the sentences about wrong ones."""

import difflib
import ipaddress
import re
from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Sequence, Tuple

from .filters import HIDDEN, HOSTS, NAMES, Filters, InvalidPattern, Pattern
from .members import ALLOW, IGNORE
from .tcpros.hosts import is_address

GUESSES = 20  # unknown names for which a known one is looked for
SHORTEST = 2.0  # seconds of ~offline_after: less leaves no time to ask


@dataclass(frozen=True)
class Settings:
    """The parameters that the core of discovery needs, with upstream's names and defaults (times in seconds)."""

    heartbeat_hz: float = 0.02
    offline_after: float = 5.0
    active_request_after: float = 60.0
    remove_after: float = 300.0
    measurement_intervals: int = 5
    robot_hosts: Sequence[str] = ()
    send_mcast: bool = True
    listen_mcast: bool = True


class ParameterError(ValueError):
    """One sentence: the parameter, the found value, the expected one."""


class Parameter(NamedTuple):
    """A parameter: its default (None: worked out at the start) and the accepted values."""

    default: Any
    kind: str


Table = Mapping[str, Parameter]
Overlay = Tuple[Dict[str, Any], List[str]]  # all parameters, and warnings


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _port(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 < value < 65536


def _count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 1


def _texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(item, str) for item in value)


def _patterns(value: Any) -> bool:
    return isinstance(value, (str, list, dict))


def _entries(value: Any) -> bool:
    return value is None or (isinstance(value, list) and all(isinstance(entry, dict) for entry in value))


KINDS: Mapping[str, Tuple[str, Callable[[Any], bool]]] = {
    "text": ("a text", lambda value: isinstance(value, str)),
    "flag": ("true or false", lambda value: isinstance(value, bool)),
    "port": ("a port number from 1 to 65535", _port),
    "rate": ("a number above 0", lambda value: _number(value) and value > 0),
    "seconds": ("a number of seconds", _number),
    "count": ("a whole number of at least 1", _count),
    "texts": ("a list of texts", _texts),
    "names": ("a pattern, or a list of patterns", lambda value: isinstance(value, str) or _texts(value)),
    "patterns": ("a list of patterns, or a mapping from a master's name to one", _patterns),
    "exports": ("nothing at all, or a list of entries such as {to: [192.168.1.2], topics: [/pose]}", _entries),
    "crossing": ("a list of entries such as {from: robot2, names: [/robot_description]}", _entries),
    "strangers": (f"{IGNORE} or {ALLOW}", lambda value: value in (IGNORE, ALLOW)),
    "networks": ("a list of IPv4 addresses and networks", lambda value: _texts(value) and all(map(_is_network, value))),
    "channels": ("a list of entries such as {peer: station, topics: [/scan]}", _entries),
    "members": ("a list of robots", lambda value: isinstance(value, list)),
    "level": ("DEBUG, INFO, WARN, ERROR or FATAL", lambda value: value in ("DEBUG", "INFO", "WARN", "ERROR", "FATAL")),
}

# Of all nodes: the members of the fleet, and the output for people.
COMMON: Table = {
    "strangers": Parameter(ALLOW, "strangers"),
    "allow": Parameter([], "networks"),
    "members": Parameter([], "members"),
    "diagnostics": Parameter(True, "flag"),
    "metrics": Parameter("", "text"),
    "log_level": Parameter("INFO", "level"),
}

_SETTINGS = Settings()  # has the defaults for the core of discovery

DISCOVERY: Table = {
    "name": Parameter("", "text"),
    "mcast_group": Parameter("226.0.0.0", "text"),
    "mcast_port": Parameter(11511, "port"),
    "interface": Parameter("", "text"),
    "rpc_port": Parameter(None, "port"),
    "rpc_addr": Parameter("", "text"),
    "rosmaster_hz": Parameter(12.5, "rate"),
    "heartbeat_hz": Parameter(_SETTINGS.heartbeat_hz, "rate"),
    "measurement_intervals": Parameter(_SETTINGS.measurement_intervals, "count"),
    "offline_after": Parameter(_SETTINGS.offline_after, "seconds"),
    "remove_after": Parameter(_SETTINGS.remove_after, "seconds"),
    "active_request_after": Parameter(_SETTINGS.active_request_after, "seconds"),
    "robot_hosts": Parameter([], "texts"),
    "send_mcast": Parameter(_SETTINGS.send_mcast, "flag"),
    "listen_mcast": Parameter(_SETTINGS.listen_mcast, "flag"),
    **{name: Parameter([], "names") for name in HIDDEN},
    "exports": Parameter(None, "exports"),
    "do_not_sync": Parameter([], "names"),
    "differences": Parameter(True, "flag"),
    **COMMON,
}

SYNC: Table = {
    **{name: Parameter([], "patterns") for name in (*HOSTS, *NAMES)},
    "sync_topics_on_demand": Parameter(False, "flag"),
    "sync_parameters": Parameter([], "crossing"),
    "sync_remote_nodes": Parameter(False, "flag"),
    "resync_on_reconnect": Parameter(True, "flag"),
    "resync_on_reconnect_timeout": Parameter(0.0, "seconds"),
    "end_lost_connections": Parameter(True, "flag"),
    "differences": Parameter(True, "flag"),
    **COMMON,
}

RELAY: Table = {
    "robot": Parameter("", "text"),
    "port": Parameter(None, "port"),
    "channels": Parameter([], "channels"),
    **COMMON,
}

# Parameters of upstream that these nodes do not need, and why.
WITHOUT_EFFECT: Mapping[str, str] = {
    "change_notification_count": "a change is always announced three times",
    "check_host": "registrations of this master are known by their origin",
    "interface_url": "filters are parameters here: give the lists themselves",
    "timeout_factor": "~offline_after says after which silence a master is offline",
}


def overlay(table: Table, given: Mapping[str, Any], foreign: bool = False) -> Overlay:
    """All parameters, and a warning for every name that is not known. Raises ParameterError.

    `foreign`: anybody may have set them, as those on a roscore. Then a pattern is a name with `*`, and no regular expression.
    """
    values: Dict[str, Any] = {name: parameter.default for name, parameter in table.items()}
    warnings = []
    for name, value in given.items():
        if name in table:
            expected, accepts = KINDS[table[name].kind]
            if not accepts(value):
                raise ParameterError(f"~{name} is {value!r}, but {expected} is expected")
            values[name] = value
        elif name in WITHOUT_EFFECT:
            warnings.append(f"~{name} has no effect: {WITHOUT_EFFECT[name]}")
        elif table is SYNC and isinstance(value, dict) and set(value) <= {*NAMES, *HOSTS}:
            values[name] = value  # the filters of one host
        else:
            guesses = len(warnings) < GUESSES and len(name) < 100  # one takes a third of a millisecond
            near = difflib.get_close_matches(name, table, n=1, cutoff=0.5) if guesses else []
            warnings.append(
                f"~{name} is no parameter of this node and is ignored" + (f"; did you mean ~{near[0]}?" if near else "")
            )
    _check(table, values, Pattern.from_foreign_items if foreign else Pattern.from_items)
    return values, warnings


def _check(table: Table, values: Mapping[str, Any], make: Callable[[Iterable[str], str], Pattern]) -> None:
    try:
        Filters(values).check(make)
        for name in HIDDEN:
            value = values.get(name) or []
            make([value] if isinstance(value, str) else value, name)
    except InvalidPattern as problem:
        raise ParameterError(f"~{problem}") from None
    if table is DISCOVERY:
        _check_group(values["mcast_group"])
        _check_patience(values["offline_after"])
    for name, check_entry in _ENTRIES:
        entries = values[name] if name in table else None
        for number, entry in enumerate(entries or [], 1):
            check_entry(f"entry {number} of ~{name}", entry)
    _check_crossing(values.get("sync_parameters") or [])


def _check_names(what: str, items: Sequence[str]) -> None:
    """Check names with `*`, which are given to others: the plan has only such names there."""
    try:
        Pattern.from_foreign_items(items, what)
    except InvalidPattern as problem:
        raise ParameterError(str(problem)) from None


def _check_patience(seconds: float) -> None:
    if not (seconds <= 0 or seconds >= SHORTEST):  # not a number is neither
        raise ParameterError(
            f"~offline_after is {seconds}, but at least {SHORTEST:g} seconds are expected, or 0 for"
            " only ~active_request_after"
        )


def _check_group(value: str) -> None:
    group = value.partition("@")[0]
    try:
        multicast = ipaddress.IPv4Address(group).is_multicast
    except ValueError:
        multicast = False
    if not multicast:
        raise ParameterError(f"~mcast_group is {value!r}, but an IPv4 multicast group is expected, such as 226.0.0.0")


def _check_export(what: str, entry: Mapping[str, Any]) -> None:
    unknown = sorted(str(key) for key in entry if key not in ("to", "topics", "services"))
    if unknown:
        raise ParameterError(f"{what} has {unknown[0]!r}, but only to, topics and services are expected")
    for key, value in entry.items():
        if not _texts(value):
            raise ParameterError(f"{what} has {value!r} as its {key}, but a list of texts is expected")
    if not entry.get("to"):
        raise ParameterError(f"{what} says not to whom: addresses are expected as its to, or '*' for everybody")
    for address in entry["to"]:
        if address != "*" and not is_address(address):
            raise ParameterError(f"{what} is for {address!r}, but an IPv4 address or '*' is expected")
    for key in ("topics", "services"):
        _check_names(f"{what}, {key}", entry.get(key, []))


CHANNEL: Mapping[str, str] = {
    "peer": "text",
    "hosts": "texts",
    "port": "port",
    "topics": "texts",
    "services": "texts",
    "back": "texts",  # topics that come from the peer to the robot with the inner names
    "as": "text",
    "base": "text",
    "inner": "flag",
    "rate": "seconds",
    "whole": "texts",  # types, and packages (x/*), of which each message replaces the one before
    "newest": "flag",
    "frames": "text",  # in front of those of the robot with the inner names; empty: no name of a frame is changed
    "world": "text",  # a frame of all, above that robot's root; empty: the relay says nothing of it
    "root": "text",
}


def _check_channel(what: str, entry: Mapping[str, Any]) -> None:
    if set(entry) != set(CHANNEL):
        raise ParameterError(f"{what} has {', '.join(sorted(map(str, entry)))}, but {', '.join(CHANNEL)} are expected")
    for key, kind in CHANNEL.items():
        expected, accepts = KINDS[kind]
        if not accepts(entry[key]):
            raise ParameterError(f"{what} has {entry[key]!r} as its {key}, but {expected} is expected")
    if not entry["hosts"] or not all(map(is_address, entry["hosts"])):
        raise ParameterError(f"{what} has {entry['hosts']!r} as its hosts, but IPv4 addresses are expected")
    if entry["rate"] < 0:
        raise ParameterError(f"{what} has a rate of {entry['rate']}, but a number of at least 0 is expected")
    for key in ("topics", "services", "back"):
        _check_names(f"{what}, {key}", entry[key])


def _check_member(what: str, entry: Any) -> None:
    lists = ("uris", "addresses", "hosts")
    if not isinstance(entry, Mapping) or set(entry) != {"robot", "name", "rpc_port", *lists}:
        raise ParameterError(f"{what}: robot, name, uris, rpc_port, addresses and hosts are expected")
    for key in lists:
        if not _texts(entry[key]):
            raise ParameterError(f"{what}: its {key} are {entry[key]!r}, but a list of texts is expected")
    for key, kind in (("robot", str), ("name", str), ("rpc_port", int)):
        if not isinstance(entry[key], kind):
            expected = "a text" if kind is str else "a number"
            raise ParameterError(f"{what}: its {key} is {entry[key]!r}, but {expected} is expected")


#: Parameters that are lists of entries, with the check of one.
_ENTRIES = (("members", _check_member), ("exports", _check_export), ("channels", _check_channel))


# The parameters of other robots that are copied here

CROSSING = 100  # names from one robot
_CROSSING_NAME = re.compile(r"(?:/[A-Za-z][A-Za-z0-9_]*)+")
#: Never copied, and nothing in them: they describe this roscore, the time here, or the work of the nodes of the exchange.
NEVER_CROSSING = (
    "/run_id",
    "/rosversion",
    "/rosdistro",
    "/roslaunch",
    "/use_sim_time",
    "/do_not_sync",
    "/rosfleet_multimaster",
    "/master_discovery",
    "/master_sync",
    "/master_relay",
)


def problem_of_parameter(name: Any) -> str:
    """The reason that keeps a parameter of this name from crossing; empty if it may cross."""
    if not isinstance(name, str) or len(name) > 255 or not _CROSSING_NAME.fullmatch(name):
        return "it is no whole name such as /robot_description"
    if "/" + name.split("/")[1] in NEVER_CROSSING:
        return "it belongs to the roscore or to the exchange itself"
    return ""


def _check_crossing(entries: Sequence[Mapping[str, Any]]) -> None:
    """Raise ParameterError if an entry cannot be meant, or if two want one name."""
    everything: List[str] = []
    sources = [(entry.get("from"), entry.get("as", "")) for entry in entries]
    for number, entry in enumerate(entries, 1):
        what = f"entry {number} of ~sync_parameters"
        namespace = _check_source(what, entry)
        if sources.index((entry["from"], namespace)) + 1 < number:
            raise ParameterError(
                f"{what} is for {entry['from']!r} once more, but one entry for each master and namespace is expected"
            )
        everything += [namespace + name for name in entry["names"]]
    ordered = sorted(name + "/" for name in everything)
    for one, other in zip(ordered, ordered[1:]):
        if other.startswith(one):
            raise ParameterError(
                f"~sync_parameters has {other[:-1]} twice, or in {one[:-1]}, but each one once is expected"
            )


def _check_source(what: str, entry: Mapping[str, Any]) -> str:
    """Check one entry; its namespace."""
    names, namespace = entry.get("names"), entry.get("as", "")
    if set(entry) - {"as"} != {"from", "names"} or not isinstance(entry["from"], str) or not _texts(names):
        raise ParameterError(f"{what} is {entry!r}, but from, a master, and names, a list of texts, are expected")
    if not isinstance(namespace, str) or (namespace and problem_of_parameter(namespace)):
        raise ParameterError(f"{what} has {namespace!r} as its as, but a namespace such as /kobuki1 is expected")
    if len(entry["names"]) > CROSSING:
        raise ParameterError(f"{what} has {len(entry['names'])} names, but at most {CROSSING} are expected")
    for name in entry["names"]:
        if problem_of_parameter(name):
            raise ParameterError(f"{what} has {name!r}, but {problem_of_parameter(name)}")
    return namespace


def _is_network(text: str) -> bool:
    try:
        ipaddress.IPv4Network(text)
    except ValueError:
        return False
    return True
