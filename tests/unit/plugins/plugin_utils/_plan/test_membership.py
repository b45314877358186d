# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The members of the fleet: addresses and URIs of each robot, on gateways and behind them."""

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import read
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import plan as plan_module

TIBI = {
    "multimaster_network": "192.168.11.0/24",
    "multimaster_gateway": "tibi-visio",
    "multimaster_common_address": "192.168.1.201",
}
ROBOTS = {"tibi": ["tibi-visio", "tibi-laser"], "car": ["car-pc"]}


def belonging(master="tibi-visio", routers=(), **shared):
    variables = {
        "tibi-visio": {**TIBI, "multimaster_address": "192.168.11.101", "multimaster_master": master},
        "tibi-laser": {
            **TIBI,
            "multimaster_address": "192.168.11.102",
            "multimaster_master": master,
            "multimaster_aliases": ["laser"],
        },
        "car-pc": {"multimaster_address": "192.168.1.203", "multimaster_roscore_port": 11411},
    }
    for values in variables.values():
        values.update({"multimaster_common_network": "192.168.1.0/24", **shared})
    for router in routers:
        variables[router] = {"multimaster_address": "192.168.1.1"}
    fleet = read.read_fleet(read.Inventory(robots=ROBOTS, variables=variables, routers=routers))
    return to_plain(plan_module.fleet_plan(fleet))["belonging"]


def test_a_master_on_a_gateway_has_both_addresses_in_order():
    tibi, car = belonging()["robots"]
    assert tibi["addresses"] == ["192.168.1.201", "192.168.11.101"]
    assert tibi["uris"] == ["http://tibi-visio:11311/", "http://192.168.1.201:11311/", "http://192.168.11.101:11311/"]
    assert tibi["hosts"] == ["tibi-visio", "192.168.1.201", "192.168.11.101", "tibi-laser", "laser", "192.168.11.102"]
    assert (car["name"], car["rpc_port"], car["addresses"]) == ("car-pc_11411", 11711, ["192.168.1.203"])


def test_a_master_behind_a_gateway_has_its_own_address_alone():
    tibi = belonging(master="tibi-laser")["robots"][0]
    assert tibi["addresses"] == ["192.168.11.102"]
    assert tibi["uris"][:2] == ["http://tibi-laser:11311/", "http://laser:11311/"]


def test_a_fleet_with_advertised_addresses_has_that_uri_first():
    assert belonging(multimaster_advertise="address")["robots"][1]["uris"] == [
        "http://192.168.1.203:11411/",
        "http://car-pc:11411/",
    ]


def test_the_router_belongs_to_the_fleet_and_has_no_master():
    found = belonging(routers=["router"])
    assert found["robots"][-1] == {
        "robot": "router",
        "name": "",
        "uris": [],
        "rpc_port": 0,
        "addresses": [],
        "hosts": ["router", "192.168.1.1"],
    }
    assert found["computers"] == ["192.168.1.201", "192.168.11.101", "192.168.11.102", "192.168.1.203", "192.168.1.1"]


def test_who_is_allowed_besides_is_a_list_of_networks():
    assert belonging()["strangers"] == "ignore" and belonging()["allow"] == []
    found = belonging(multimaster_strangers="allow", multimaster_allow=["192.168.1.77", "10.0.0.0/8"])
    assert found["strangers"] == "allow" and found["allow"] == ["192.168.1.77/32", "10.0.0.0/8"]
