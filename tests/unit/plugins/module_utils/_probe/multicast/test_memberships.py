# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The multicast memberships in the kernel's tables."""

from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast import memberships as m

IGMP = """Idx\tDevice    : Count Querier\tGroup    Users Timer\tReporter
1\tlo        :     1      V3
\t\t\t\t010000E0     1 0:00000000\t\t0
4\teth0      :     3      V2
\t\t\t\t000000E2     2 0:00000000\t\t1
\t\t\t\t010000E0     1 0:00000000\t\t0
7\tenp0s31f6.1234:     1      V3
\t\t\t\tFB0000E0     1 1:00000A1F\t\t0
"""


IGMP6 = """2    eth0            ff0200000000000000000001ff000002     1 00000004 0
2    eth0            ff020000000000000000000000000001     1 0000000C 0
"""


def test_memberships_of_the_kernels_tables():
    found = [tuple(item.values()) for item in m.igmp_memberships(IGMP, "little") + m.igmp6_memberships(IGMP6)]
    assert found == [
        ("lo", "ipv4", "224.0.0.1", 1, "V3"),
        ("eth0", "ipv4", "226.0.0.0", 2, "V2"),
        ("eth0", "ipv4", "224.0.0.1", 1, "V2"),
        ("enp0s31f6.1234", "ipv4", "224.0.0.251", 1, "V3"),
        ("eth0", "ipv6", "ff02::1:ff00:2", 1, None),
        ("eth0", "ipv6", "ff02::1", 1, None),
    ]
    assert m.igmp_memberships(IGMP.replace("000000E2", "E2000000"), "big")[1]["group"] == "226.0.0.0"
    assert m.igmp_memberships("") == m.igmp6_memberships("") == []


def test_own_membership_is_not_counted():
    found = m.igmp_memberships(IGMP, "little")
    assert m.drop_own(found, "eth0", "226.0.0.0")[1]["users"] == 1
    assert len(m.drop_own(found, "eth0", "224.0.0.1")) == len(found) - 1
    assert found == m.igmp_memberships(IGMP, "little")
