# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The parts of an inventory that are rehearsed, left aside, or refused."""

import ipaddress
from pathlib import Path

import pytest
from mentioned import mentions
from rehearsals import rehearsal

SUITES = ("bullseye", "bookworm", "trixie")


def values(**variables):
    """Two robots; `variables` are those of ana-nav."""
    shared = {"multimaster_common_network": "192.168.1.0/24"}
    ana = {**shared, "multimaster_network": "192.168.11.0/24", "multimaster_address": "192.168.11.2"}
    return {
        "robots": {"ana": ["ana-nav"], "bob": ["bob-pc"]},
        "routers": [],
        "router": None,
        "common_network": "192.168.1.0/24",
        "networks": [
            {
                "robot": "ana",
                "network": "192.168.11.0/24",
                "gateway": "192.168.11.1",
                "common_address": "192.168.1.201",
                "device": True,
            }
        ],
        "variables": {"ana-nav": {**ana, **variables}, "bob-pc": {**shared, "multimaster_address": "192.168.1.7"}},
    }


def machine(*networks, available=10000):
    return rehearsal.Machine(tuple((ipaddress.ip_network(text), "its interface eth0") for text in networks), available)


def test_the_inventory_has_the_robots_and_nothing_else():
    found = rehearsal.make_rehearsable(values())
    assert found.inventory == {
        "robots": {
            "children": {
                robot: {"hosts": {host: values()["variables"][host]}}
                for robot, host in (("ana", "ana-nav"), ("bob", "bob-pc"))
            }
        }
    }
    assert found.roscores == {}


def test_a_device_that_is_no_computer_gets_a_stand_in():
    found = rehearsal.make_rehearsable({**values(), "router": {"name": "", "address": "192.168.1.1"}})
    assert {name: extra.addresses for name, extra in found.devices.items()} == {
        "device-gateway-ana": ("192.168.1.201", "192.168.11.1"),
        "device-router": ("192.168.1.1",),
    }
    assert mentions(found.notes, "192.168.1.1", "Linux")


@pytest.mark.parametrize(
    ("variable", "value", "instead"),
    [
        ("multimaster_provider", "fkie_apt", "bundled"),
        ("multimaster_ros_setup", "/home/robot/ws/devel/setup.bash", "auto"),
        ("multimaster_routes", "existing", "networks"),
    ],
)
def test_what_containers_cannot_have_is_said(variable, value, instead):
    found = rehearsal.make_rehearsable(values(**{variable: value}))
    assert found.inventory["robots"]["children"]["ana"]["hosts"]["ana-nav"][variable] == instead
    (note,) = [note for note in found.notes if variable in note]
    assert note.startswith(f"ana-nav: {variable} is '{value}'; ") and f"'{instead}'" in note


@pytest.mark.parametrize(
    ("variable", "value"),
    [("multimaster_provider", "bundled"), ("multimaster_ros_setup", "debian"), ("multimaster_routes", "default")],
)
def test_what_containers_can_have_stays(variable, value):
    found = rehearsal.make_rehearsable(values(**{variable: value}))
    assert found.inventory["robots"]["children"]["ana"]["hosts"]["ana-nav"][variable] == value
    assert not [note for note in found.notes if variable in note]


def test_a_roscore_that_something_else_starts():
    found = rehearsal.make_rehearsable(values(multimaster_roscore="existing", multimaster_roscore_port=11411))
    assert found.roscores == {"ana-nav": 11411}


def test_a_sealed_computer_gets_a_container_with_a_roscore():
    sealed = {"hsrb": {"address": "192.168.11.40"}}
    found = rehearsal.make_rehearsable(values(multimaster_sealed=sealed, multimaster_master="hsrb"))
    assert found.roscores == {"hsrb": 11311} and found.sealed["hsrb"].address == "192.168.11.40"
    assert mentions(found.notes, "ROS", "hsrb")


def test_a_declaration_that_leaves_nobody_out_has_no_note():
    for exports in ([], [{"topics": ["/pose"]}], [{"topics": ["/pose"], "to": ["bob"]}]):
        assert not [
            note for note in rehearsal.make_rehearsable(values(multimaster_exports=exports)).notes if "gives" in note
        ]


