# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The tunnel: who is a peer of whom, the files of WireGuard, and which keys are believed."""

import base64
import random

import pytest
from ansible_collections.rosfleet.multimaster.plugins.filter.tunnel_files import tunnel_files
from ansible_collections.rosfleet.multimaster.plugins.module_utils._features.tunnel import key as made
from ansible_collections.rosfleet.multimaster.plugins.module_utils._features.tunnel import wireguard
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import from_plain, to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.tunnel import files as tunnel_texts
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.tunnel import keys as public
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.tunnel import plan as planned
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.tunnel.model import INTERFACE, Tunnel
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import (
    Inventory,
    InventoryProblems,
    read_fleet,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import preflight, units
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import FleetPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan
from fleets import plan
from hypothesis import given
from hypothesis import strategies as st

ANA, BOB, GATE, ARM = "ana-pc", "bob-pc", "dan-gate", "dan-arm"
SHARED = {
    "multimaster_common_network": "10.77.0.0/24",
    "multimaster_tunnel": "wireguard",
    "multimaster_transport": "unicast",
    "multimaster_firewall": "fleet",
}
DAN = {
    "multimaster_network": "192.168.29.0/24",
    "multimaster_gateway": GATE,
    "multimaster_common_address": "10.77.0.24",
    "multimaster_master": GATE,
}
HOSTS = {
    ANA: {"multimaster_address": "10.77.0.21", "multimaster_endpoint": "192.168.28.21"},
    BOB: {"multimaster_address": "10.77.0.22"},
    GATE: {"multimaster_address": "192.168.29.1", "multimaster_endpoint": "192.168.28.24", **DAN},
    ARM: {"multimaster_address": "192.168.29.2", **DAN},
}
ROBOTS = {"ana": [ANA], "bob": [BOB], "dan": [GATE, ARM]}


def fleet(changes=None, **shared):
    values = {host: {**SHARED, **shared, **own, **(changes or {}).get(host, {})} for host, own in HOSTS.items()}
    values = {host: {name: value for name, value in own.items() if value is not None} for host, own in values.items()}
    return fleet_plan(read_fleet(Inventory(robots=ROBOTS, variables=values)))


def key(number):
    return base64.b64encode(random.Random(number).randbytes(32)).decode()


KEYS = {name: key(number) for number, name in enumerate((ANA, BOB, GATE))}


def texts(computer, keys=None):
    return {
        file["path"]: file["content"]
        for file in tunnel_texts.render_tunnel(Tunnel.find(fleet().computers[computer]), keys or KEYS)
    }


def test_without_the_variable_there_is_none():
    computers = plan().computers
    assert {Tunnel.find(of) for of in computers.values()} == {None} and tunnel_texts.render_tunnel(
        None, {}
    ) == [] == tunnel_files({})
    assert all("tunnel" not in of.look_at.parts and "tunnel" not in to_plain(of) for of in computers.values())


def test_each_computer_of_the_common_network_is_a_peer():
    computers = fleet().computers
    assert Tunnel.find(computers[ARM]) is None and "tunnel" not in computers[ARM].services
    peers = {peer.computer: peer for peer in Tunnel.find(computers[ANA]).peers}
    assert list(map(str, peers[GATE].networks)) == ["10.77.0.24/32", "192.168.29.0/24"]
    assert str(peers[GATE].endpoint) == "192.168.28.24" and peers[BOB].endpoint is None
    assert [(str(route.destination), str(route.gateway)) for route in Tunnel.find(computers[ANA]).routes] == [
        ("192.168.29.0/24", "10.77.0.24")
    ]
    assert computers[ANA].routes == () and computers[ARM].routes  # by its gateway, as ever
    assert computers[ANA].services[0] == "tunnel" and "51820/udp" in computers[ANA].firewall.open_ports
    assert not any(member.multicast for member in fleet().members)
    plain = to_plain(fleet())
    assert Tunnel.find(from_plain(FleetPlan, plain).computers[ANA]) == Tunnel.find(computers[ANA])


def peers_of(plans, computer):
    return {peer.computer: [str(network) for network in peer.networks] for peer in Tunnel.find(plans[computer]).peers}


def test_who_has_no_endpoint_is_reached_through_the_hub():
    plans = fleet({GATE: {"multimaster_endpoint": None}}, multimaster_tunnel_hub=ANA).computers
    assert peers_of(plans, BOB) == {ANA: ["10.77.0.21/32", "10.77.0.24/32", "192.168.29.0/24"]}
    assert peers_of(plans, GATE) == {ANA: ["10.77.0.21/32", "10.77.0.22/32"]}
    assert peers_of(plans, ANA) == {BOB: ["10.77.0.22/32"], GATE: ["10.77.0.24/32", "192.168.29.0/24"]}
    hub, other = plans[ANA], plans[BOB]
    assert Tunnel.find(hub).hub and hub.forwards and not Tunnel.find(other).hub and not other.forwards
    settings = {setting.name: setting.value for setting in hub.sysctl}
    assert settings["net.ipv4.ip_forward"] == "1" and settings["net.ipv4.conf.all.send_redirects"] == "0"
    assert {"10.77.0.22/32", "10.77.0.24/32", "192.168.29.0/24"} <= {*map(str, hub.firewall.networks)}
    assert "# The hub:" in tunnel_texts.render_tunnel(Tunnel.find(hub), KEYS)[0]["content"]
    assert Tunnel.find(other).find_carrier(plans[GATE].common_address) == ANA


def test_without_a_tunnel_a_hub_is_a_computer_as_others():
    plans = [
        fleet(multimaster_tunnel="none", multimaster_transport="both", **more).computers
        for more in ({}, {"multimaster_tunnel_hub": ANA})
    ]
    assert to_plain(plans[0][ANA]) == to_plain(plans[1][ANA])


def test_with_a_hub_two_with_endpoints_are_still_neighbours():
    plans = fleet(multimaster_tunnel_hub=ANA).computers
    assert list(peers_of(plans, BOB)) == [ANA] and list(peers_of(plans, ANA)) == [BOB, GATE]
    assert peers_of(plans, GATE) == {ANA: ["10.77.0.21/32", "10.77.0.22/32"]}


def test_the_files_have_the_peers_of_the_plan_and_no_private_key():
    files = texts(ANA)
    text = files[tunnel_texts.CONFIGURATION]
    assert text.count("[Peer]") == 2 and "PrivateKey" not in text and "private-key /etc/wireguard/" in text
    assert "AllowedIPs = 10.77.0.24/32, 192.168.29.0/24\nEndpoint = 192.168.28.24:51820\n" in text
    assert f"PublicKey = {KEYS[BOB]}\nAllowedIPs = 10.77.0.22/32\nPersistentKeepalive = 3\n" in text
    assert "ip route replace 192.168.29.0/24 via 10.77.0.24 dev %i" in text
    assert tunnel_files(to_plain(Tunnel.find(fleet().computers[ANA])), KEYS) == tunnel_texts.render_tunnel(
        Tunnel.find(fleet().computers[ANA]), KEYS
    )


def guards_of(plans, computer):
    found = plans[computer].firewall.guards
    return {guard.interface: [str(network) for network in guard.networks] for guard in found}


def test_each_network_comes_in_at_one_interface():
    """The whole network of the tunnel, so who is allowed there is, too; behind a gateway all comes from the gateway."""
    plans = fleet(multimaster_allow=["10.77.0.99"]).computers
    assert guards_of(plans, ANA) == {"{common}": ["10.77.0.0/24", "192.168.29.0/24"]}
    assert guards_of(plans, GATE) == {"{common}": ["10.77.0.0/24"], "{own}": ["192.168.29.0/24"]}
    assert guards_of(plans, ARM) == {"{own}": ["192.168.29.0/24", "10.77.0.0/24"]}
    more, by_hub = {BOB: {"multimaster_endpoint": "192.168.28.22"}}, fleet(multimaster_tunnel_hub=ANA).computers
    assert (
        guards_of(fleet(more).computers, ANA) == guards_of(by_hub, ANA) == guards_of(plans, ANA)
    )  # peers are not in it


def test_without_a_tunnel_only_the_own_network_has_a_place():
    plans = fleet(multimaster_tunnel="none", multimaster_transport="both").computers
    assert guards_of(plans, GATE) == guards_of(plans, ARM) == {"{own}": ["192.168.29.0/24"]}
    assert guards_of(plans, ANA) == {}


def test_who_has_no_key_yet_is_no_peer():
    assert texts(ANA, {ANA: KEYS[ANA], BOB: "no key"})[tunnel_texts.CONFIGURATION].count("[Peer]") == 0


@pytest.mark.parametrize(
    ("changes", "shared", "words"),
    [
        ({}, {"multimaster_transport": "both"}, "expected 'unicast'"),
        ({}, {"multimaster_firewall": "none"}, "multimaster_firewall is 'none'"),
        ({}, {"multimaster_router": "10.77.0.1"}, "has a router"),
        ({ANA: {"multimaster_endpoint": None}}, {}, "ana-pc, bob-pc have no multimaster_endpoint"),
        ({}, {"multimaster_tunnel_hub": "ana"}, "multimaster_tunnel_hub is 'ana'"),
        ({}, {"multimaster_tunnel_hub": ARM}, "a multimaster_endpoint, at which all others reach it"),
        ({}, {"multimaster_tunnel_hub": BOB}, "multimaster_tunnel_hub is 'bob-pc'"),
        ({ANA: {"multimaster_endpoint": "10.77.0.99"}}, {}, "ana-pc is in the tunnel itself"),
        (
            {BOB: {"multimaster_endpoint": "192.168.28.21"}},
            {},
            "is 192.168.28.21 on ana-pc, bob-pc; expected an address for each",
        ),
        ({GATE: {"multimaster_endpoint": "192.168.29.1"}}, {}, "of dan-gate is in the own network of a robot"),
        ({ANA: {"multimaster_endpoint": "255.255.255.255"}}, {}, "the IPv4 address of one computer"),
        ({ANA: {"multimaster_endpoint": "0.0.0.5"}}, {}, "the IPv4 address of one computer"),
        ({}, {"multimaster_tunnel_port": 11511}, "multimaster_tunnel_port is 11511, the port of discovery"),
        (
            {name: {"multimaster_gateway": "192.168.29.9"} for name in (GATE, ARM)},
            {},
            "the gateway of dan is no computer",
        ),
    ],
)
def test_what_a_tunnel_cannot_be_together_with(changes, shared, words):
    with pytest.raises(InventoryProblems) as found:
        fleet(changes, **shared)
    assert words in str(found.value)


def test_a_new_own_key_is_a_change_of_the_file():
    """Its peers stay, and the tunnel has to be started again."""
    before, after = texts(ANA), texts(ANA, {**KEYS, ANA: key(9)})
    assert before[tunnel_texts.CONFIGURATION] != after[tunnel_texts.CONFIGURATION]
    assert "(made in this run)" in texts(ANA, {BOB: KEYS[BOB]})[tunnel_texts.CONFIGURATION]


def test_the_controller_and_the_computer_mean_the_same():
    assert (tunnel_texts.KEY, INTERFACE) == (
        made.KEY,
        wireguard.INTERFACE,
    ) and tunnel_texts.KEEPALIVE < wireguard.LISTENS
    (unit,) = units.render_services(
        ["tunnel"],
        robot="ana",
        address="10.77.0.21",
        roscore_command="",
        roscore_port=11311,
        programs={},
        environment_digest="",
        files={},
    )
    assert f"wg-quick up {tunnel_texts.CONFIGURATION}\n" in unit["content"]
    assert f"delete dev {INTERFACE}\n" in unit["content"]


FOUND = {"interfaces": [{"name": "eth0", "addresses": [{"address": "192.168.28.21", "prefix": 24}]}], "tunnel": {}}


@pytest.mark.parametrize(
    ("interface", "kernel", "device", "right", "words"),
    [
        (None, True, True, True, []),
        (None, False, True, True, []),
        (None, False, False, True, ["no /dev/net/tun"]),
        (None, True, True, False, ["no CAP_NET_ADMIN"]),
        (INTERFACE, True, True, True, []),
        ("wg0", True, True, True, ["already on wg0"]),
    ],
)
def test_the_machine_is_asked_before_anything_changes(interface, kernel, device, right, words):
    own = fleet().computers[ANA]
    there = [{"name": interface, "addresses": [{"address": "10.77.0.21", "prefix": 24}]}] if interface else []
    info = {"interfaces": FOUND["interfaces"] + there, "tunnel": {"kernel": kernel, "device": device}}
    info["systemd"] = {"net_admin": right}
    problems = list(planned.find_tunnel_problems(own, info))
    assert [word in problem for word, problem in zip(words, problems, strict=True)] == [True] * len(words)
    packages = planned.list_tunnel_packages(own, info)
    assert ("wireguard-go" in packages) is not kernel and "wireguard-tools" in packages
    names = [entry["name"] for entry in preflight._add_interfaces(own, info)["interfaces"]]
    assert names.count(INTERFACE) == 1 and preflight._add_interfaces(fleet().computers[ARM], info) is info


@pytest.mark.parametrize("names", [["wg0", INTERFACE], [INTERFACE, "wg0"]])
def test_another_tunnel_with_the_same_address_is_refused_beside_ours(names):
    """In any order of the interfaces; and the guard stays with our interface."""
    own = fleet().computers[ANA]
    link = {"up": True, "loopback": False, "multicast": False, "point_to_point": True}
    there = [{"name": name, **link, "addresses": [{"address": "10.77.0.21", "prefix": 24}]} for name in names]
    info = {"interfaces": FOUND["interfaces"] + there, "tunnel": {"kernel": True, "device": True}}
    info["systemd"] = {"net_admin": True}
    (problem,) = planned.find_tunnel_problems(own, info)
    assert "already on wg0" in problem
    (wanted,) = (one for one in own.networks if str(one.address) == "10.77.0.21")
    assert preflight._find_interface(own, info, wanted)[0] == INTERFACE


@pytest.mark.parametrize(
    ("address", "prefix", "family", "is_wrong"),
    [
        ("10.77.0.5", 24, "inet", True),
        ("10.0.0.1", 8, "inet", True),
        ("10.78.0.5", 24, "inet", False),
        ("fd00::1", 64, "inet6", False),
    ],
)
def test_no_other_interface_is_in_the_network_of_the_tunnel(address, prefix, family, is_wrong):
    """Packets for robots would leave by it, in the clear."""
    eth1 = {"name": "eth1", "addresses": [{"address": address, "prefix": prefix, "family": family}]}
    info = {"interfaces": [*FOUND["interfaces"], eth1], "tunnel": {"kernel": True, "device": True}}
    info["systemd"] = {"net_admin": True}
    problems = list(planned.find_tunnel_problems(fleet().computers[ANA], info))
    assert [f"{address}/{prefix} on eth1 is in the network" in problem for problem in problems] == [True] * is_wrong


def join(kept, told, rotate=False):
    keys, refused = public.join_keys(kept, told, fleet().computers, rotate)
    assert all(text.startswith(f"{computer}: its public key is ") for computer, text in refused.items())
    return keys, refused


def test_kept_keys_and_told_ones_are_joined():
    assert join({}, {}) == ({}, {}) and join(KEYS, {}) == (KEYS, {})
    assert join({ANA: KEYS[ANA]}, {BOB: KEYS[BOB], GATE: ""}) == ({ANA: KEYS[ANA], BOB: KEYS[BOB]}, {})
    assert join({**KEYS, "gone": key(9), ARM: key(8)}, {ARM: key(7)}) == (KEYS, {})  # they are not in the tunnel
    assert public.read_keys(public.write_keys(KEYS)) == KEYS


@pytest.mark.parametrize("rotate", [False, True])
@pytest.mark.parametrize(
    ("lie", "words"),
    [
        ("short", "32 bytes"),
        (7, "32 bytes"),
        (["x"], "32 bytes"),
        (KEYS[BOB], f"is that of {BOB}, too"),
        (key(9), "was "),
    ],
    ids=["short", "a number", "a list", "of another one", "changed"],
)
def test_a_lie_about_a_key_costs_the_liar_alone(lie, words, rotate):
    """The others have their keys, also new ones, and the computer that lies has its kept key or none."""
    for kept in (KEYS, {name: entry for name, entry in KEYS.items() if name != ANA}):
        believed = lie == key(9) and (rotate or ANA not in kept)
        told = {ANA: lie, BOB: KEYS[BOB], GATE: key(5) if rotate else KEYS[GATE]}
        keys, refused = join(kept, told, rotate)
        assert list(refused) == ([] if believed else [ANA]) and words in refused.get(ANA, words)
        own = {ANA: lie} if believed else {ANA: kept[ANA]} if ANA in kept else {}
        assert keys == {BOB: KEYS[BOB], GATE: told[GATE], **own}


def test_a_victim_that_has_a_new_key_keeps_its_place():
    assert join(KEYS, {ANA: KEYS[BOB], BOB: key(9)}, rotate=True)[0] == {**KEYS, BOB: key(9)}
    keys, refused = join({GATE: KEYS[GATE]}, {ANA: key(9), BOB: key(9)})
    assert keys == {GATE: KEYS[GATE]} and list(refused) == [ANA, BOB], "nobody knows whose it is"


def test_new_keys_are_believed_where_they_were_asked_for():
    assert join(KEYS, {ANA: key(9)}, rotate=True) == ({**KEYS, ANA: key(9)}, {})


@pytest.mark.parametrize(
    "text", ["ana-pc", "ana-pc x", f"a {key(1)}\na {key(2)}", f"a {key(1)}\nb {key(1)}", f"a {key(1)} more"]
)
def test_a_file_that_is_none_of_ours_is_refused(text):
    with pytest.raises(public.WrongKeys, match="expected the name of a computer"):
        public.read_keys(text)


@given(st.text() | st.binary(min_size=32, max_size=32).map(lambda raw: base64.b64encode(raw).decode()))
def test_only_the_form_of_a_key_is_one(text):
    try:
        good = base64.b64encode(base64.b64decode(text, validate=True)).decode() == text and len(text) == 44
    except ValueError:
        good = False
    if public.is_key(text):
        assert len(base64.b64decode(text)) == 32 and "\n" not in text
    assert public.is_key(text) or not good


def test_one_key_has_one_spelling():
    """wg refuses a key whose last two bits are not zero, which Python reads; it would end the tunnels of all others."""
    raw = bytes(range(32))
    good = base64.b64encode(raw).decode()
    others = [good[:42] + letter + "=" for letter in "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"]
    same = [text for text in others if base64.b64decode(text) == raw]
    assert len(same) == 4 and [text for text in same if public.is_key(text)] == [good]
