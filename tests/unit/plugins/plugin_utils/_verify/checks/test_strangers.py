# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The check of strangers."""

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import WARNING
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import (
    DefaultRoute,
    ListedMaster,
    Stranger,
)
from fleets import ONE, evaluate, notable, update


def test_strangers_and_two_default_routes_are_warnings():
    def change(seen):
        probe = seen[ONE].probe
        guest = ListedMaster("guest", "http://guest:11311/", True, "http://192.168.1.77:11611")
        update(seen[ONE].multicast, unexpected=[Stranger("192.168.1.77", "eth0", 3)])
        update(probe.list_masters, masters=[*probe.list_masters.masters, guest])
        update(probe, default_routes=[*probe.default_routes, DefaultRoute("wlan0", metric="600")])

    found = notable(evaluate(change))
    assert {key[0]: finding.verdict for key, finding in found.items()} == {
        "strangers": WARNING,
        "default_routes": WARNING,
    }
    assert "guest" in found["strangers", ONE, ONE].found and "192.168.1.77" in found["strangers", ONE, ONE].found
