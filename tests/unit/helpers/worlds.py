# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Plans and worlds for the tests of the world: Fig. 5, and Fig. 10 and 12 of the report."""

from dataclasses import replace
from ipaddress import IPv4Address, IPv4Interface, IPv4Network

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import Inventory, read_fleet
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import Packet, Route
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan

from tests.simulator.state import replace_interface

ROBOTS = {
    "tibi": (11, 201, "tibi-visio", {"tibi-nav": 100, "tibi-visio": 101}),
    "dabo": (10, 202, "dabo-nav", {"dabo-nav": 100, "dabo-visio": 101}),
}


def fig12(by_robot=None, routers=("router",), **variables):
    """Two robots behind gateways, one robot of one computer, and a router; `by_robot` are further variables of a robot."""
    shared = {"multimaster_common_network": "192.168.1.0/24", "multimaster_multicast_group": "239.255.0.1", **variables}
    values = {
        host: {
            **shared,
            "multimaster_network": f"192.168.{network}.0/24",
            "multimaster_gateway": f"{robot}-visio",
            "multimaster_common_address": f"192.168.1.{common}",
            "multimaster_master": master,
            "multimaster_address": f"192.168.{network}.{address}",
            **(by_robot or {}).get(robot, {}),
        }
        for robot, (network, common, master, hosts) in ROBOTS.items()
        for host, address in hosts.items()
    }
    values["kobuki"] = {**shared, "multimaster_address": "192.168.1.229", **(by_robot or {}).get("kobuki", {})}
    robots = {**{robot: list(entry[3]) for robot, entry in ROBOTS.items()}, "kobuki": ["kobuki"]}
    router = {name: {"multimaster_address": "192.168.1.1"} for name in routers}
    return fleet_plan(read_fleet(Inventory(robots=robots, variables={**values, **router}, routers=list(routers))))


COMPUTERS = ("tibi-nav", "tibi-visio", "dabo-nav", "dabo-visio", "kobuki")


def ping(destination, **more):
    return Packet("icmp", IPv4Address(destination), **more)


def tcp(destination, port, **more):
    return Packet("tcp", IPv4Address(destination), port=port, **more)


def change(world, name, **fields):
    """The world with other fields of a machine."""
    return world.replace_machine(replace(world.machines[name], **fields))


def change_interface(world, name, interface, **fields):
    """The world with other fields of an interface, and the routes that follow from them."""
    machine = world.machines[name]
    return world.replace_machine(replace_interface(machine, replace(machine.interface(interface), **fields)))


def route(destination, gateway, device="eth0", **more):
    return Route(IPv4Network(destination), IPv4Address(gateway), device, **more)


def address(text):
    return IPv4Interface(text)


# What multimaster_info would read of a machine


def info_of(machine, owned=()):
    """The answer of multimaster_info for a machine: its own table of the packet filter is not among the chains."""
    return {
        "owned": list(owned),
        "interfaces": [
            {
                "name": one.name,
                "up": one.up,
                "multicast": True,
                "loopback": False,
                "mtu": one.mtu,
                "addresses": [
                    {"address": str(entry.ip), "prefix": entry.network.prefixlen, "family": "inet"}
                    for entry in one.addresses
                ],
            }
            for one in machine.interfaces
        ],
        "routing": {
            "routes": [
                {
                    "destination": str(entry.destination),
                    "gateway": str(entry.gateway or ""),
                    "device": entry.device,
                    "metric": entry.metric,
                    "source": str(entry.source or ""),
                    "type": entry.kind,
                }
                for entry in machine.routes
                if not entry.device or machine.interface(entry.device).up
            ],
            "rules": [],
        },
        "forwarding": {
            "ip_forward": int(any(one.forwarding for one in machine.interfaces)),
            "interfaces": [
                {"interface": one.name, "forwarding": int(one.forwarding), "rp_filter": one.rp_filter}
                for one in machine.interfaces
            ],
        },
        "filters": {"readable": True, "chains": [_chain(number, entry) for number, entry in enumerate(machine.rules)]},
    }


HOOKS = {"in": "input", "out": "output", "forward": "forward", "nat": "postrouting"}


def _chain(number, rule):
    said = {"verdict": rule.verdict}
    for name, empty in (("protocol", ""), ("incoming", ""), ("leaving", ""), ("state", ""), ("above", 0)):
        if getattr(rule, name) != empty:
            said[name] = getattr(rule, name)
    if rule.ports != (0, 65535):
        said["ports"] = list(rule.ports)
    for name in ("sources", "destinations"):
        if getattr(rule, name):
            said[name] = [str(network) for network in getattr(rule, name)]
    table = f"ip t{number}"
    said["chain"] = f"own_{rule.chain}"
    return {"hook": HOOKS[rule.chain], "table": table, "policy": "accept", "rules": [said], "unread": 0}
