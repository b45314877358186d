# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Since when something is broken, as far as a machine tells."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._case.parts import Part
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._diagnosis.onset import describe_onset
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._observed.observations import (
    Change,
    ForwardingInterface,
    ForwardingSettings,
    Probe,
    Service,
)

WHEN = "Sun 2026-11-22 09:12:44 UTC"
PROBE = Probe(
    services=(
        Service("discovery", "multimaster-discovery.service", since=WHEN),
        Service("address", "multimaster-address.service", since=WHEN),
        Service("sync", "multimaster-sync.service", differing=("ROS_IP",), since=WHEN),
    ),
    changes=(
        Change("names", "/etc/hosts", when="2026-11-22 09:12:44 UTC"),
        Change("settings", "/etc/sysctl.d/9.conf", when="2026-11-22 09:12:45 UTC"),
        Change("filter", "docker.service", "was started", WHEN),
        Change("start", "the computer", "was started", "2026-11-22 08:00:00 UTC"),
    ),
    forwarding=ForwardingSettings(
        1,
        (
            ForwardingInterface("eth0", state="down", last="2026-11-22T09:12:44+0000 a kernel: eth0: Link is Down"),
            ForwardingInterface("wlan0", state="up", carrier_changes=77),
        ),
    ),
)


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        (("discovery", "a", "dead"), f"it ended {WHEN}"),
        (("discovery", "a", "hung"), f"it was started {WHEN}"),
        (("service", "a", "down", "multimaster-address.service"), f"it ended {WHEN}"),
        (("environment", "a", "service", "ROS_IP"), f"it was started {WHEN}"),
        (("names", "a", "loopback", "b"), "/etc/hosts was changed 2026-11-22 09:12:44 UTC"),
        (("roscore", "a", "dead"), ""),  # not among the services
        (
            ("forwarding", "a", "off"),
            "/etc/sysctl.d/9.conf was changed 2026-11-22 09:12:45 UTC; the computer was started 2026-11-22 08:00:00 UTC",
        ),
        (
            ("filter", "a", "icmp in"),
            f"docker.service was started {WHEN}; the computer was started 2026-11-22 08:00:00 UTC",
        ),
        (("route", "a", "missing"), "the computer was started 2026-11-22 08:00:00 UTC"),
        (
            ("link", "a", "flapping"),
            "the journal's last line about eth0: 2026-11-22T09:12:44+0000 a kernel: eth0: Link is Down; "
            "the link of wlan0 came or went 77 times",
        ),
        (("computer", "a", "off"), ""),
    ],
)
def test_since(part, expected):
    assert describe_onset(Part(*part), PROBE) == expected


def test_nobody_knows_where_nobody_looked():
    assert describe_onset(Part("discovery", "a", "dead"), None) == ""
    assert describe_onset(Part("discovery", "a", "dead"), Probe(services=(Service("discovery", "u"),))) == ""
