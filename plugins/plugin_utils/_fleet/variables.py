# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The variables of the fleet: place, kind, default and meaning of each.

A variable is a field of one of three classes. The class says where it is set. Its name is `multimaster_` and the name of
the field. To add one, add a field. Reading, the checks for agreement and the table in docs/operate/variables.md follow.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from ipaddress import IPv4Address, IPv4Network
from typing import Any

from . import kinds
from .exports import Export, read_exports, read_frames

PREFIX = "multimaster_"
# Set by the preflight role for the other roles; not for an inventory.
RESERVED = ("multimaster_fleet", "multimaster_info", "multimaster_plan")


@dataclass(frozen=True)
class Variable:
    """One variable of the fleet."""

    name: str
    scope: str  # "fleet": equal everywhere; "robot": equal on the computers of a robot; "computer"
    read: Callable[[Any], Any]
    default: Any  # None: computed, required or not set; the description says which
    description: str
    example: str


_FIELD = partial(field)  # pylint takes a plain call beside a dataclass for a mistake


def row(read: Callable[[Any], Any], description: str, example: str, default: Any = None) -> Any:
    """Return the field of a variable. `default` is a value as an inventory would have it."""
    return _FIELD(metadata={"row": (read, default, description, example)})


def word(choices: tuple[str, ...], description: str, example: str) -> Any:
    """Return the field of a variable that is one of some words. The first is the default."""
    return row(kinds.choice(*choices), description, example, choices[0])


@dataclass(frozen=True)
class ComputerVariables:
    """The variables of one computer."""

    address: IPv4Address = row(
        kinds.address,
        "Required. The address of the computer that the other computers reach it by.",
        "192.168.1.229",
    )
    aliases: list[str] = row(
        kinds.names,
        "Further names of the computer, for the hosts file of every computer.",
        "[kobuki1]",
        default=[],
    )
    firewall_also: tuple[IPv4Network, ...] = row(
        kinds.sources,
        "Addresses and networks that the packet filter of this computer lets in besides, such as a laser scanner's. They do not "
        "belong to the fleet.",
        "[192.168.2.201]",
        default=[],
    )
    firewall_ports: tuple[str, ...] = row(
        kinds.ports,
        "Ports from 1024 up that the packet filter of this computer leaves open to everybody.",
        "[51820/udp]",
        default=[],
    )
    ros_setup: str = row(
        kinds.setup,
        "The place of ROS. `auto` finds /opt/ros or Debian's packages. `debian` takes Debian's packages. A path is a prefix, the "
        "set-up file of a workspace, or an environment of conda with RoboStack's ROS.",
        "/home/robot/ws/devel/setup.bash",
        default="auto",
    )
    shells: str = word(
        ("all", "names", "none"),
        "What shells, desktops and commands by ssh get. `all`: the ROS that `multimaster_ros_setup` leads to, as services get it. `names`: "
        "`ROS_MASTER_URI` and the variable of `multimaster_advertise` (ROS_HOSTNAME or ROS_IP) alone, so people with two ROS source the one "
        "that they want. `none`: nothing. Services always get all.",
        "names",
    )

    endpoint: IPv4Address | None = row(
        kinds.endpoint,
        "The address by which the other computers reach it outside of the tunnel (`multimaster_tunnel`). Without it, or with `none`, the "
        "computer speaks first and may change its address at any time, as by DHCP, in another wifi or behind a provider. Default: its address "
        "in the common network where `multimaster_tunnel_network` is set.",
        "172.16.4.29",
    )


