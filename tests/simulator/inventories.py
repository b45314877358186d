# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Random inventories: both layouts of the report and mixtures, and all variables that change what packets and nodes do."""

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import (
    Inventory,
    InventoryProblems,
    read_fleet,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan

ROBOTS = ("tibi", "dabo", "car", "kobuki", "husky", "ana")
PLACES = ("nav", "visio", "monitor", "ext")
COMMON = "192.168.1.0/24"


def plan(random):
    """The plan of a random inventory that is accepted."""
    while True:
        try:
            return fleet_plan(read_fleet(inventory(random)))
        except InventoryProblems:
            continue  # a combination that the collection refuses


def inventory(random):
    """A random inventory; some of them are refused."""
    names = random.sample(ROBOTS, random.choice((2, 2, 3, 3, 4)))
    several = random.random() < 0.5  # the layout: robots with networks of their own, or of one network
    shared = _shared(random, several)
    robots, variables = {}, {}
    for number, name in enumerate(names):
        behind = several and (number == 0 or random.random() < 0.7)
        hosts = [f"{name}-{place}" for place in PLACES[: random.choice((1, 1, 2, 3))]]
        if behind and len(hosts) == 1:
            hosts.append(f"{name}-visio")
        robots[name] = hosts
        own = _of_robot(random, name, names, hosts)
        own.update(_network(random, number, hosts) if behind else {})
        for place, host in enumerate(hosts):
            address = f"192.168.{10 + number}.{100 + place}" if behind else f"192.168.1.{10 * (number + 1) + place}"
            variables[host] = {**shared, **own, "multimaster_address": address, **_of_computer(random, host)}
    routers = []
    if several and random.random() < 0.4:
        variables["router"] = {"multimaster_address": "192.168.1.1"}
        routers = ["router"]
    return Inventory(robots=robots, variables=variables, routers=routers)


def _some(random, **choices):
    """Some variables with one of their values; None is the default."""
    chosen = {name: random.choice(values) for name, values in choices.items()}
    return {f"multimaster_{name}": value for name, value in chosen.items() if value is not None}


def _shared(random, several):
    """Variables of the fleet."""
    found = _some(
        random,
        transport=(None, None, "both", "unicast", "multicast"),
        multicast_group=("226.0.0.0", "224.0.0.1", "239.255.0.1"),
        multicast_port=(None, None, 11511, 12000),
        multicast_routing=(None, None, None, "smcroute"),
        firewall=(None, None, None, "fleet"),
        advertise=(None, None, "address"),
        answer_broadcast_pings=(None, None, False),
        strangers=(None, None, None, "allow"),
        allow=(None, None, ["192.168.1.250"]),
        heartbeat_hz=(None, 0.5),
    )
    if several and random.random() < 0.2:
        found["multimaster_router"] = "192.168.1.1"
    return {"multimaster_common_network": COMMON, **found}


def _network(random, number, hosts):
    """Variables of a robot with a network of its own."""
    gateway = f"192.168.{10 + number}.1" if random.random() < 0.15 else random.choice(hosts)
    return {
        "multimaster_network": f"192.168.{10 + number}.0/24",
        "multimaster_gateway": gateway,
        "multimaster_common_address": f"192.168.1.{201 + number}",
    }


def _of_robot(random, name, names, hosts):
    """Variables of a robot."""
    other = random.choice([one for one in names if one != name])
    return {
        "multimaster_master": random.choice(hosts),
        **_some(
            random,
            routes=(None, None, "networks", "existing"),
            roscore=(None, None, None, "existing"),
            roscore_port=(None, None, None, 11321),
            rpc_port=(None, None, None, 12611),
            provider=(None, None, None, None, "fkie_existing"),
            filters=(None,) * 6
            + ({"ignore_topics": ["/tf"]}, {"sync_topics": ["/wanted/*"]}, {"ignore_services": ["/*/reset"]}),
            exports=(None,) * 8 + ([], [{"topics": [f"/{name}/*"]}], [{"topics": ["/chatter"], "to": [other]}]),
        ),
    }


def _of_computer(random, host):
    """Variables of a computer."""
    return _some(
        random,
        aliases=(None, None, [host.replace("-", "")]),
        firewall_also=(None, None, ["192.168.1.251"]),
        firewall_ports=(None, None, ["51820/udp"]),
    )
