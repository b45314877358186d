# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The file and the unit of smcroute; their whole texts are in golden/multicast_routing."""

import pathlib

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.multicast_routing import files

GOLDEN = pathlib.Path(__file__).resolve().parents[4] / "golden/multicast_routing"
INTERFACES = ["eth1", "eth0"]


def test_the_multicast_router():
    unit = files.render_router("tibi", "239.255.11.11", INTERFACES, "/usr/sbin/smcrouted", "feed")
    assert unit["content"] == (GOLDEN / unit["name"]).read_text(encoding="utf-8")
    routes = files.render_routes("tibi", "239.255.11.11", INTERFACES)
    assert routes == (GOLDEN / "smcroute.conf").read_text(encoding="utf-8")


def test_names_of_interfaces_are_arguments_and_no_commands():
    unit = files.render_router("tibi", "239.255.11.11", ["eth0;reboot", 'a"$(id)%n'], "/usr/sbin/smcrouted", "feed")
    assert 'exit 1\' sh "eth0;reboot" "a\\"$$(id)%%n"\n' in unit["content"]
    assert unit["content"].count("reboot") == 1
