# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The rule, or the route to nowhere, that takes what is for an address."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.policy_routing import taker
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import PolicyRouting

ADDRESS = "192.168.12.5"


@pytest.mark.parametrize(
    ("rules", "closed", "expected"),
    [
        ((), ("blackhole 192.168.12.5 ",), ("closed", "blackhole 192.168.12.5")),
        ((), ("unreachable 192.168.12.0/24 table 77 metric 5",), ("closed", "unreachable 192.168.12.0/24 table 77")),
        (
            ("100: from all to 192.168.12.0/24 lookup 77",),
            ("unreachable 192.168.12.0/24 table 77",),
            ("rule", "priority 100 from all to 192.168.12.0/24 table 77"),
        ),
        (
            ("100: from all to 192.168.12.0/24 blackhole",),
            (),
            ("rule", "priority 100 from all to 192.168.12.0/24 blackhole"),
        ),
        (("100: from all lookup 77",), ("blackhole 10.0.0.0/8",), ("", "")),
        (("100: from all to 192.168.12.0/24; reboot lookup 77",), ("blackhole 192.168.12.5; reboot",), ("", "")),
        ((), ("blackhole nobody",), ("", "")),
        ((), (), ("", "")),
    ],
)
def test_taker(rules, closed, expected):
    assert taker(PolicyRouting(rules, closed), ADDRESS) == expected
