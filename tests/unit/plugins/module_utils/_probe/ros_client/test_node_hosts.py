# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The hosts that nodes announce in their URIs."""

from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import plain_text
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import node_hosts

MEMBERS = [
    {"name": "here-pc", "robot": "one", "address": "192.168.11.2", "discovery_address": "192.168.1.2"},
    {"name": "arm-pc", "robot": "one", "address": "192.168.11.3", "discovery_address": ""},
    {"name": "there-pc", "robot": "two", "address": "192.168.1.3", "discovery_address": "192.168.1.3"},
]


def test_planned_hosts_of_the_robot_are_left_out():
    nodes = {
        "/a": "http://here-pc:1024/",
        "/b": "http://192.168.1.2:1024/",
        "/c": "http://ARM-PC:1024/",
        "/d": "http://127.0.0.1:41233/",
        "/e": "http://there-pc:1/",
        "/f": "http://[::1]:77/",
        "/g": "nonsense",
        "/h": "http://far:" + "9" * 5000,
        "/i": "http://2130706433:41233/",
    }
    found = {(row["node"], row["host"], row["port"]) for row in node_hosts.announced(nodes, {}, MEMBERS, "here-pc")}
    odd = ("/h", plain_text.plain(nodes["/h"], plain_text.LINE), 0), ("/i", "http://2130706433:41233/", 41233)
    assert found == {("/d", "127.0.0.1", 41233), ("/e", "there-pc", 1), ("/f", "::1", 77), *odd}


def test_services_on_another_computer_are_told():
    nodes = dict.fromkeys(("/a", "/b", "/c", "/d"), "http://here-pc:1024/")
    services = {
        "/a": "rosrpc://192.168.11.2:1025",  # the same computer by its address
        "/b": "rosrpc://arm-pc:1025",
        "/c": "rosrpc://127.0.0.1:1025",
        "/d": "nonsense",
    }
    found = node_hosts.announced(nodes, services, MEMBERS, "here-pc")
    assert {(row["node"], row["services"]) for row in found} == {("/b", "arm-pc"), ("/c", "127.0.0.1")}


def test_the_answer_is_bounded():
    nodes = {f"/node{number}": f"http://127.0.0.{number % 255}:1/" for number in range(5000)}
    assert len(node_hosts.announced(nodes, {}, MEMBERS, "here-pc")) == node_hosts.MOST
    counts = node_hosts.count_hosts(nodes)
    assert len(counts) == node_hosts.MOST and counts[0]["nodes"] == 20
