# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The filter talkers_heard: a robot hears who gives it something, as far as talkers run."""

from ansible_collections.rosfleet.multimaster.plugins.filter.talkers_heard import talkers_heard
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import read
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import plan

ADDRESSES = {"a-pc": "192.168.1.1", "b-pc": "192.168.1.2", "c-pc": "192.168.1.3"}
RUNNING = {"started": {"talker": {"running": True}}}


def heard(exports, **hostvars):
    """Topics heard by each robot; `exports` are declared by the robots that it names."""
    variables = {
        host: {"multimaster_address": address, "multimaster_common_network": "192.168.1.0/24"}
        for host, address in ADDRESSES.items()
    }
    for robot, entries in exports.items():
        variables[f"{robot}-pc"]["multimaster_exports"] = entries
    robots = {name[0]: [name] for name in ADDRESSES}
    planned = to_plain(plan.fleet_plan(read.read_fleet(read.Inventory(robots=robots, variables=variables))))
    registered = dict.fromkeys(ADDRESSES, RUNNING) | {f"{robot}-pc": found for robot, found in hostvars.items()}
    return talkers_heard(planned, hostvars=registered, hosts=list(ADDRESSES), registered="started")


def test_without_a_declaration_all_hear_all():
    everybody = list(ADDRESSES)
    assert heard({}) == {"": everybody, "a": everybody, "b": everybody, "c": everybody}


def test_who_gives_nothing_is_heard_by_itself_alone():
    assert heard({"a": []}) == {
        "": ["b-pc", "c-pc"],
        "a": ["a-pc", "b-pc", "c-pc"],
        "b": ["b-pc", "c-pc"],
        "c": ["b-pc", "c-pc"],
    }


def test_a_flow_is_heard_where_it_goes():
    assert heard({"a": [{"topics": ["/a/pose"], "to": ["b"]}]})["b"] == ["a-pc", "b-pc", "c-pc"]
    assert heard({"a": [{"topics": ["/a/pose"], "to": ["b"]}]})["c"] == ["b-pc", "c-pc"]


def test_only_talkers_that_run_are_heard():
    assert heard({}, a={}, b={"started": {"failed": True}}, c={"started": {"talker": {"running": False}}})["a"] == []
