# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Since when something is broken, as far as a machine tells."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import Changed, Probe, Service
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.parts import Part
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.since import since

WHEN = "Sun 2026-11-22 09:12:44 UTC"
PROBE = Probe(
    services=(
        Service("discovery", "multimaster-discovery.service", since=WHEN),
        Service("address", "multimaster-address.service", since=WHEN),
        Service("sync", "multimaster-sync.service", differing=("ROS_IP",), since=WHEN),
    ),
    name_files=(Changed("/etc/hosts", "2026-11-22 09:12:44 UTC"), Changed("/etc/other", "2026-11-22 09:12:44 UTC")),
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
        (("link", "a", "down"), ""),  # the kernel does not tell
    ],
)
def test_since(part, expected):
    assert since(Part(*part), PROBE) == expected


def test_nobody_knows_where_nobody_looked():
    assert since(Part("discovery", "a", "dead"), None) == ""
    assert since(Part("discovery", "a", "dead"), Probe(services=(Service("discovery", "u"),))) == ""
