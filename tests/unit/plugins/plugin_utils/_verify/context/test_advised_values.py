# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The values in the place of the placeholders of an advice: addresses of the plan, interfaces that were read."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import COMMON
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import Verification
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import Component
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.advised_values import name_values
from fleets import fig12, observed, update

OF_CAR, OF_DABO = "the network of car", "the network of dabo"


def advised(*component, change=lambda seen: None):
    """The commands to look with, for a component of a healthy fleet after a change."""
    fleet = fig12()
    seen = observed(fleet)
    change(seen)
    one = Component(*component)
    return {
        advice.where: advice.text
        for advice in one.look(known=name_values(one, Verification(CHECKS, fleet, seen).state))
    }


@pytest.mark.parametrize(
    ("component", "place", "part"),
    [
        (("interface", "car-nav", "duplicate"), "car-visio", "-I eth0 192.168.12.100"),
        (("network", OF_CAR, "dead"), "car-nav", "192.168.12.101"),
        (("network", COMMON, "loss"), None, " 192.168.1."),
        (("route", "car-nav", "circle", OF_DABO), "car-nav", "traceroute -n 192.168.10."),
        (("forwarding", "car-visio", "large"), "a computer behind it", "-c 3 192.168."),
        (("link", "car-nav", "power_save", OF_CAR), "car-nav", "iw dev eth0 get power_save"),
        (("interface", "car-nav", "multicast"), "car-nav", "ip route get 2"),
    ],
)
def test_a_command_to_look_with_has_no_gap(component, place, part):
    found = advised(*component)
    assert not any("<" in text for text in found.values())
    assert any(part in text for where, text in found.items() if place in (None, where)), found


def test_only_the_wrong_address_of_a_neighbour_is_forgotten():
    state = Verification(CHECKS, fig12(), observed(fig12())).state
    one = Component("neighbour", "car-nav", "fixed", "car-visio")
    (flush,) = one.do(known=name_values(one, state))
    assert (flush.where, flush.text) == ("car-nav", "ip neighbour flush to 192.168.12.101 nud permanent")


def test_an_interface_with_a_strange_name_is_no_part_of_a_command():
    def change(seen):
        update(seen["car-visio"].probe.forwarding.interfaces[0], interface="eth0;reboot")
        update(seen["car-nav"].probe.forwarding.interfaces[0], interface="$(reboot)")

    twice = advised("interface", "car-nav", "duplicate", change=change)
    assert len(twice) == 1 and "car-visio" not in twice  # another computer of that network is asked
    (text,) = advised("link", "car-nav", "power_save", OF_CAR, change=change).values()
    assert text == "iw dev; iw dev <interface> get power_save"
    assert not any("reboot" in one for one in (*twice.values(), text))


def test_of_an_unknown_network_nothing_is_named():
    state = Verification(CHECKS, fig12(), {}).state
    assert name_values(Component("network", "another network", "loss"), state) == {}
