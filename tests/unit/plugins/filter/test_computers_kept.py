# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The filter computers_kept: who keeps routes holds its own gateway and the router, and no gateway of another robot."""

from ansible_collections.rosfleet.multimaster.plugins.filter.computers_kept import computers_kept

HOSTVARS = {
    "tibi-nav": {"multimaster_gateway": "tibi-visio", "closed": {"failed": True, "msg": "The routes stay."}},
    "tibi-arm": {"multimaster_gateway": "tibi-visio", "closed": {"unreachable": True}},
    "tibi-visio": {"multimaster_gateway": "tibi-visio"},
    "dabo-nav": {"multimaster_gateway": "dabo-visio", "closed": {"changed": True}},
    "dabo-visio": {"multimaster_gateway": "dabo-visio"},
    "kobuki": {"closed": {}},
    "router": {},
}


def kept(gateway=""):
    return computers_kept(list(HOSTVARS), HOSTVARS, "closed", gateway)


def test_the_gateway_of_the_robot_waits():
    assert kept("tibi-visio") == ["tibi-nav", "tibi-arm"]
    assert kept("dabo-visio") == []


def test_the_router_waits_for_all():
    assert kept() == ["tibi-nav", "tibi-arm"]
