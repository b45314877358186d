# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# Private to this collection: may change at any time.

"""What each computer needs, computed from the fleet: the only place where the layout becomes configuration.

Pure: a Fleet in, plain data (for Ansible's variables) out.
"""

from __future__ import annotations

import ipaddress
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet import Computer, Fleet, Robot, Router

# actionlib: an action NAME is these five topics (section 2 of the report).
ACTION_TOPICS = ("goal", "cancel", "status", "feedback", "result")

# Upstream's timeout_factor: at one heartbeat a second, a robot that lost its power is offline after 5 x 2 = 10 s, and
# ten datagrams in a row do not get lost.
SILENCE = 2

# What the verification publishes while it runs, so that it can tell under a white list too whether topics cross.
VERIFICATION_TOPICS = "/multimaster_verify/*"

# The parts of multimaster_info that preflight needs: of every computer, and of those with ROS.
LOOKED_AT = ["system", "owned", "interfaces", "ways", "multicast_routing"]
LOOKED_AT_WITH_ROS = ["ros", "ports", "exports", "sshd", "environment"]

# Where the roles install and what the nodes are called on the machine.
LIBRARY = "/usr/local/lib/rosfleet-multimaster"
CONFIGURATION = "/etc/rosfleet-multimaster"


def plan(fleet: Fleet) -> dict[str, Any]:
    """The plan of the fleet: what all share, and one entry per computer, the router's too, under `computers`.

    Lists that every computer needs are there once, so the plan grows with the number of computers.
    """
    return {
        "hosts_entries": [
            {"address": computer.address, "names": [computer.name, *computer.aliases]} for computer in fleet.computers
        ],
        "masters": [_master(fleet, robot) for robot in fleet.robots],
        "common_network": fleet.common_network,
        "networks": [
            {
                "robot": robot.name,
                "network": robot.network,
                "gateway": robot.gateway.address,
                "common_address": robot.gateway.common_address,
                "device": not robot.gateway.name,
            }
            for robot in fleet.robots
            if robot.gateway
        ],
        "router": {"name": fleet.router.name, "address": fleet.router.address} if fleet.router else {},
        "transport": fleet.transport,
        "multicast_group": fleet.multicast_group,
        "multicast_port": fleet.multicast_port,
        "multicast_routing": fleet.multicast_routing,
        "members": [_member(fleet, robot, computer) for robot in fleet.robots for computer in robot.computers],
        "computers": {
            **{
                computer.name: _computer(fleet, robot, computer)
                for robot in fleet.robots
                for computer in robot.computers
            },
            **({fleet.router.name: _router(fleet, fleet.router)} if fleet.router and fleet.router.name else {}),
        },
    }


def _member(fleet: Fleet, robot: Robot, computer: Computer) -> dict[str, Any]:
    """A computer as the others see it, and whether it takes part in discovery and hears the group of the others."""
    is_master = computer == robot.master
    routed = fleet.multicast_routing != "none" and robot.gateway is not None and bool(robot.gateway.name)
    return {
        "name": computer.name,
        "robot": robot.name,
        "address": computer.address,
        "network": robot.network,
        "discovery_address": computer.discovery_address,
        "discovery": is_master or bool(computer.common_address),
        "multicast": bool(computer.common_address) or (is_master and routed),
    }


def _master(fleet: Fleet, robot: Robot) -> dict[str, Any]:
    """A master as every discovery node is expected to list it."""
    return {
        "robot": robot.name,
        "computer": robot.master.name,
        "address": robot.master.discovery_address,
        "name": master_name(robot),
        "uri": master_uri(fleet, robot) + "/",
        "monitor_uri": f"http://{robot.master.discovery_address}:{robot.rpc_port}",
        "rpc_port": robot.rpc_port,
    }


def master_name(robot: Robot) -> str:
    """The name of a robot's master: its computer, and the port where that is not ROS's usual one (as upstream does)."""
    name = robot.master.name.lower()
    return name if robot.roscore_port == 11311 else f"{name}_{robot.roscore_port}"


