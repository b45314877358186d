# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Multicast routing in the plan of a gateway, and what stands against it on a machine."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.multicast_routing.model import (
    MulticastRouting,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.multicast_routing.plan import HOOKS
from fleets import fig12
from mentioned import mentions

PLAN = fig12(multimaster_multicast_routing="smcroute", multimaster_multicast_group="239.255.0.1").computers[
    "tibi-visio"
]
GOOD = {"smcrouted": "/usr/sbin/smcrouted", "others": []}


def look(found=None, same=False):
    """Return the facts of a gateway, whose addresses may be on the same interface."""
    entries = [
        [{"address": str(wanted.address), "prefix": wanted.network.prefixlen, "family": "inet"}]
        for wanted in PLAN.networks
    ]
    places = [("eth0", [entry for one in entries for entry in one])] if same else zip(["eth1.5", "eth0"], entries)
    state = {"up": True, "multicast": True, "loopback": False, "port_of": "", "macvlan_of": ""}
    interfaces = [{"name": name, "addresses": addresses, **state} for name, addresses in places]
    return {"interfaces": interfaces, "multicast_routing": found or GOOD}


def test_the_plan_gets_the_names_of_the_interfaces():
    assert not list(HOOKS.find_problems(PLAN, look()))
    assert HOOKS.fill(PLAN, MulticastRouting.find(PLAN), look()).interfaces == ("eth1.5", "eth0")
    assert PLAN.passes_group and PLAN.all_services[-1] == "multicast-routing"


@pytest.mark.parametrize(
    ("info", "facts"),
    [
        (look({"smcrouted": "", "others": []}), ["smcrouted", "apt-get install smcroute"]),
        (look({"smcrouted": "/usr/sbin/smcrouted", "others": ["pimd.service"]}), ["pimd.service"]),
        (look(same=True), ["eth0", "multimaster_multicast_routing"]),
    ],
)
def test_what_stands_against_it(info, facts):
    (problem,) = HOOKS.find_problems(PLAN, info)
    assert mentions(problem, "tibi-visio", *facts)
