# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Contradictions between variables: what cannot be done with a sealed computer."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import read
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import Inventory, InventoryProblems

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
    "no companion": (problems(TWO), "hsr-pc: multimaster_companion is not set, but the master of the robot hsr, hsrb,"),
    "sealed companion": (problems(multimaster_companion="hsrb"), "multimaster_companion is hsrb, which is sealed"),
    "strange companion": (
        problems(TWO, multimaster_companion="hsr-ey"),
        "'hsr-ey', which is no computer of the robot hsr; expected one of hsr-pc, hsr-eye (did you mean hsr-eye?)",
    ),
    "companion of nobody": (
        problems(multimaster_master="hsr-pc", multimaster_companion="hsr-pc"),
        "but multimaster_master of the robot hsr is no sealed computer",
    ),
    "names": (
        problems(multimaster_advertise="name"),
        "hsrb: is in multimaster_sealed, but multimaster_advertise is 'n",
    ),
    "managed roscore": (problems(multimaster_roscore="managed"), "hsrb: is sealed, but multimaster_roscore of the rob"),
    "other nodes": (problems(multimaster_provider="fkie_apt"), "hsrb: is sealed, but multimaster_provider of the robo"),
    "sealed gateway": (
        problems(
            multimaster_network="192.168.11.0/24",
            multimaster_gateway="192.168.11.40",
            multimaster_common_address="192.168.1.99",
            multimaster_sealed={"hsrb": "192.168.11.40"},
        )[-1:],
        "hsrb: is sealed, and multimaster_gateway of the robot hsr; expected a gateway that can be set up",
    ),
    "a host": (
        problems(multimaster_sealed={"kobuki-pc": "192.168.1.40"}, multimaster_master="hsr-pc"),
        "kobuki-pc: is a host of the inventory, and in multimaster_sealed of the robot hsr; expected one of the two",
    ),
    "outside": (
        problems(multimaster_sealed={"hsrb": "192.168.2.40"}),
        "hsrb: multimaster_sealed is 192.168.2.40, which",
    ),
    "same address": (problems(multimaster_sealed={"hsrb": "192.168.1.41"}), "is 192.168.1.41, which hsrb has too"),
    "same name": (
        problems(multimaster_sealed={"hsrb": {"address": "192.168.1.40", "aliases": ["Kobuki-PC"]}}),
        "also means",
    ),
    "true": (problems(multimaster_sealed=True), "is True; expected names of computers with their addresses, such as {"),
    "no name": (problems(multimaster_sealed={"a b": "192.168.1.40"}), "{hsrb: 192.168.1.40}, but 'a b' is no name"),
    "mistyped": (
        problems(multimaster_sealed={"hsrb": {"adress": "192.168.1.40"}}),
        "expected 'address' and 'aliases' of 'hsrb' (did you mean address?)",
    ),
    "no address": (problems(multimaster_sealed={"hsrb": {}}), "expected an IPv4 address such as"),
    "no master": (problems(multimaster_master="hsrc"), "expected one of hsr-pc, hsrb (did you mean"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_seal_is_one_sentence(case):
    found, sentence = WRONG[case]
    assert len(found) == 1 and sentence in found[0], found


def test_one_sealed_computer_has_one_robot():
    sealed = {**SHARED, **HSR}
    values = {f"hsr{n}-pc": {**sealed, "multimaster_address": f"192.168.1.{n}"} for n in (1, 2)}
    with pytest.raises(
        InventoryProblems, match="hsrb: is in multimaster_sealed of the robots hsr1 and hsr2; expected one"
    ):
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
    assert problem.startswith(
        f"{host}: multimaster_rpc_port is 11911, which is also the port of its relay, which it needs"
    )
    assert not find_port_problems(*ports, exports=[{"topics": ["/scan"]}]), (
        "a robot without a relay leaves this port free"
    )


def test_a_relay_has_a_port():
    (problem,) = find_port_problems({"multimaster_roscore_port": 65000})
    assert problem.startswith("a: multimaster_roscore_port is 65000, and the port of the relay is 600 above it")
    assert "expected at most 64935: set another one in group_vars/ra.yml." in problem
    assert not find_port_problems({"multimaster_roscore_port": 64935})
    assert not find_port_problems({"multimaster_roscore_port": 65000}, exports=[{"topics": ["/scan"]}])
