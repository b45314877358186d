# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What each computer needs, computed from the fleet: the only place where the layout becomes configuration.

Pure: a Fleet in, plain data (for Ansible's variables) out.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping, Sequence
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet import flows
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.exports import (
    FILTERS,
    FROM_CLIENT,
    FROM_SERVER,
    topics_of,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.filters import WHITE_LISTS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.read import Computer, Fleet, Robot, Router
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import providers
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import FleetPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plain import from_plain

# The parts of multimaster_info that preflight needs: of every computer, and of those with ROS.
LOOKED_AT = ["system", "owned", "interfaces", "ways", "multicast_routing"]
LOOKED_AT_WITH_ROS = ["ros", "packages", "ports", "exports", "sshd", "environment"]


def fleet_plan(fleet: Fleet) -> FleetPlan:
    """Return the plan of the fleet."""
    return from_plain(FleetPlan, plan(fleet))


def plan(fleet: Fleet) -> dict[str, Any]:
    """The plan of the fleet: what all share, and one entry per computer, the router's too, under `computers`.

    Lists that every computer needs are there once, so the plan grows with the number of computers.
    """
    members = [_member(fleet, robot, computer) for robot in fleet.robots for computer in robot.computers]
    return {
        "hosts_entries": [
            {"address": computer.address, "names": [computer.name, *computer.aliases]} for computer in fleet.computers
        ],
        "masters": [_master(fleet, robot) for robot in fleet.robots],
        "flows": flows.listed(fleet.flows, [robot.name for robot in fleet.robots]),
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
        "members": members,
        "listeners": _listeners(members),
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


def _listeners(members: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The computers that measure datagrams: those that take part in discovery, the hearers of the group first."""
    found = [
        {"name": member["name"], "address": member["discovery_address"], "multicast": member["multicast"]}
        for member in members
        if member["discovery"]
    ]
    return sorted(found, key=lambda listener: not listener["multicast"])


def _master(fleet: Fleet, robot: Robot) -> dict[str, Any]:
    """A master as every discovery node is expected to list it."""
    return {
        "robot": robot.name,
        "computer": robot.master.name,
        "address": robot.master.discovery_address,
        "name": robot.master_name,
        "uri": master_uri(fleet, robot) + "/",
        "monitor_uri": f"http://{robot.master.discovery_address}:{robot.rpc_port}",
        "rpc_port": robot.rpc_port,
        "declared": robot.exports is not None,
    }


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
            **providers.looked_for(robot.provider, is_master),
        },
        "multicast_routing": _multicast_routing(fleet, computer) if is_gateway else {},
        "environment": {
            "ROS_MASTER_URI": master_uri(fleet, robot),
            ("ROS_HOSTNAME" if fleet.advertise == "name" else "ROS_IP"): _advertised(fleet, computer),
        },
        "ports": _ports(fleet, robot) if is_master else [],
        "services": _services(robot) if is_master else [],
        "provider": robot.provider,
        **_parameters(fleet, robot, is_master),
        "listens": is_master or bool(computer.common_address),
    }


def _parameters(fleet: Fleet, robot: Robot, is_master: bool) -> dict[str, Any]:
    """The parameters of the nodes, in the words of the provider, and what of them it cannot do."""
    if not is_master:
        return {"discovery": {}, "sync": {}, "limits": []}
    discovery, sync = _discovery(fleet, robot), _sync(fleet, robot)
    hidden = [other.master_name for other in fleet.robots if other != robot and _restricted(fleet, other)]
    return {
        "discovery": providers.discovery(robot.provider, discovery),
        "sync": providers.sync(robot.provider, fleet, robot, sync, hidden),
        "limits": providers.limits(robot, discovery) if robot.provider in providers.UPSTREAM else [],
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
        "look_at": {"parts": LOOKED_AT, "destinations": [], **providers.looked_for("bundled", False)},
        "multicast_routing": {},
        "environment": {},
        "ports": [],
        "services": [],
        "provider": "bundled",
        "discovery": {},
        "sync": {},
        "limits": [],
        "listens": False,
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
        "name": robot.master_name,
        "mcast_group": fleet.multicast_group,
        "mcast_port": fleet.multicast_port,
        "interface": robot.master.discovery_address,
        "rpc_port": robot.rpc_port,
        "heartbeat_hz": fleet.heartbeat_hz,
        "offline_after": fleet.offline_after,
        "send_mcast": multicast,
        "listen_mcast": multicast,
        "robot_hosts": peers if fleet.transport in ("both", "unicast") else [],
        "hide_subscribers": ["*"] if _restricted(fleet, robot) else [],
        **_exports(fleet, robot),
    }


def _exports(fleet: Fleet, robot: Robot) -> dict[str, Any]:
    if robot.exports is None:
        return {}
    addresses = {other.name: _addresses(other) for other in fleet.robots}
    return {"exports": flows.served(fleet.flows, robot.name, addresses)}


def _addresses(robot: Robot) -> list[str]:
    """The addresses from which a robot's master_sync asks the others."""
    return list(dict.fromkeys(filter(None, (robot.master.address, robot.master.common_address))))


# Filters that leave no publisher out.
UNRESTRICTING = ("ignore_services", "ignore_subscribers")


def _restricted(fleet: Fleet, robot: Robot) -> bool:
    """Whether this robot exchanges no subscribers: a roscore that holds another robot's tells it whom to hear."""
    return fleet.declared or any(patterns for name, patterns in robot.filters.items() if name not in UNRESTRICTING)


def _sync(fleet: Fleet, robot: Robot) -> dict[str, Any]:
    """The private parameters of master_sync: the robot's filters, and a white list for each master that declares."""
    parameters = _filters(robot)
    if _restricted(fleet, robot):
        parameters["ignore_subscribers"] = ["*"]
    received = flows.received(fleet.flows, robot.name)
    for other in fleet.robots:
        if other.exports is None or other == robot:
            continue
        if other.name in received:
            parameters[other.master_name] = received[other.name]
            continue
        parameters.setdefault("ignore_hosts", []).append(other.master_name.replace(".", r"\."))
        if robot.filters.get("sync_hosts"):  # it would take the host back
            parameters[other.master_name] = {"ignore_nodes": ["*"]}
    return parameters


def _filters(robot: Robot) -> dict[str, list[str]]:
    """The robot's filters in upstream's names, an action as its five topics."""
    parameters: dict[str, list[str]] = {}
    for name, patterns in robot.filters.items():
        texts = topics_of(patterns, FROM_CLIENT + FROM_SERVER) if name.endswith("_actions") else patterns
        parameters.setdefault(FILTERS[name], []).extend(texts)
    if any(parameters.get(name) for name in WHITE_LISTS):
        parameters.setdefault("sync_topics", []).append(flows.VERIFICATION_TOPICS)
    return parameters
