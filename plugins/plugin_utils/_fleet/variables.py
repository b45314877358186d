# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The variables of the fleet, specified once: what may be set, where, how it is read, what it means.

The table in the README is written from here.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet import exports
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.values import Unexpected, nearest

PREFIX = "multimaster_"
# Set by the preflight role for the other roles; not for an inventory.
RESERVED = ("multimaster_fleet", "multimaster_info", "multimaster_plan")

FILTERS = tuple(sorted(exports.FILTERS))

_NAME = re.compile(r"(?!-)[a-z0-9-]{1,63}(?<!-)(\.(?!-)[a-z0-9-]{1,63}(?<!-))*", re.IGNORECASE)


def _text(value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise Unexpected("a text that is not empty")
    return str(value)


def _name(value: Any) -> str:
    if not isinstance(value, str) or not _NAME.fullmatch(value) or value.replace(".", "").isdigit():
        raise Unexpected("a host name: letters, digits and hyphens (RFC 1123), and no address")
    return str(value)


def _names(value: Any) -> list[str]:
    if isinstance(value, str) or not isinstance(value, (list, tuple)):
        raise Unexpected("a list of host names")
    return [_name(item) for item in value]


def _address(value: Any) -> str:
    try:
        address = ipaddress.ip_address(_text(value))
    except ValueError:
        raise Unexpected("an IPv4 address such as 192.168.1.229") from None
    if address.version != 4 or address.is_loopback or address.is_multicast or address.is_unspecified:
        raise Unexpected("the IPv4 address of one computer, such as 192.168.1.229")
    return str(address)


def _gateway(value: Any) -> str:
    try:
        return _name(value)
    except Unexpected:
        pass
    try:
        return _address(value)
    except Unexpected:
        raise Unexpected("the name of a computer of the robot, or the address of another device") from None


def _network(value: Any) -> str:
    try:
        network = ipaddress.ip_network(_text(value))
    except ValueError:
        raise Unexpected("an IPv4 network such as 192.168.1.0/24, without host bits") from None
    if network.version != 4 or network.prefixlen > 30:
        raise Unexpected("an IPv4 network of several addresses, such as 192.168.1.0/24")
    return str(network)


def _group(value: Any) -> str:
    try:
        address = ipaddress.ip_address(_text(value))
    except ValueError:
        raise Unexpected("an IPv4 multicast group between 224.0.0.0 and 239.255.255.255") from None
    if address.version != 4 or not address.is_multicast or str(address) == "224.0.0.0":
        raise Unexpected("an IPv4 multicast group between 224.0.0.1 and 239.255.255.255")
    return str(address)


def _number(kind: type[int] | type[float], low: float, high: float) -> Callable[[Any], float]:
    def read(value: Any) -> float:
        expected = Unexpected(f"{'a whole number' if kind is int else 'a number'} from {low} to {high}")
        if isinstance(value, bool) or not isinstance(value, (kind, int, str)):
            raise expected
        try:
            number = kind(value)
        except ValueError:
            raise expected from None
        if not low <= number <= high:
            raise expected
        return number

    return read


def _switch(value: Any) -> bool:
    if isinstance(value, bool):
        return bool(value)
    if isinstance(value, str) and value.lower() in ("true", "yes", "on"):
        return True
    if isinstance(value, str) and value.lower() in ("false", "no", "off"):
        return False
    raise Unexpected("true or false")


def _choice(*choices: str) -> Callable[[Any], str]:
    def read(value: Any) -> str:
        if value not in choices:
            raise Unexpected("one of " + ", ".join(choices))
        return str(value)

    return read


def _setup(value: Any) -> str:
    if value in ("auto", "debian"):
        return str(value)
    if not isinstance(value, str) or not value.startswith("/") or ".." in value.split("/"):
        raise Unexpected("auto, debian, or the absolute path of a set-up file such as /opt/ros/noetic/setup.bash")
    return str(value)


def _filters(value: Any) -> dict[str, list[str]]:
    if not isinstance(value, Mapping):
        raise Unexpected("a mapping of filters, such as {ignore_topics: [/tf]}")
    read = {}
    for name, patterns in value.items():
        if name not in FILTERS:
            raise Unexpected(f"filters named {', '.join(FILTERS)}, but there is '{name}'{nearest(str(name), FILTERS)}")
        if isinstance(patterns, str) or not isinstance(patterns, (list, tuple)):
            raise Unexpected(f"a list of patterns at '{name}', such as [/tf, '/camera/*']")
        for pattern in patterns:
            if not isinstance(pattern, str) or not pattern.strip():
                raise Unexpected(f"patterns at '{name}' that are texts and not empty")
            try:
                re.compile(pattern.strip().replace("*", ".*"))
            except re.error as problem:
                raise Unexpected(f"regular expressions at '{name}', but '{pattern}' is none ({problem})") from None
        read[str(name)] = [str(pattern) for pattern in patterns]
    return read


@dataclass(frozen=True)
class Variable:
    """One variable of the fleet."""

    name: str
    scope: str  # "fleet": equal everywhere; "robot": equal on the computers of a robot; "computer"
    read: Callable[[Any], Any]
    default: Any  # None: computed, or required; the description says which
    description: str
    example: str


VARIABLES = (
    Variable(
        "multimaster_address",
        "computer",
        _address,
        None,
        "Required. The address of the computer that the other computers reach it by.",
        "192.168.1.229",
    ),
    Variable(
        "multimaster_aliases",
        "computer",
        _names,
        [],
        "Further names of the computer, for the hosts file of every computer.",
        "[kobuki1]",
    ),
    Variable(
        "multimaster_common_network",
        "fleet",
        _network,
        None,
        "Required. The network that all robots share (section 3.1 of the report).",
        "192.168.1.0/24",
    ),
    Variable(
        "multimaster_router",
        "fleet",
        _address,
        None,
        "The address in the common network of the router that manages it, where that is a device of another make: "
        "`playbooks/router_config.yml` writes its configuration. Default: the host of the group `routers`, if there is one.",
        "192.168.1.1",
    ),
    Variable(
        "multimaster_transport",
        "fleet",
        _choice("both", "multicast", "unicast"),
        "both",
        "How the discovery nodes find each other: by the multicast group, by unicast to the master of every robot, or both.",
        "unicast",
    ),
    Variable(
        "multimaster_multicast_group",
        "fleet",
        _group,
        "226.0.0.0",
        "The multicast group of the discovery nodes. The report uses 224.0.0.1, which no switch ever prunes.",
        "224.0.0.1",
    ),
    Variable(
        "multimaster_multicast_port",
        "fleet",
        _number(int, 1024, 65535),
        11511,
        "The UDP port of the discovery nodes.",
        "11511",
    ),
    Variable(
        "multimaster_multicast_routing",
        "fleet",
        _choice("none", "smcroute"),
        "none",
        "Whether the gateways pass the multicast group on between the networks (by smcroute, which must be installed there). "
        "It takes a group outside 224.0.0.0/24. Without it, masters behind gateways are found by unicast.",
        "smcroute",
    ),
    Variable(
        "multimaster_answer_broadcast_pings",
        "fleet",
        _switch,
        True,
        "Whether the computers answer pings to broadcast and multicast addresses, so that `ping 224.0.0.1` shows them. "
        "The report asks for it; discovery does not need it.",
        "false",
    ),
    Variable(
        "multimaster_advertise",
        "fleet",
        _choice("name", "address"),
        "name",
        "Whether ROS on the computers advertises host names (ROS_HOSTNAME) or addresses (ROS_IP).",
        "address",
    ),
    Variable(
        "multimaster_heartbeat_hz",
        "fleet",
        _number(float, 0.02, 25.5),
        1.0,
        "Heartbeats of a discovery node per second. A change is announced at once, whatever the rate.",
        "0.5",
    ),
    Variable(
        "multimaster_offline_after",
        "fleet",
        _number(float, 3, 3600),
        None,
        "Seconds after the loss of a robot until its topics and services are withdrawn from the others. They return with it. "
        "Default: 5, or the time of two heartbeats where that is longer; 65 below 0.1 heartbeats a second.",
        "30",
    ),
    Variable(
        "multimaster_network",
        "robot",
        _network,
        None,
        "The robot's own network, where it has several computers behind a gateway. Default: none, its computers are in the "
        "common network.",
        "192.168.11.0/24",
    ),
    Variable(
        "multimaster_gateway",
        "robot",
        _gateway,
        None,
        "What connects the robot's own network with the common network: the name of a computer of the robot, or the address "
        "in the robot's network of a device that is no computer of the inventory. Required with `multimaster_network`.",
        "tibi-visio",
    ),
    Variable(
        "multimaster_common_address",
        "robot",
        _address,
        None,
        "The address of the robot's gateway in the common network. Required with `multimaster_network`.",
        "192.168.1.201",
    ),
    Variable(
        "multimaster_routes",
        "robot",
        _choice("default", "networks", "existing"),
        "default",
        "Which routes the computers of the robot get: `default` is the report's, a default route by the gateway on each inner "
        "computer; `networks` only routes to the common network and the other robots, where the default route leads elsewhere; "
        "`existing` none, because something else makes them.",
        "networks",
    ),
    Variable(
        "multimaster_master",
        "robot",
        _name,
        None,
        "The computer of the robot that runs the roscore. Default: the only computer; required where there are several.",
        "kobuki1computer",
    ),
    Variable(
        "multimaster_roscore",
        "robot",
        _choice("managed", "existing"),
        "managed",
        "Whether the collection runs the roscore as a service, or uses one that something else starts.",
        "existing",
    ),
    Variable(
        "multimaster_roscore_port", "robot", _number(int, 1024, 65235), 11311, "The TCP port of the roscore.", "11311"
    ),
    Variable(
        "multimaster_rpc_port",
        "robot",
        _number(int, 1024, 65535),
        None,
        "The TCP port on which the discovery node answers the others. Default: the port of the roscore + 300.",
        "11611",
    ),
    Variable(
        "multimaster_filters",
        "robot",
        _filters,
        {},
        "What this robot takes from the others: lists of regular expressions in which `*` stands for any text, by "
        + ", ".join(f"`{name}`" for name in FILTERS)
        + ". An action is its five topics.",
        "{ignore_topics: [/tf], sync_actions: [/move_base]}",
    ),
    Variable(
        "multimaster_exports",
        "robot",
        exports.read,
        None,
        "What this robot gives to which others: a list of entries with `topics`, `services` and `actions` (names in which `*` "
        "stands for any text) and `to`, a list of robots (default: every other). Default: everything to everybody, as in the "
        "report; `[]` is nothing. See docs/data_flow.md.",
        "[{topics: [/tibi/pose], actions: [/tibi/dock], to: [dabo]}]",
    ),
    Variable(
        "multimaster_provider",
        "robot",
        _choice("bundled", "fkie_apt", "fkie_existing"),
        "bundled",
        "Whose discovery and sync nodes run: the collection's own (`bundled`), multimaster_fkie from the package sources that the "
        "robot has (`fkie_apt`), or an installation of it that `multimaster_ros_setup` leads to (`fkie_existing`). See "
        "docs/providers.md.",
        "fkie_existing",
    ),
    Variable(
        "multimaster_ros_setup",
        "computer",
        _setup,
        "auto",
        "Where ROS is: `auto` finds /opt/ros or Debian's packages, `debian` takes Debian's packages, "
        "a path is a prefix or the set-up file of a workspace.",
        "/home/robot/ws/devel/setup.bash",
    ),
)

BY_NAME = {variable.name: variable for variable in VARIABLES}


def markdown_table() -> str:
    """The variables as the table of the README (GitHub's Markdown)."""
    rows = ["| variable | set for | default | meaning | example |", "|---|---|---|---|---|"]
    for variable in VARIABLES:
        default = "" if variable.default is None else f"`{_yaml(variable.default)}`"
        rows.append(
            f"| `{variable.name}` | {variable.scope} | {default} | {variable.description} | `{variable.example}` |"
        )
    return "\n".join(rows) + "\n"


def _yaml(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