def master_uri(fleet: Fleet, robot: Robot) -> str:
    """ROS_MASTER_URI on all computers of a robot (section 3.2 of the report)."""
    return f"http://{_advertised(fleet, robot.master)}:{robot.roscore_port}"


def _advertised(fleet: Fleet, computer: Computer) -> str:
    return computer.name if fleet.advertise == "name" else computer.address


def _computer(fleet: Fleet, robot: Robot, computer: Computer) -> dict[str, Any]:
    is_master = computer == robot.master
    is_gateway = robot.gateway is not None and robot.gateway.name == computer.name
    interfaces = [{"network": robot.network, "address": computer.address}]
    if is_gateway:
        interfaces.append({"network": fleet.common_network, "address": computer.common_address})
    existing = robot.routes == "existing"
    expected = _expected(fleet, robot, computer) if existing else []
    return {
        "computer": computer.name,
        "robot": robot.name,
        "address": computer.address,
        "common_address": computer.common_address,
        "network": robot.network,
        "networks": interfaces,
        "is_master": is_master,
        "is_gateway": is_gateway,
        "is_router": False,
        "roscore": robot.roscore,
        "roscore_port": robot.roscore_port,
        "ros_setup": computer.ros_setup,
        "sysctl": _sysctl(fleet) + (FORWARDING if is_gateway else []),
        "routes": [] if existing else _robot_routes(fleet, robot, computer),
        "routes_expected": expected,
        "look_at": {
            "parts": LOOKED_AT + LOOKED_AT_WITH_ROS,
            "destinations": [str(ipaddress.ip_network(route["destination"])[1]) for route in expected],
        },
        "multicast_routing": _multicast_routing(fleet, computer) if is_gateway else {},
        "environment": {
            "ROS_MASTER_URI": master_uri(fleet, robot),
            ("ROS_HOSTNAME" if fleet.advertise == "name" else "ROS_IP"): _advertised(fleet, computer),
        },
        "ports": _ports(fleet, robot) if is_master else [],
        "services": _services(robot) if is_master else [],
        "discovery": _discovery(fleet, robot) if is_master else {},
        "sync": _sync(robot) if is_master else {},
    }


def _router(fleet: Fleet, router: Router) -> dict[str, Any]:
    """The router of the common network (section 4.2 of the report): no computer of a robot, so nothing of ROS."""
    return {
        "computer": router.name,
        "robot": "",
        "address": router.address,
        "common_address": router.address,
        "network": fleet.common_network,
        "networks": [{"network": fleet.common_network, "address": router.address}],
        "is_master": False,
        "is_gateway": False,
        "is_router": True,
        "roscore": "existing",
        "roscore_port": 0,
        "ros_setup": "auto",
        "sysctl": FORWARDING + NO_REDIRECTS,
        "routes": [
            {"destination": robot.network, "gateway": robot.gateway.common_address}
            for robot in fleet.robots
            if robot.gateway
        ],
        "routes_expected": [],
        "look_at": {"parts": LOOKED_AT, "destinations": []},
        "multicast_routing": {},
        "environment": {},
        "ports": [],
        "services": [],
        "discovery": {},
        "sync": {},
    }


def _robot_routes(fleet: Fleet, robot: Robot, computer: Computer) -> list[dict[str, str]]:
    """The routes of a robot's computer: behind a gateway the report's default route, unless the robot wants networks."""
    if robot.gateway and not computer.common_address and robot.routes == "default":
        return [{"destination": "default", "gateway": robot.gateway.address}]
    return _network_routes(fleet, robot, computer)


def _network_routes(fleet: Fleet, robot: Robot, computer: Computer) -> list[dict[str, str]]:
    """One route per network that the computer is not in.

    On the common network they lead to the other robot's gateway itself: a way by the router would come back on the
    interface that it came from.
    """
    others = [other for other in fleet.robots if other.gateway and other != robot]
    if computer.common_address:
        return [
            {"destination": other.network, "gateway": other.gateway.common_address} for other in others if other.gateway
        ]
    networks = [fleet.common_network, *(other.network for other in others)]
    return [{"destination": network, "gateway": robot.gateway.address} for network in networks if robot.gateway]