@dataclass(frozen=True)
class FleetVariables:
    """The variables that are equal on all computers of the fleet."""

    common_network: IPv4Network = row(
        kinds.network,
        "Required. The network that all robots share (section 3.1 of the report).",
        "192.168.1.0/24",
    )
    router: IPv4Address | None = row(
        kinds.address,
        "The address of the router in the common network, where the router is a device that Ansible does not manage. "
        "`rosfleet.multimaster.router_config` writes its configuration. Default: the host of the group `routers`, if there is one.",
        "192.168.1.1",
    )
    transport: str = word(
        ("both", "multicast", "unicast"),
        "The way in which the discovery nodes find each other: `multicast` by the group, `unicast` by datagrams to the master of each "
        "robot, `both` by both.",
        "unicast",
    )
    multicast_group: IPv4Address = row(
        kinds.group,
        "The multicast group of the discovery nodes. The report uses 224.0.0.1, which no switch ever prunes.",
        "224.0.0.1",
        default="226.0.0.0",
    )
    multicast_port: int = row(
        kinds.number(int, 1024, 65535),
        "The UDP port of the discovery nodes.",
        "11511",
        default=11511,
    )
    multicast_routing: str = word(
        ("none", "smcroute"),
        "`smcroute`: the gateways pass the multicast group on between the networks. The program smcroute must be installed there, and"
        " the group must be outside 224.0.0.0/24. With `none`, masters behind gateways are found by unicast.",
        "smcroute",
    )
    answer_broadcast_pings: bool = row(
        kinds.switch,
        "`true`: the computers answer pings to broadcast and multicast addresses, so `ping 224.0.0.1` shows them. The report asks for"
        " it. Discovery does not need it.",
        "false",
        default=True,
    )
    firewall: str = word(
        ("none", "fleet"),
        "`fleet`: a packet filter guards the TCP and UDP ports from 1024 up. Only the computers of the fleet and `multimaster_allow` "
        "reach them. Ports of ssh and those below 1024 stay as they are. See docs/operate/security.md.",
        "fleet",
    )
    advertise: str = word(
        ("name", "address"),
        "ROS on the computers advertises host names (ROS_HOSTNAME) with `name`, and addresses (ROS_IP) with `address`.",
        "address",
    )
    strangers: str = word(
        ("ignore", "allow"),
        "Masters that are not in the inventory: `ignore` reports them and registers nothing of them, `allow` exchanges with them as "
        "with robots of the inventory. See docs/operate/security.md.",
        "allow",
    )
    allow: tuple[IPv4Network, ...] = row(
        kinds.sources,
        "Addresses and networks of computers that belong to the fleet without being in the inventory, such as laptops and robots with"
        " upstream's nodes. Their masters are exchanged with. Their nodes may use a robot's roscore.",
        "[192.168.1.77, 192.168.2.0/24]",
        default=[],
    )
    diagnostics: str = word(
        ("local", "exchanged", "none"),
        "`local`: the nodes publish links, clocks and refusals on `/diagnostics`, and that topic stays on each robot. `exchanged`: it"
        " crosses like any topic. `none`: the nodes publish nothing there, and it crosses. See docs/operate/metrics.md.",
        "exchanged",
    )
    clock: str | None = row(
        kinds.text,  # compared with the computers and robots: that sentence names them
        "The computer whose time all others follow, by chrony, or a robot, whose master's computer it is then. It keeps the time sources "
        "that it has, and gives its own time where it reaches none. Default: nobody's clock is touched. See docs/operate/clock.md.",
        "tibi-nav",
    )
    tunnel: str = word(
        ("none", "wireguard"),
        "`wireguard`: a tunnel of WireGuard between the computers in the common network, which the collection makes. See "
        "docs/operate/hostile_networks.md.",
        "wireguard",
    )
    tunnel_network: IPv4Network | None = row(
        kinds.network,
        "The network of the tunnel. The common network carries it, and each computer has the same place in both: 192.168.1.229 is 10.77.0.229. "
        "Default: the common network is the tunnel itself, with its addresses, and `multimaster_endpoint` says where computers are outside of it.",
        "10.77.0.0/24",
    )
    tunnel_port: int = row(
        kinds.number(int, 1024, 65535),
        "The UDP port of the tunnel.",
        "51820",
        default=51820,
    )
    tunnel_hub: str | None = row(
        kinds.text,  # compared with the computers: that sentence names them
        "A computer of the common network that all others reach at its `multimaster_endpoint`, such as one with a public address. Robots "
        "without an endpoint are reached through it, in whatever network they are. Default: they speak first to each of the others.",
        "base-pc",
    )
    heartbeat_hz: float = row(
        kinds.number(float, 0.02, 25.5),
        "Heartbeats of a discovery node per second. A change is announced at once, whatever the rate.",
        "0.5",
        default=1.0,
    )
    offline_after: float = row(
        kinds.number(float, 3, 3600),
        "Seconds after the loss of a robot until its topics and services are withdrawn from the others. They return with it. "
        "Default: 5, or the time of two heartbeats where that is longer; 65 below 0.1 heartbeats a second.",
        "30",
    )