def test_what_is_left_aside():
    listing = {
        "_meta": {
            "hostvars": {
                "a": {
                    "ansible_host": "x",
                    "ansible_facts": {},
                    "multimaster_address": "y",
                    "lab_suite": "z",
                    "wifi": "w",
                },
                "b": {
                    "ansible_host": "x",
                    "ansible_become_password": {"__ansible_vault": "$ANSIBLE_VAULT;1.1;AES256\n61"},
                },
                "c": {"ansible_host": "x", "verify_patience": 20},
                "other": {"ansible_port": 22},
            }
        }
    }
    assert rehearsal.list_unused(listing, ["a", "b", "c"], ["group_vars/all/vault.yml"]) == [
        "group_vars/all/vault.yml: an encrypted file",
        "ansible_become_password (encrypted): of b",
        "ansible_host: of all 3 computers",
        "wifi: of a",
    ]


def test_a_machine_that_can_rehearse_it():
    found = rehearsal.make_rehearsable(values())
    assert rehearsal.impossible(values(), found.devices, machine("10.0.0.0/8"), SUITES) == []
    assert rehearsal.overlaps(values(), machine("10.0.0.0/8")) == []


@pytest.mark.parametrize(
    ("network", "words"),
    [
        (
            "192.168.1.128/25",
            "multimaster_common_network is 192.168.1.0/24, which overlaps with 192.168.1.128/25 of this machine",
        ),
        (
            "192.168.0.0/20",
            "multimaster_network of the robot ana is 192.168.11.0/24, which overlaps with 192.168.0.0/20",
        ),
    ],
)
def test_a_network_of_this_machine(network, words):
    assert any(sentence.startswith(words) for sentence in rehearsal.overlaps(values(), machine(network)))


def test_too_many_computers_for_this_machine():
    found = rehearsal.impossible(values(), {}, machine(available=rehearsal.MEMORY * 2 - 1), SUITES)
    assert [sentence for sentence in found if "2 computers" in sentence and "at most 1 computers" in sentence]


def test_a_release_without_an_image():
    (found,) = rehearsal.impossible(values(lab_suite="buster"), {}, machine(), SUITES)
    assert (
        found.startswith("ana-nav: lab_suite is 'buster'; expected a release") and "bullseye, bookworm, trixie" in found
    )


def test_a_name_that_no_system_can_have():
    given = values()
    given["variables"]["a" * 63 + ".b"] = given["variables"].pop("bob-pc")
    (found,) = rehearsal.impossible(given, {}, machine(), SUITES)
    assert "has 65 characters; expected at most 64" in found


def test_the_networks_of_a_machine():
    routes = [
        {"dst": "default", "dev": "eth0"},
        {"dst": "192.168.1.0/24", "dev": "eth0"},
        {"dst": "10.1.2.3", "dev": "tun0"},
        {"dst": "224.0.0.0/4", "dev": "eth0"},
    ]
    podmans = [
        {"name": "podman", "subnets": [{"subnet": "10.88.0.0/16"}, {"subnet": "fd00::/64"}]},
        {"name": "ours-demo-192.168.1.0-24", "subnets": [{"subnet": "172.16.0.0/24"}]},
        {"name": "plain"},
    ]
    assert [(str(network), whose) for network, whose in rehearsal.networks_of(routes, podmans, "ours-")] == [
        ("192.168.1.0/24", "its interface eth0"),
        ("10.1.2.3/32", "its interface tun0"),
        ("10.88.0.0/16", "podman's network podman"),
    ]


def test_names_of_rehearsals_are_never_those_of_others():
    one, two = (rehearsal.name_of(Path(f"/home/{user}/My fleet-2")) for user in ("ana", "bob"))
    assert one != two and one.startswith("my_fleet_2_")
    # A container is CHECKOUT-LAB-HOST: no host has an underscore or begins with a dot, no lab of another kind has a dot.
    assert "-" not in one and rehearsal.lab_of(one) == f"rehearse.{one}"
    assert rehearsal.name_of(Path("/")).startswith("fleet_")
