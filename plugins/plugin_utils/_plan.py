# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# Private to this collection: may change at any time.

"""What each computer needs, computed from the fleet: the only place where the layout becomes configuration.

Pure: a Fleet in, plain data (for Ansible's variables) out.
"""

from __future__ import annotations

from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet import Computer, Fleet, Robot

# actionlib: an action NAME is these five topics (section 2 of the report).
ACTION_TOPICS = ("goal", "cancel", "status", "feedback", "result")

# Upstream's timeout_factor: at one heartbeat a second, a robot that lost its power is offline after 5 x 2 = 10 s, and
# ten datagrams in a row do not get lost.
SILENCE = 2

# What the verification publishes while it runs, so that it can tell under a white list too whether topics cross.
VERIFICATION_TOPICS = "/multimaster_verify/*"

# Where the roles install and what the nodes are called on the machine.
LIBRARY = "/usr/local/lib/rosfleet-multimaster"
CONFIGURATION = "/etc/rosfleet-multimaster"


def plan(fleet: Fleet) -> dict[str, Any]:
    """The plan of the fleet: what all share, and one entry per computer under `computers`.

    Lists that every computer needs are there once, so the plan grows with the number of computers.
    """
    return {
        "hosts_entries": [
            {"address": computer.address, "names": [computer.name, *computer.aliases]} for computer in fleet.computers
        ],
        "masters": [_master(fleet, robot) for robot in fleet.robots],
        "common_network": fleet.common_network,
        "transport": fleet.transport,
        "multicast_group": fleet.multicast_group,
        "multicast_port": fleet.multicast_port,
        "members": [
            {"name": computer.name, "robot": computer.robot, "address": computer.address}
            for computer in fleet.computers
        ],
        "computers": {
            computer.name: _computer(fleet, robot, computer) for robot in fleet.robots for computer in robot.computers
        },
    }


def _master(fleet: Fleet, robot: Robot) -> dict[str, Any]:
    """A master as every discovery node is expected to list it."""
    return {
        "robot": robot.name,
        "computer": robot.master.name,
        "address": robot.master.address,
        "name": master_name(robot),
        "uri": master_uri(fleet, robot) + "/",
        "monitor_uri": f"http://{robot.master.address}:{robot.rpc_port}",
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
    return {
        "computer": computer.name,
        "robot": robot.name,
        "address": computer.address,
        "is_master": is_master,
        "roscore": robot.roscore,
        "roscore_port": robot.roscore_port,
        "ros_setup": computer.ros_setup,
        "sysctl": _sysctl(fleet),
        "environment": {
            "ROS_MASTER_URI": master_uri(fleet, robot),
            ("ROS_HOSTNAME" if fleet.advertise == "name" else "ROS_IP"): _advertised(fleet, computer),
        },
        "ports": _ports(fleet, robot) if is_master else [],
        "services": _services(robot) if is_master else [],
        "discovery": _discovery(fleet, robot) if is_master else {},
        "sync": _sync(robot) if is_master else {},
    }


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
    peers = [other.master.address for other in fleet.robots if other != robot]
    return {
        "name": master_name(robot),
        "mcast_group": fleet.multicast_group,
        "mcast_port": fleet.multicast_port,
        "interface": robot.master.address,
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