@dataclass(frozen=True)
class RobotVariables:
    """The variables that are equal on all computers of a robot."""

    network: IPv4Network | None = row(
        kinds.network,
        "The robot's own network, where the robot has several computers behind a gateway. Without it, its computers are in the common"
        " network.",
        "192.168.11.0/24",
    )
    gateway: str | IPv4Address | None = row(
        kinds.gateway,
        "The gateway between the robot's own network and the common network: the name of a computer of the robot, or the address of "
        "another device in the robot's network. Required with `multimaster_network`.",
        "tibi-visio",
    )
    common_address: IPv4Address | None = row(
        kinds.address,
        "The address of the robot's gateway in the common network. Required with `multimaster_network`.",
        "192.168.1.201",
    )
    routes: str = word(
        ("default", "networks", "existing"),
        "The routes that the computers of the robot get. `default`: a default route by the gateway on each inner computer, as in the "
        "report. `networks`: only routes to the common network and the other robots, where the default route leads elsewhere. "
        "`existing`: no route, because something else makes them.",
        "networks",
    )
    master: str | None = row(
        kinds.text,  # compared with the computers of the robot: that sentence names them
        "The computer of the robot that runs the roscore. Default: the only computer. Required where there are several.",
        "kobuki1computer",
    )
    sealed: Mapping[str, kinds.SealedComputer] = row(
        kinds.seals,
        "Computers of the robot where one may not log in, by their names: the address of each, or its `address` and `aliases`. They "
        "are no hosts of the inventory. One of them may be `multimaster_master`. See docs/operate/sealed.md.",
        "{hsrb: 192.168.1.40}",
        default={},
    )
    companion: str | None = row(
        kinds.name,
        "The computer of the robot that runs discovery and sync for a roscore on a sealed computer. Default: the only host of the robot.",
        "hsr-pc",
    )
    roscore: str = word(
        ("managed", "existing"),
        "`managed`: the collection runs the roscore as a service. `existing`: something else starts it.",
        "existing",
    )
    roscore_port: int = row(
        kinds.number(int, 1024, 65235),
        "The TCP port of the roscore.",
        "11311",
        default=11311,
    )
    rpc_port: int = row(
        kinds.number(int, 1024, 65535),
        "The TCP port on which the discovery node answers the others. Default: the port of the roscore + 300.",
        "11611",
    )
    filters: Mapping[str, list[str]] = row(
        kinds.filters,
        "What this robot takes from the others: lists of regular expressions in which `*` stands for any text, by "
        + ", ".join(f"`{name}`" for name in kinds.FILTERS)
        + ". An action is its five topics.",
        "{ignore_topics: [/tf], sync_actions: [/move_base]}",
        default={},
    )
    exports: tuple[Export, ...] | None = row(
        read_exports,
        "What this robot gives to which others: a list of entries with `topics`, `services` and `actions` (names in which `*` stands "
        "for any text), `parameters` (whole names) and `to`, a list of robots (default: each other robot). Without the variable, the "
        "robot gives everything but parameters to each other robot, as in the report. `[]` is nothing. See docs/operate/data_flow.md. With `as` "
        "(a namespace, or a name for each), `rate` (messages a second), `newest` or `frames` (a prefix), topics and actions cross by the border: "
        "docs/operate/identical_robots.md.",
        "[{topics: [/tibi/pose], actions: [/tibi/dock], to: [dabo]}]",
    )
    frames: tuple[str, str] | None = row(
        read_frames,
        "How the robot's frames of tf hang together with those of others that get them by an entry of `multimaster_exports` with `frames`: a "
        "frame of all, and the root of this robot's tree, which lies at the same place; or `external`, where something else publishes it. See "
        "docs/operate/identical_robots.md.",
        "{world: map}",
    )
    provider: str = word(
        ("bundled", "fkie_apt", "fkie_existing"),
        "The discovery and sync nodes of the robot. `bundled`: those of the collection. `fkie_apt`: multimaster_fkie from the package"
        " sources that the robot has. `fkie_existing`: an installation of multimaster_fkie, or of its successor fkie_mas, that"
        " `multimaster_ros_setup` leads to. See docs/operate/providers.md.",
        "fkie_existing",
    )
    metrics: str = word(
        ("none", "textfile"),
        "`textfile`: the nodes write metrics for the textfile collector of Prometheus' node_exporter. See docs/operate/metrics.md.",
        "textfile",
    )
    metrics_folder: str = row(
        kinds.folder,
        "The folder that node_exporter reads (`--collector.textfile.directory`), on the computer of the master. It must be there.",
        "/var/lib/node_exporter",
        default="/var/lib/prometheus/node-exporter",
    )


def rows(kind: type, scope: str) -> tuple[Variable, ...]:
    """Return the variables of one of the classes above."""
    return tuple(Variable(PREFIX + entry.name, scope, *entry.metadata["row"]) for entry in dataclasses.fields(kind))


OF_COMPUTER = rows(ComputerVariables, "computer")
OF_FLEET = rows(FleetVariables, "fleet")
OF_ROBOT = rows(RobotVariables, "robot")
# The order of docs/operate/variables.md, and of the sentences about a host.
VARIABLES = (*OF_COMPUTER[:2], *OF_FLEET, *OF_ROBOT, *OF_COMPUTER[2:])
BY_NAME = {row.name: row for row in VARIABLES}


def markdown_table() -> str:
    """Return the table of docs/operate/variables.md (GitHub's Markdown)."""
    lines = ["| variable | set for | default | meaning | example |", "|---|---|---|---|---|"]
    for row in VARIABLES:
        default = "" if row.default is None else f"`{_yaml(row.default)}`"
        lines.append(f"| `{row.name}` | {row.scope} | {default} | {row.description} | `{row.example}` |")
    return "\n".join(lines) + "\n"


def _yaml(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
