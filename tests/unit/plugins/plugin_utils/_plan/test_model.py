# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The plan as types is the plan as plain data, and back, to the letter."""

import json
from ipaddress import IPv4Network

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import from_plain, to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import read
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import plan as plan_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import ComputerPlan, FleetPlan

OWN = {
    "multimaster_network": "192.168.11.0/24",
    "multimaster_gateway": "tibi-visio",
    "multimaster_common_address": "192.168.1.201",
    "multimaster_master": "tibi-visio",
}
SHARED = {
    "multimaster_common_network": "192.168.1.0/24",
    "multimaster_multicast_group": "239.255.0.1",
    "multimaster_multicast_routing": "smcroute",
}


def fleet_plan(**of_dabo):
    variables = {
        "tibi-visio": {**SHARED, **OWN, "multimaster_address": "192.168.11.101"},
        "tibi-laser": {**SHARED, **OWN, "multimaster_address": "192.168.11.102"},
        "dabo-pc": {**SHARED, "multimaster_address": "192.168.1.202", **of_dabo},
        "router": {"multimaster_address": "192.168.1.1"},
    }
    robots = {"tibi": ["tibi-visio", "tibi-laser"], "dabo": ["dabo-pc"]}
    return plan_module.fleet_plan(
        read.read_fleet(read.Inventory(robots=robots, variables=variables, routers=["router"]))
    )


def test_there_and_back():
    for plan in (
        fleet_plan(),
        fleet_plan(multimaster_routes="existing", multimaster_provider="fkie_existing"),
        fleet_plan(multimaster_exports=[{"topics": ["/dabo/pose"], "to": ["tibi"]}]),
    ):
        plain = to_plain(plan)
        assert from_plain(FleetPlan, json.loads(json.dumps(plain))) == plan
        for computer in plain["computers"].values():
            assert to_plain(from_plain(ComputerPlan, computer)) == computer


def test_words_of_plain_data():
    plain = to_plain(fleet_plan(multimaster_exports=[{"topics": ["/dabo/pose"]}]))
    assert plain["computers"]["tibi-laser"]["routes"] == [{"destination": "default", "gateway": "192.168.11.101"}]
    assert plain["computers"]["tibi-laser"]["common_address"] == ""
    assert "multicast_routing" not in plain["computers"]["tibi-laser"]
    assert "programs" not in plain["computers"]["tibi-laser"]
    assert plain["flows"][0]["from"] == ["dabo"]


def test_a_plan_by_name():
    plan = ComputerPlan(computer="a", address="192.168.1.1", network=IPv4Network("192.168.1.0/24"))
    assert to_plain(plan)["routes"] == [] and not plan.is_master
