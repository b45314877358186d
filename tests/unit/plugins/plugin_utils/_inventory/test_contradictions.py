# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Contradictions between variables: what cannot be done with a sealed computer."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import read
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import Inventory, InventoryProblems
from mentioned import mentions

SHARED = {"multimaster_common_network": "192.168.1.0/24", "multimaster_advertise": "address"}
HSR = {"multimaster_master": "hsrb", "multimaster_sealed": {"hsrb": "192.168.1.40"}}


def problems(hosts=("hsr-pc",), **variables):
    """The sentences about a robot with a sealed roscore, after a change of its variables."""
    values = {**SHARED, **HSR, **variables}
    of_robot = {host: {**values, "multimaster_address": f"192.168.1.{41 + n}"} for n, host in enumerate(hosts)}
    other = {**SHARED, "multimaster_advertise": values["multimaster_advertise"], "multimaster_address": "192.168.1.229"}
    try:
        read.read_fleet(
            Inventory(robots={"hsr": list(hosts), "kobuki": ["kobuki-pc"]}, variables={**of_robot, "kobuki-pc": other})
        )
    except InventoryProblems as found:
        return found.problems
    return []


TWO = ("hsr-pc", "hsr-eye")
WRONG = {
    "no companion": (problems(TWO), "multimaster_companion hsrb"),
    "sealed companion": (problems(multimaster_companion="hsrb"), "multimaster_companion hsrb"),
    "strange companion": (problems(TWO, multimaster_companion="hsr-ey"), "hsr-ey hsr hsr-pc hsr-eye"),
    "companion of nobody": (
        problems(multimaster_master="hsr-pc", multimaster_companion="hsr-pc"),
        "multimaster_companion multimaster_master hsr",
    ),
    "names": (problems(multimaster_advertise="name"), "hsrb multimaster_sealed multimaster_advertise name"),
    "managed roscore": (problems(multimaster_roscore="managed"), "hsrb multimaster_roscore"),
    "other nodes": (problems(multimaster_provider="fkie_apt"), "hsrb multimaster_provider"),
    "sealed gateway": (
        problems(
            multimaster_network="192.168.11.0/24",
            multimaster_gateway="192.168.11.40",
            multimaster_common_address="192.168.1.99",
            multimaster_sealed={"hsrb": "192.168.11.40"},
        )[-1:],
        "hsrb multimaster_gateway hsr",
    ),
    "a host": (
        problems(multimaster_sealed={"kobuki-pc": "192.168.1.40"}, multimaster_master="hsr-pc"),
        "kobuki-pc multimaster_sealed hsr",
    ),
    "outside": (problems(multimaster_sealed={"hsrb": "192.168.2.40"}), "multimaster_sealed 192.168.2.40"),
    "same address": (problems(multimaster_sealed={"hsrb": "192.168.1.41"}), "192.168.1.41 hsrb"),
    "same name": (
        problems(multimaster_sealed={"hsrb": {"address": "192.168.1.40", "aliases": ["Kobuki-PC"]}}),
        "also means",
    ),
    "true": (problems(multimaster_sealed=True), "multimaster_sealed True addresses"),
    "no name": (problems(multimaster_sealed={"a b": "192.168.1.40"}), "hsrb 192.168.1.40 name"),
    "mistyped": (problems(multimaster_sealed={"hsrb": {"adress": "192.168.1.40"}}), "adress address aliases hsrb"),
    "no address": (problems(multimaster_sealed={"hsrb": {}}), "hsrb IPv4 address"),
    "no master": (problems(multimaster_master="hsrc"), "hsrc hsr-pc hsrb"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_seal_is_one_sentence(case):
    found, sentence = WRONG[case]
    assert len(found) == 1 and mentions(found[0], *sentence.split())


def test_the_names_that_a_sealed_computer_has_already_may_have_underscores():
    names = {"robot_2_nuc": {"address": "192.168.1.40", "aliases": ["robot_2_nuc.local"]}}
    assert problems(multimaster_master="robot_2_nuc", multimaster_sealed=names) == []


def test_one_sealed_computer_has_one_robot():
    sealed = {**SHARED, **HSR}
    values = {f"hsr{n}-pc": {**sealed, "multimaster_address": f"192.168.1.{n}"} for n in (1, 2)}
    with pytest.raises(InventoryProblems, match="multimaster_sealed.*hsr1.*hsr2"):
        read.read_fleet(Inventory(robots={"hsr1": ["hsr1-pc"], "hsr2": ["hsr2-pc"]}, variables=values))


def test_good_seals_are_no_contradiction():
    assert not problems()
    assert not problems(TWO, multimaster_companion="hsr-eye")
    assert not problems(multimaster_master="hsr-pc"), "a sealed computer need not have the roscore"


# The ports of relays


def find_port_problems(giver=None, receiver=None, exports=({"topics": ["/scan"], "as": "/a"},)):
    """The sentences about two robots, of which one gives the other a topic by another name, with their ports."""
    shared = {"multimaster_common_network": "192.168.1.0/24"}
    variables = {
        "a": {**shared, "multimaster_address": "192.168.1.1", "multimaster_exports": list(exports), **(giver or {})},
        "b": {**shared, "multimaster_address": "192.168.1.2", **(receiver or {})},
    }
    try:
        read.read_fleet(Inventory(robots={"ra": ["a"], "rb": ["b"]}, variables=variables))
    except InventoryProblems as found:
        return found.problems
    return []


@pytest.mark.parametrize(
    "host, ports", [("a", ({"multimaster_rpc_port": 11911}, {})), ("b", ({}, {"multimaster_rpc_port": 11911}))]
)
def test_the_port_of_a_relay_is_its_own(host, ports):
    (problem,) = find_port_problems(*ports)
    assert mentions(problem, host, "multimaster_rpc_port", "11911")
    assert not find_port_problems(*ports, exports=[{"topics": ["/scan"]}]), (
        "a robot without a relay leaves this port free"
    )


def test_a_relay_has_a_port():
    (problem,) = find_port_problems({"multimaster_roscore_port": 65000})
    assert mentions(problem, "multimaster_roscore_port", "65000", "600")
    assert mentions(problem, "64935", "group_vars/ra.yml")
    assert not find_port_problems({"multimaster_roscore_port": 64935})
    assert not find_port_problems({"multimaster_roscore_port": 65000}, exports=[{"topics": ["/scan"]}])
