# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Sentences about the result of multicast_verify."""

from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast import multicast_report as m


def test_an_icmp_round_names_who_answered():
    computers = {"10.0.0.1": "a", "10.0.0.2": "b", "10.0.0.3": "c"}
    assert m.icmp_round(1, {"10.0.0.2", "10.0.0.9"}, computers, "10.0.0.1") == {
        "round": 1,
        "answered": ["b"],
        "missing": ["c"],
        "unexpected": ["10.0.0.9"],
    }
