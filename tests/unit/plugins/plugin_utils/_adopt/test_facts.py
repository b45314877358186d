# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Answers of machines, read as types: nonsense is refused, and an excess is cut."""

import copy
import random

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._adopt import facts
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._adopt.infer import propose
from shown import machine, roscore

INFO = machine(
    "ana",
    "192.168.1.10/24",
    routes=[("0.0.0.0/0", "192.168.1.1")],
    masters=[roscore("ana", "192.168.1.10", group="224.0.0.1")],
    uri="http://ana:11311",
)


def test_a_machine_is_read():
    read = facts.read_machine("ana", INFO)
    assert str(read.addresses[0].ip) == "192.168.1.10" and read.masters[0].host == "ana"
    assert str(read.roscores[0].discovery[0].group) == "224.0.0.1" and str(read.hops[0].gateway) == "192.168.1.1"


@pytest.mark.parametrize("name", ["docker0", "virbr0", "veth12", "br-1234", "br-3f2a1b4c5dae", "podman"])
def test_networks_inside_a_computer_are_left_aside(name):
    info = copy.deepcopy(INFO)
    info["interfaces"][0]["name"] = name
    read = facts.read_machine("ana", info)
    assert not read.addresses and "inside the computer" in read.aside[0]


@pytest.mark.parametrize("name", ["br0", "br-lan", "br-wifi0", "br-0", "mv0"])
def test_a_bridge_of_a_person_is_a_way_to_others(name):
    info = copy.deepcopy(INFO)
    info["interfaces"][0]["name"] = name
    assert [str(entry.ip) for entry in facts.read_machine("ana", info).addresses] == ["192.168.1.10"]


@pytest.mark.parametrize("change", [{"up": False}, {"loopback": True}])
def test_addresses_that_nobody_reaches_are_left_aside(change):
    info = copy.deepcopy(INFO)
    info["interfaces"][0].update(change)
    assert not facts.read_machine("ana", info).addresses


@pytest.mark.parametrize("part", facts.NEEDED)
def test_a_part_that_is_missing_is_named(part):
    info = {key: value for key, value in INFO.items() if key != part}
    with pytest.raises(facts.StrangeMachine, match=f"^{part} could not be read$"):
        facts.read_machine("ana", info)


def test_assignments_in_files_count_after_the_shells():
    info = copy.deepcopy(INFO)
    info["exports"] = [
        {"variable": "ROS_MASTER_URI", "value": "http://bob:11321", "file": "/root/.bashrc", "line": 7},
        {"variable": "ROS_IP", "value": "192.168.1.10", "file": "/root/.bashrc", "line": 8},
        {"variable": "ROS_MASTER_URI", "value": "", "file": "/root/.bashrc", "line": 9},
    ]
    assert [(uri.host, uri.port) for uri in facts.read_machine("ana", info).masters] == [("ana", 11311), ("bob", 11321)]


def broken(value, randomly):
    """The same data with one value that is anything."""
    if isinstance(value, dict) and value and randomly.random() < 0.9:
        key = randomly.choice(sorted(value))
        return {**value, key: broken(value[key], randomly)}
    if isinstance(value, list) and value and randomly.random() < 0.9:
        place = randomly.randrange(len(value))
        return [*value[:place], broken(value[place], randomly), *value[place + 1 :]]
    return randomly.choice(
        [None, "", "x" * 5000, -1, 10**30, [], {}, [[]], {"a": []}, "http://[", "1.2.3.4", True, 0.5]
    )


@pytest.mark.slow
def test_whatever_a_machine_answers_it_is_read_or_refused():
    randomly = random.Random(1)
    refused = 0
    for _round in range(3000):
        try:
            propose([facts.read_machine("ana", broken(INFO, randomly)), facts.read_machine("bob", INFO)], {})
        except facts.StrangeMachine:
            refused += 1
    assert 100 < refused < 2500
