# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The places where the nodes of another master may be."""

import pytest
from fleet_of_one import ROUTER, TIBI, URI
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol.graph import Node, State
from rosfleet_multimaster.protocol.members import Members, Networks
from rosfleet_multimaster.sync.core.places import MAX_NAMES, LocalNetwork, Places, names_to_resolve

OWN = "192.168.1.202"
HERE = LocalNetwork(frozenset([OWN, "127.0.0.1"]), Networks([f"{OWN}/24"]))
MEMBERS = {"members": [TIBI, ROUTER], "strangers": "ignore", "allow": ["192.168.7.0/24", "192.168.1.77/32"]}
RESOLVED = {
    "laptop": "192.168.1.77",
    "evil": "8.8.8.8",
    "own": OWN,
    "loop": "127.0.1.1",
    "tibi-laser.local": "192.168.11.102",
}


def find_refusal(uri, master=URI, sender="192.168.1.201", members=None):
    return Places(
        Members.from_parameters(MEMBERS if members is None else members),
        master,
        f"http://{sender}:11611",
        HERE,
        RESOLVED,
    ).find_refusal(uri)


@pytest.mark.parametrize(
    "uri",
    [
        "http://tibi-visio:34567/",
        "http://Tibi-Laser:34567",
        "http://tibi-laser.local:34567/",
        "http://192.168.11.102:34567/",
        "rosrpc://192.168.1.201:34567",
        "http://192.168.1.77:40000/",
        "http://laptop:40000/",
    ],
)
def test_nodes_of_a_robot_are_on_allowed_computers(uri):
    assert find_refusal(uri) == ""


WRONG = {
    "http://127.0.0.1:9001/": "on this computer itself",
    "http://localhost:9001/": "on this computer itself",
    "http://loop:9001/": "on this computer itself",
    "http://0.0.0.0:9001/": "on this computer itself",
    f"http://{OWN}:9001/": "on this computer itself",
    "http://own:9001/": "on this computer itself",
    "http://127.1:9001/": "in its usual spelling",
    "http://2130706433:9001/": "in its usual spelling",
    "http://0x7f.1:9001/": "in its usual spelling",
    "http://127.0.0.1.:9001/": "in its usual spelling",
    "http://tibi-visio.:9001/": "in its usual spelling",
    "http://[fe80::1%25eth0]:9001/": "in its usual spelling",
    "http://0177.0.0.1:9001/": "in its usual spelling",
    "http://[::1]:9001/": "neither a name nor an IPv4 address",
    "http://[::ffff:127.0.0.1]:9001/": "in its usual spelling",
    "http://:9001/": "in its usual spelling",
    "http://192.168.1.203:9001/": "192.168.1.203 is no computer of tibi",
    "http://8.8.8.8:9001/": "8.8.8.8 is no computer of tibi",
    "http://evil:9001/": '"evil" is no computer of tibi',
    "http://unknown:9001/": '"unknown" is no computer of tibi',
    "http://192.168.1.1:9001/": "is no computer of tibi",
    "http://tibi-visio:9001/any/path": "in its usual spelling",
    "http://tibi-visio:9001/?x": "in its usual spelling",
    "http://tibi-visio@evil:9001/": "in its usual spelling",
    "http://tibi-visio:9001@evil:9001/": "in its usual spelling",
    "http://tibi-visio/": "its port is no node's",
    "http://tibi-visio:22/": "its port is no node's",
    "http://tibi-visio:0/": "its port is no node's",
    "http://tibi-visio:99999/": "in its usual spelling",
    "http://tibi-visio:x/": "in its usual spelling",
    "http://tibi-visio:11311/": "port 11311 there is its roscore's or its discovery's",
    "rosrpc://tibi-laser:11611": "port 11611 there is its roscore's or its discovery's",
}


@pytest.mark.parametrize("uri", WRONG)
def test_everything_else_is_refused(uri):
    assert WRONG[uri] in find_refusal(uri)


