# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Answers of multimaster_info for machines that were set up by hand as a plan says, and inventories as Ansible reads them."""

import pathlib

import yaml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import Inventory
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.plan_world import make_world
from worlds import info_of

FOLDER = pathlib.Path(__file__).parents[3] / "inventory"


def machine(hostname, *addresses, routes=(), forwards=0, masters=(), uri="", **more):
    """A machine with addresses such as `192.168.1.229/24`, on eth0, eth1 and so on."""
    interfaces = [
        {
            "name": f"eth{number}",
            "up": True,
            "loopback": False,
            "addresses": [{"address": text.partition("/")[0], "prefix": int(text.partition("/")[2]), "family": "inet"}],
        }
        for number, text in enumerate(addresses)
    ]
    return {
        "hostname": hostname,
        "interfaces": interfaces,
        "routing": {
            "routes": [{"destination": to, "gateway": gateway, "metric": 0} for to, gateway in routes],
            "rules": [],
        },
        "forwarding": {"ip_forward": forwards, "interfaces": []},
        "masters": list(masters),
        "exports": [],
        "environment": {"login": {"ROS_MASTER_URI": uri} if uri else {}, "ssh": None, "desktop": None},
        "owned": [],
        **more,
    }


def roscore(host, address="", port=11311, rpc=11611, group="", group_port=0, implementation="bundled", **more):
    """A roscore with a discovery and a sync node; without an address it has none."""
    nodes = [
        {
            "node": "/master_discovery",
            "implementation": implementation,
            "uri": f"http://{address}:{rpc}",
            "group": group,
            "group_port": group_port,
        }
    ]
    return {
        "port": port,
        "uri": f"http://{host}:{port}/",
        "process": {"unit": "by-hand-roscore.service", "command": "roscore", "pid": 1, "user": "root"},
        "discovery": nodes if address else [],
        "sync": [{"implementation": implementation}] if address else [],
        "error": "",
        **more,
    }


def machines_of(plan):
    """Every machine of a plan, as it would be after somebody had done by hand what the plan says."""
    world, found = make_world(plan), {}
    for name, computer in plan.computers.items():
        info = {**info_of(world.machines[name]), **{key: [] for key in ("masters", "exports", "owned")}}
        info.update(hostname=name, environment={"login": dict(computer.environment), "ssh": None, "desktop": None})
        found[name] = info
    for master in plan.masters:
        port = plan.computers[master.computer].roscore_port
        found[master.computer]["masters"] = [
            roscore(
                master.uri.split("/")[2].partition(":")[0],
                str(master.address),
                port,
                master.rpc_port,
                str(plan.multicast_group),
                plan.multicast_port,
            )
        ]
    return found


def read_folder(folder):
    """An inventory folder, without Ansible: hosts.yml and group_vars."""
    hosts = yaml.safe_load((folder / "hosts.yml").read_text())
    return inventory_of(
        hosts, {path.stem: yaml.safe_load(path.read_text()) for path in folder.glob("group_vars/*.yml")}
    )


def inventory_of(hosts, group_vars):
    robots, variables = {}, {}
    for robot, group in sorted(hosts["robots"]["children"].items()):
        robots[robot] = list(group["hosts"])
        for host, own in group["hosts"].items():
            variables[host] = _ours({**(group_vars["robots"] or {}), **(group_vars.get(robot) or {}), **(own or {})})
    routers = hosts.get("routers", {}).get("hosts", {})
    return Inventory(
        robots=robots,
        variables={**variables, **{host: _ours(own) for host, own in routers.items()}},
        routers=list(routers),
    )


def _ours(variables):
    return {name: value for name, value in variables.items() if name.startswith("multimaster_")}
