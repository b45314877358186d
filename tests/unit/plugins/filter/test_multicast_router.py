# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The filter multicast_router: one file and one unit, or neither."""

from ansible_collections.rosfleet.multimaster.plugins.filter.multicast_router import multicast_router


def test_no_group():
    assert multicast_router("", robot="tibi", interfaces=[]) == {"files": [], "units": []}


def test_a_group():
    made = multicast_router(
        "239.255.11.11", robot="tibi", interfaces=["eth1", "eth0"], command="/usr/sbin/smcrouted", digest="feed"
    )
    assert [file["path"] for file in made["files"]] == ["/etc/rosfleet-multimaster/smcroute.conf"]
    assert [unit["name"] for unit in made["units"]] == ["multimaster-multicast-routing.service"]
    assert (
        "ExecStart=/usr/sbin/smcrouted -n -N -s -f /etc/rosfleet-multimaster/smcroute.conf\n"
        in made["units"][0]["content"]
    )