STRANGER = "http://guest:11311/"


@pytest.mark.parametrize(
    ("uri", "said"),
    [
        ("http://10.0.0.9:40000/", ""),
        ("http://192.168.1.88:40000/", ""),
        ("http://192.168.7.8:40000/", ""),
        ("http://laptop:40000/", ""),
        ("http://10.0.0.10:40000/", "in no network of this computer"),
        ("http://evil:40000/", "8.8.8.8 is in no network of this computer"),
        ("http://unknown:40000/", '"unknown" has no address on this computer'),
        (f"http://{OWN}:40000/", "on this computer itself"),
    ],
)
def test_an_allowed_stranger_has_its_own_address_and_networks(uri, said):
    assert said in find_refusal(uri, STRANGER, "10.0.0.9", {**MEMBERS, "strangers": "allow"})
    assert bool(said) == bool(find_refusal(uri, STRANGER, "10.0.0.9", {**MEMBERS, "strangers": "allow"}))


@pytest.mark.parametrize("master", [URI, STRANGER])
@pytest.mark.parametrize("host", ["10.9.0.1", "10.9.0.2"])
def test_who_is_allowed_is_not_at_another_robot(master, host):
    """An allowed network with robots in it: what is said to be at one of them would have own nodes connect there."""
    third = {
        **TIBI,
        "robot": "third",
        "name": "third",
        "uris": [],
        "addresses": ["10.9.0.1"],
        "hosts": ["third", "10.9.0.1"],
    }
    wide = {"members": [TIBI, third], "strangers": "allow", "allow": ["10.9.0.0/16"]}
    said = find_refusal(f"http://{host}:40000/", master, "192.168.1.201" if master == URI else "10.9.0.3", wide)
    assert bool(said) == (host == "10.9.0.1") and (not said or " computer of " in said)


def test_odd_uris_are_refused_without_a_fleet():
    for uri in ("http://10.0.0.10:40000/", "http://unknown:40000/", "http://192.168.1.88:40000/"):
        assert find_refusal(uri, STRANGER, "10.0.0.9", {}) == ""
    for uri in ("http://127.0.0.1:9001/", f"http://{OWN}:9001/", "http://10.0.0.9:9001/x", "http://10.0.0.9:80/"):
        assert find_refusal(uri, STRANGER, "10.0.0.9", {}) != ""


def test_a_second_master_on_this_computer_has_its_nodes_here():
    assert find_refusal(f"http://{OWN}:40000/", STRANGER, OWN, {}) == ""
    assert find_refusal("http://127.0.0.1:40000/", STRANGER, "127.0.0.1", {}) == ""


def state(*uris):
    nodes = {f"/n{number}": Node(uri, URI, "local") for number, uri in enumerate(uris)}
    return State(URI, "tibi-visio", nodes=nodes, providers={"/s": Node("rosrpc://odd:40000", URI, "local")})


def test_only_unplanned_names_are_looked_up():
    members = Members.from_parameters(MEMBERS)
    found = names_to_resolve(
        state("http://tibi-laser:1/", "http://192.168.1.5:1/", "http://Guest:1/", "", "x"), members
    )
    assert found == ["guest", "odd"]
    assert len(names_to_resolve(state(*(f"http://h{number}:1/" for number in range(100))), members)) == MAX_NAMES
    assert names_to_resolve(state("http://guest:1/"), Members()) == []


@given(st.text(max_size=40), st.sampled_from(["http://{}:9/", "http://{}", "http://tibi-visio{}", "{}"]))
def test_whatever_a_uri_is_there_is_an_answer(text, form):
    uri = form.format(text)
    said = find_refusal(uri)
    assert isinstance(said, str)
    if not said:
        assert any(host in uri.lower() for host in (*TIBI["hosts"], "laptop", "192.168.7.", "192.168.1.77"))
