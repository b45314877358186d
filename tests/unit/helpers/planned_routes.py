# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Routes of two interfaces, and the machine in a folder that they are for; one route in few words."""

from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes import kernel
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.kernel import RouteSpec
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.managers import contract
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.network import NetworkInterface

DROP_IN = "/etc/systemd/network/{}.d/90-rosfleet-multimaster.conf"

ROUTES = {
    "eth0": [
        RouteSpec("0.0.0.0/0", "192.168.11.101", "eth0"),
        RouteSpec("::/0", "fd00:11::101", "eth0", 1024),
        RouteSpec("10.66.0.0/16", type="blackhole"),
    ],
    "eth1.5": [
        RouteSpec("10.67.0.0/16", "10.9.9.9", "eth1.5", 50, 100, "192.168.1.201", on_link=True),
        RouteSpec("226.0.0.0/8", "", "eth1.5"),
    ],
}


def machine(tree, *names):
    links = {name: NetworkInterface(name, number, up=True) for number, name in enumerate(names, 2)}
    return contract.MachineContext(links, booted=False, root=str(tree))


#: an item of the module, where nothing is said
DEFAULTS = {
    "gateway": None,
    "device": None,
    "metric": None,
    "table": 254,
    "source": None,
    "on_link": False,
    "type": "unicast",
    "backend": "auto",
}


def route(destination, gateway="", device="eth0", metric=None, **more):
    if metric is None:
        metric = 1024 if ":" in destination else 0
    return RouteSpec(destination, gateway, device, metric, **more)


def held(text, version=4, table=254):
    return kernel.parse_route(text, version, table)