def _expected(fleet: Fleet, robot: Robot, computer: Computer) -> list[dict[str, Any]]:
    """The routes that something else makes: on the common network they may also lead to its router."""
    also = [fleet.router.address] if computer.common_address and fleet.router else []
    return [
        {"destination": route["destination"], "gateways": [route["gateway"], *also]}
        for route in _network_routes(fleet, robot, computer)
    ]


def _multicast_routing(fleet: Fleet, gateway: Computer) -> dict[str, Any]:
    """What a gateway passes on between the robot's network and the common network."""
    if fleet.multicast_routing == "none":
        return {}
    return {"group": fleet.multicast_group, "addresses": [gateway.address, gateway.common_address]}


# Section 4.2 of the report. The reverse-path filter is loose: strict, it drops what comes back on another interface
# (kernel: Documentation/networking/ip-sysctl, rp_filter; the larger value of `all` and the interface counts).
FORWARDING = [
    {"name": "net.ipv4.ip_forward", "value": "1"},
    {"name": "net.ipv4.conf.all.rp_filter", "value": "2"},
]
# The router's packets turn round on the common network, and an ICMP redirect for each of them helps nobody: `ping -c1`
# takes it for an error. The kernel sends them where `all` or the interface has 1.
NO_REDIRECTS = [
    {"name": "net.ipv4.conf.all.send_redirects", "value": "0"},
    {"name": "net.ipv4.conf.default.send_redirects", "value": "0"},
    {"name": "net.ipv4.conf.{common}.send_redirects", "value": "0"},  # preflight knows the interface
]


def _sysctl(fleet: Fleet) -> list[dict[str, str]]:
    """Section 3.2 of the report: whether a computer answers `ping 224.0.0.1`; multicast itself does not depend on it."""
    return [{"name": "net.ipv4.icmp_echo_ignore_broadcasts", "value": "0" if fleet.answer_broadcast_pings else "1"}]


def _ports(fleet: Fleet, robot: Robot) -> list[dict[str, Any]]:
    """The ports that the services of the robot's master listen on."""
    return [
        {"protocol": "tcp", "port": robot.roscore_port},
        {"protocol": "udp", "port": fleet.multicast_port},
        {"protocol": "tcp", "port": robot.rpc_port},
    ]


def _services(robot: Robot) -> list[str]:
    """The services of the robot's master, in the order in which they start."""
    return (["roscore"] if robot.roscore == "managed" else []) + ["discovery", "sync"]


def _discovery(fleet: Fleet, robot: Robot) -> dict[str, Any]:
    """The private parameters of master_discovery: upstream's names, pinned to the interface of the common network."""
    multicast = fleet.transport in ("both", "multicast")
    peers = [other.master.discovery_address for other in fleet.robots if other != robot]
    return {
        "name": master_name(robot),
        "mcast_group": fleet.multicast_group,
        "mcast_port": fleet.multicast_port,
        "interface": robot.master.discovery_address,
        "rpc_port": robot.rpc_port,
        "heartbeat_hz": fleet.heartbeat_hz,
        "timeout_factor": SILENCE,
        "send_mcast": multicast,
        "listen_mcast": multicast,
        "robot_hosts": peers if fleet.transport in ("both", "unicast") else [],
    }


def _sync(robot: Robot) -> dict[str, Any]:
    """The private parameters of master_sync: the filters in upstream's names, an action as its five topics."""
    parameters: dict[str, Any] = {}
    for name, patterns in robot.filters.items():
        rule, _underscore, what = name.partition("_")
        if what == "actions":
            topics = [f"{pattern.rstrip('/')}/{topic}" for pattern in patterns for topic in ACTION_TOPICS]
            parameters.setdefault(f"{rule}_topics", []).extend(topics)
        else:
            target = "ignore_type" if name == "ignore_types" else name
            parameters.setdefault(target, []).extend(patterns)
    if parameters.get("sync_topics") or parameters.get("sync_nodes"):
        parameters.setdefault("sync_topics", []).append(VERIFICATION_TOPICS)
    return parameters
