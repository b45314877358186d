# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The commands that a person would paste of a finding."""

import re

import pytest
import remedy
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.parts import FAULTS, Part
from catalogue import Step

# Commands that show something and change nothing: a remedy has them behind `see`.
SHOWING = re.compile(
    r"(df|du|ss|top|journalctl|dmesg|grep|cat|nft list|iptables -S|getent|ping|ip (-|link|(rule|route)(?! del))|systemctl status)\b"
)


@pytest.mark.parametrize(
    ("told", "expected"),
    [
        ("run site.yml, which sets its routes; see on arm: ip rule", (Step("controller", "site.yml"),)),
        ("on arm: systemctl restart a b; see on arm: journalctl", (Step("arm", "systemctl restart a b"),)),
        ("end it first; on arm: yes | rosnode cleanup", (Step("arm", "yes | rosnode cleanup"),)),
        ("see on arm: nft list ruleset", ()),
        (
            "on arm: ip link set dev eth0 up; then run site.yml, which sets its routes; if it does not last, look",
            (Step("arm", "ip link set dev eth0 up"), Step("controller", "site.yml")),
        ),
        (
            "on arm: ip route del blackhole 1; ip rule; if it does not last, look",
            (Step("arm", "ip route del blackhole 1; ip rule"),),
        ),
        ("look at the cable; see on arm: ip link", ()),
        ("see on the controller: ansible arm", ()),
    ],
)
def test_the_commands_of_a_remedy(told, expected):
    assert remedy.steps(told) == expected


@pytest.mark.parametrize("kind, mode", FAULTS)
def test_no_remedy_tells_to_paste_what_only_shows(kind, mode):
    told = remedy.steps(Part(kind, "arm", mode, "one").remedy())
    assert not any(SHOWING.match(step.what) for step in told)


def finding(kind):
    return {"kind": kind, "mode": "off", "place": "arm"}


@pytest.mark.parametrize(
    ("after", "expected"),
    [
        ((), remedy.MENDS),
        (("clock",), remedy.MENDS),
        (("clock", "computer"), remedy.STAYS),
        (("roscore",), remedy.OTHER),
        (("roscore", "computer"), remedy.STAYS),
    ],
)
def test_what_came_of_it(after, expected):
    before = {"findings": [finding("computer"), finding("clock")]}
    assert remedy.result(before, {"findings": [finding(kind) for kind in after]}) == expected
