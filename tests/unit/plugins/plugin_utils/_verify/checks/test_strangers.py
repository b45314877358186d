# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The check of strangers."""

from dataclasses import replace

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import WARNING
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    DefaultRoute,
    IgnoredSender,
    ListedMaster,
    Stranger,
)
from fleets import ONE, evaluate, notable, plan, update
from mentioned import mentions


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


ROGUE = IgnoredSender("192.168.1.66", "rogue", "http://rogue:11311/", "it is no robot of the fleet")


def test_who_is_ignored_is_named_once():
    def change(seen):
        update(seen[ONE].multicast, unexpected=[Stranger("192.168.1.66", "eth0", 3)])
        update(seen[ONE].probe, outsiders=[ROGUE])

    found = notable(evaluate(change))["strangers", ONE, ONE]
    assert found.verdict == WARNING
    assert mentions(found.found, "rogue", "192.168.1.66")


def test_ignored_sender_is_shown_when_it_tells_no_name():
    def change(seen):
        update(seen[ONE].probe, outsiders=[replace(ROGUE, name="")])

    found = notable(evaluate(change))["strangers", ONE, ONE].found
    assert mentions(found, "192.168.1.66", "heartbeats")


def test_who_is_allowed_is_no_stranger():
    def change(seen):
        guest = ListedMaster("guest", "http://guest:11311/", True, "http://192.168.1.77:11611")
        update(seen[ONE].multicast, unexpected=[Stranger("192.168.1.77", "eth0", 3)])
        update(seen[ONE].probe.list_masters, masters=[*seen[ONE].probe.list_masters.masters, guest])

    for variables in ({"multimaster_strangers": "allow"}, {"multimaster_allow": ["192.168.1.77"]}):
        assert not notable(evaluate(change, plan(**variables)))


def test_planned_master_is_judged_when_its_uri_is_hostile():
    def change(seen):
        lists = seen[ONE].probe.list_masters
        update(lists, masters=[replace(entry, monitoruri="http://[") for entry in lists.masters])

    assert {key[0] for key in notable(evaluate(change))} == {"list_masters"}
