# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The layout of section 4 of the report, from the shipped inventory: addresses, routes, gateways, and what cannot be routed."""

import copy
import ipaddress
import pathlib

import pytest
import yaml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.tunnel.model import Tunnel
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.tunnel.variables import EndpointVariables
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import contradictions
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import read as fleet_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.variables import FleetVariables, make
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import plan as plan_module
from hypothesis import given, settings
from hypothesis import strategies as st
from mentioned import mentions

SHIPPED = pathlib.Path(__file__).resolve().parents[5] / "inventory" / "multi_computer"


def _read():
    """The shipped inventory as the model takes it."""
    groups = yaml.safe_load((SHIPPED / "hosts.yml").read_text())
    of_group = {path.stem: yaml.safe_load(path.read_text()) for path in (SHIPPED / "group_vars").iterdir()}
    robots, variables = {}, {}
    for robot, group in groups["robots"]["children"].items():
        robots[robot] = list(group["hosts"])
        for host, own in group["hosts"].items():
            variables[host] = {**of_group["robots"], **of_group[robot], **own}
    for host, own in groups["routers"]["hosts"].items():
        variables[host] = dict(own)
    variables = {
        host: {name: value for name, value in values.items() if not name.startswith("ansible_")}
        for host, values in variables.items()
    }
    return {"robots": robots, "variables": variables, "routers": list(groups["routers"]["hosts"])}


MULTI = _read()


def fleet(*changes):
    """The fleet of Fig. 10 and 12, after changes of its inventory."""
    data = copy.deepcopy(MULTI)
    for change in changes:
        change(data)
    return fleet_module.read_fleet(fleet_module.Inventory(**data))


def computers(*changes):
    return to_plain(plan_module.fleet_plan(fleet(*changes)))["computers"]


def robot(name, **values):
    """A change of the variables of one robot; None removes one."""

    def change(data):
        for host in data["robots"][name]:
            data["variables"][host].update(values)

    return change


def everywhere(**values):
    return lambda data: [robot(name, **values)(data) for name in data["robots"]]


def host(name, **values):
    return lambda data: data["variables"][name].update(values)


def problems(*changes):
    with pytest.raises(fleet_module.InventoryProblems) as caught:
        fleet(*changes)
    return caught.value.problems


def kobuki(data):
    """A robot of one computer on the common network beside the others."""
    data["robots"]["kobuki"] = ["kobukicomputer"]
    data["variables"]["kobukicomputer"] = {
        "multimaster_address": "192.168.1.229",
        "multimaster_common_network": "192.168.1.0/24",
        "multimaster_multicast_group": "224.0.0.1",
    }


def test_the_hosts_file_of_figure_12():
    entries = {entry["address"]: entry["names"] for entry in to_plain(plan_module.fleet_plan(fleet()))["hosts_entries"]}
    assert entries == {
        "192.168.11.202": ["tibi-monitor"],
        "192.168.11.100": ["tibi-nav"],
        "192.168.11.101": ["tibi-visio"],
        "192.168.10.100": ["dabo-nav"],
        "192.168.10.101": ["dabo-visio"],
        "192.168.10.202": ["dabo-monitor"],
        "192.168.12.100": ["car-nav"],
        "192.168.12.101": ["car-visio"],
        "192.168.12.102": ["car-ext"],
        "192.168.12.103": ["car-display"],
        "192.168.12.104": ["car-control"],
        "192.168.12.202": ["car-monitor"],
    }


def test_the_routes_of_section_4_2():
    plan = computers()
    assert plan["tibi-nav"]["routes"] == [{"destination": "default", "gateway": "192.168.11.101"}]
    assert plan["tibi-visio"]["routes"] == [
        {"destination": "192.168.10.0/24", "gateway": "192.168.1.202"},
        {"destination": "192.168.12.0/24", "gateway": "192.168.1.203"},
    ]
    assert {"destination": "192.168.11.0/24", "gateway": "192.168.1.201"} in plan["router"]["routes"]
    assert len(plan["router"]["routes"]) == 3


def test_routes_of_networks_alone_leave_the_default_route():
    assert computers(everywhere(multimaster_routes="networks"))["tibi-nav"]["routes"] == [
        {"destination": "192.168.1.0/24", "gateway": "192.168.11.101"},
        {"destination": "192.168.10.0/24", "gateway": "192.168.11.101"},
        {"destination": "192.168.12.0/24", "gateway": "192.168.11.101"},
    ]


def test_existing_routes_are_expected_and_looked_at():
    nav = computers(robot("tibi", multimaster_routes="existing"))["tibi-nav"]
    assert nav["routes"] == []
    assert {"destination": "192.168.12.0/24", "gateways": ["192.168.11.101"]} in nav["routes_expected"]
    visio = computers(robot("tibi", multimaster_routes="existing"))["tibi-visio"]
    assert {"destination": "192.168.12.0/24", "gateways": ["192.168.1.203", "192.168.1.1"]} in visio["routes_expected"]
    assert nav["look_at"]["destinations"] == ["192.168.1.1", "192.168.10.1", "192.168.12.1"]


def test_a_robot_on_the_common_network_gets_routes_to_the_others():
    plan = computers(kobuki)
    assert (
        plan["kobukicomputer"]["routes"] == plan["router"]["routes"][::-1] or len(plan["kobukicomputer"]["routes"]) == 3
    )
    assert not plan["kobukicomputer"]["is_gateway"]
    assert [route["destination"] for route in plan["tibi-visio"]["routes"]] == ["192.168.10.0/24", "192.168.12.0/24"]


def test_only_gateways_and_the_router_forward():
    plan = computers()
    forwarding = [name for name, of in plan.items() if {"name": "net.ipv4.ip_forward", "value": "1"} in of["sysctl"]]
    assert sorted(forwarding) == ["car-visio", "dabo-visio", "router", "tibi-visio"]
    assert {"name": "net.ipv4.conf.{common}.send_redirects", "value": "0"} in plan["router"]["sysctl"]


def test_discovery_is_pinned_to_the_common_network_on_a_gateway():
    plan = computers()
    assert plan["tibi-visio"]["discovery"]["interface"] == "192.168.1.201"
    assert plan["tibi-visio"]["discovery"]["robot_hosts"] == ["192.168.10.100", "192.168.1.203"]
    assert plan["dabo-nav"]["discovery"]["interface"] == "192.168.10.100"
    assert plan["dabo-nav"]["discovery"]["robot_hosts"] == ["192.168.1.201", "192.168.1.203"]


def test_peers_are_symmetric():
    plan = to_plain(plan_module.fleet_plan(fleet()))
    address = {master["computer"]: master["address"] for master in plan["masters"]}
    for name, own in address.items():
        for other in address:
            listed = own in plan["computers"][other]["discovery"]["robot_hosts"]
            assert listed is (other != name)


def test_the_master_as_the_others_see_it():
    masters = {master["robot"]: master for master in to_plain(plan_module.fleet_plan(fleet()))["masters"]}
    assert masters["tibi"]["uri"] == "http://tibi-visio:11311/"
    assert masters["tibi"]["monitor_uri"] == "http://192.168.1.201:11611"
    assert masters["dabo"]["monitor_uri"] == "http://192.168.10.100:11611"


def test_who_takes_part_in_the_measurement():
    members = {member["name"]: member for member in to_plain(plan_module.fleet_plan(fleet()))["members"]}
    assert len(members) == 12
    assert [name for name, member in members.items() if member["multicast"]] == [
        "tibi-visio",
        "dabo-visio",
        "car-visio",
    ]
    assert members["dabo-nav"]["discovery"] and not members["dabo-nav"]["multicast"]
    assert members["tibi-visio"]["discovery_address"] == "192.168.1.201"


SMCROUTE = {"multimaster_multicast_routing": "smcroute", "multimaster_multicast_group": "239.255.0.1"}


def test_multicast_routing_is_the_gateways():
    plan = to_plain(plan_module.fleet_plan(fleet(everywhere(**SMCROUTE))))
    routing = {name: of["multicast_routing"] for name, of in plan["computers"].items() if "multicast_routing" in of}
    assert sorted(routing) == ["car-visio", "dabo-visio", "tibi-visio"]
    assert routing["dabo-visio"] == {"group": "239.255.0.1", "addresses": ["192.168.10.101", "192.168.1.202"]}
    assert next(member for member in plan["members"] if member["name"] == "dabo-nav")["multicast"]


def test_a_gateway_of_another_make():
    device = robot("tibi", multimaster_gateway="192.168.11.1")
    plan = to_plain(plan_module.fleet_plan(fleet(device, robot("tibi", multimaster_master="tibi-nav"))))
    assert plan["networks"][0] == {
        "robot": "tibi",
        "network": "192.168.11.0/24",
        "gateway": "192.168.11.1",
        "common_address": "192.168.1.201",
        "device": True,
    }
    assert plan["computers"]["tibi-visio"]["routes"] == [{"destination": "default", "gateway": "192.168.11.1"}]
    assert not any(computer["is_gateway"] for computer in plan["computers"].values() if computer["robot"] == "tibi")


def test_a_router_of_another_make_is_only_named():
    def change(data):
        data["routers"] = []
        everywhere(multimaster_router="192.168.1.254")(data)

    plan = to_plain(plan_module.fleet_plan(fleet(change)))
    assert plan["router"] == {"name": "", "address": "192.168.1.254"}
    assert len(plan["computers"]) == 12


def test_every_packet_finds_its_way_and_back():
    """Follow the routes of the plan from every computer to every other: it arrives, in at most three hops."""
    plan = computers(kobuki)
    at = {entry["address"]: name for name, of in plan.items() for entry in of["networks"]}

    def way(source, address):
        here, hops = source, 0
        while at[address] != here:
            target = ipaddress.ip_address(address)
            connected = [entry["network"] for entry in plan[here]["networks"]]
            if any(target in ipaddress.ip_network(network) for network in connected):
                return hops + 1
            routes = sorted(
                (
                    ipaddress.ip_network("0.0.0.0/0" if route["destination"] == "default" else route["destination"]),
                    route["gateway"],
                )
                for route in plan[here]["routes"]
            )
            gateways = [
                gateway for network, gateway in sorted(routes, key=lambda one: -one[0].prefixlen) if target in network
            ]
            assert gateways, f"{here} has no route to {address}"
            assert any(ipaddress.ip_address(gateways[0]) in ipaddress.ip_network(network) for network in connected)
            here, hops = at[gateways[0]], hops + 1
            assert hops < 4, f"{source} -> {address} goes round"
        return hops

    for source in plan:
        for address in at:
            assert way(source, address) <= 3


WRONG = {
    "overlapping networks": (
        [robot("dabo", multimaster_network="192.168.10.0/23")],
        "multimaster_network tibi 192.168.11.0/24 dabo 192.168.10.0/23",
    ),
    "a network in the common one": (
        [
            robot("tibi", multimaster_network="192.168.1.128/25"),
            *(
                host(name, multimaster_address=f"192.168.1.{number}")
                for number, name in enumerate(("tibi-nav", "tibi-visio", "tibi-monitor"), 130)
            ),
        ],
        "multimaster_network tibi 192.168.1.128/25 multimaster_common_network 192.168.1.0/24",
    ),
    "a gateway outside the common network": (
        [robot("tibi", multimaster_common_address="192.168.2.201")],
        "tibi-visio multimaster_common_address 192.168.2.201 multimaster_common_network 192.168.1.0/24",
    ),
    "a computer outside its network": (
        [host("tibi-nav", multimaster_address="192.168.10.77")],
        "tibi-nav multimaster_address 192.168.10.77 multimaster_network 192.168.11.0/24",
    ),
    "no gateway": (
        [robot("tibi", multimaster_gateway=None)],
        "multimaster_gateway tibi multimaster_network tibi-nav tibi-visio tibi-monitor",
    ),
    "no address of the gateway": (
        [robot("tibi", multimaster_common_address=None)],
        "multimaster_common_address tibi multimaster_network",
    ),
    "no network": ([robot("tibi", multimaster_network=None)], "multimaster_network tibi multimaster_gateway"),
    "a network with host bits": (
        [robot("tibi", multimaster_network="192.168.11.1/24")],
        "multimaster_network 192.168.11.1/24 IPv4",
    ),
    "a network of one address": (
        [robot("tibi", multimaster_network="192.168.11.101/32")],
        "multimaster_network 192.168.11.101/32 IPv4",
    ),
    **{
        f"the network {network}": ([robot("tibi", multimaster_network=network)], f"multimaster_network {network} IPv4")
        for network in ("0.0.0.0/0", "127.0.0.0/8", "224.0.0.0/4")
    },
    "a gateway of another robot": (
        [robot("tibi", multimaster_gateway="dabo-visio")],
        "multimaster_gateway tibi dabo-visio",
    ),
    "a gateway by its address": (
        [robot("tibi", multimaster_gateway="192.168.11.101")],
        "multimaster_gateway tibi 192.168.11.101 tibi-visio write",
    ),
    "a device outside the robot's network": (
        [robot("tibi", multimaster_gateway="192.168.1.9")],
        "multimaster_gateway 192.168.1.9 multimaster_network 192.168.11.0/24",
    ),
    "the same common address twice": (
        [robot("dabo", multimaster_common_address="192.168.1.201")],
        "dabo-visio multimaster_common_address 192.168.1.201 tibi-visio",
    ),
    "the router's address": (
        [robot("dabo", multimaster_common_address="192.168.1.1")],
        "multimaster_address 192.168.1.1 dabo-visio",
    ),
    "a router outside the common network": (
        [host("router", multimaster_address="10.0.0.1")],
        "multimaster_address 10.0.0.1 multimaster_common_network",
    ),
    "a router without an address": ([host("router", multimaster_address=None)], "multimaster_address router"),
    "two routers": (
        [lambda data: data.update(routers=["router", "other"]), lambda data: data["variables"].update(other={})],
        "group routers 2",
    ),
    "a robot's computer as the router": (
        [lambda data: data.update(routers=["tibi-visio"])],
        "tibi-visio group routers",
    ),
    "a mistyped variable of the router": (
        [host("router", multimaster_adress="192.168.1.1")],
        "router multimaster_adress multimaster_address",
    ),
    "a master nobody can reach": (
        [everywhere(multimaster_transport="multicast")],
        "dabo-nav dabo gateway dabo-visio multimaster_transport multicast",
    ),
    "a group that no router passes on": (
        [everywhere(multimaster_multicast_routing="smcroute")],
        "multimaster_multicast_group 224.0.0.1",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_routed_is_one_sentence(case):
    changes, expected = WRONG[case]
    found = problems(*changes)
    assert len(found) == 1, found
    assert mentions(found[0], *expected.split())


def test_routed_multicast_alone_reaches_an_inner_master():
    fleet(everywhere(multimaster_transport="multicast", **SMCROUTE))


@pytest.mark.slow
@settings(max_examples=200)
@given(
    st.dictionaries(
        st.sampled_from(
            [
                "multimaster_network",
                "multimaster_gateway",
                "multimaster_common_address",
                "multimaster_routes",
                "multimaster_router",
            ]
        ),
        st.sampled_from(
            [
                None,
                "",
                "192.168.11.0/24",
                "192.168.1.0/24",
                "0.0.0.0/0",
                "192.168.11.101",
                "192.168.1.201",
                "tibi-visio",
                "x",
                7,
                [],
            ]
        ),
    )
)
def test_whatever_a_robot_says_the_answer_is_a_plan_or_sentences(values):
    try:
        assert len(computers(robot("tibi", **values))) == 13
    except fleet_module.InventoryProblems as found:
        assert all(sentence.endswith(".") for sentence in found.problems)


# The packet filter


def filtered(data):
    for values in data["variables"].values():
        values["multimaster_firewall"] = "fleet"


def test_without_the_variable_there_is_no_packet_filter():
    plan = to_plain(plan_module.fleet_plan(fleet()))
    assert plan["let_in"] == []
    assert not any(entry["firewall"] for entry in plan["computers"].values())


def test_a_packet_filter_lets_in_planned_addresses_alone():
    def change(data):
        filtered(data)
        data["variables"]["router"].pop("multimaster_firewall")  # a variable of the robots
        for values in data["variables"].values():
            values["multimaster_allow"] = ["192.168.1.77"]

    plan = to_plain(plan_module.fleet_plan(fleet(change)))
    planned = [values["multimaster_address"] for values in MULTI["variables"].values()]
    gateways = [f"192.168.1.{last}" for last in (201, 202, 203)]
    assert {entry.removesuffix("/32") for entry in plan["let_in"]} == {*planned, *gateways, "192.168.1.77"}
    assert len(plan["let_in"]) == len(set(plan["let_in"]))
    networks = {name: entry["firewall"]["networks"] for name, entry in plan["computers"].items()}
    assert networks["tibi-nav"] == []
    assert networks["tibi-visio"] == ["192.168.11.0/24"]
    own = [MULTI["variables"][next(iter(hosts))]["multimaster_network"] for hosts in MULTI["robots"].values()]
    assert networks["router"] == [*own, *(f"{address}/32" for address in gateways_in_order(plan))]


def gateways_in_order(plan):
    return [entry["common_address"] for entry in plan["networks"]]


def test_what_one_computer_lets_in_besides_is_its_own():
    def change(data):
        filtered(data)
        data["variables"]["router"].pop("multimaster_firewall")
        data["variables"]["tibi-nav"].update(
            multimaster_firewall_also=["192.168.2.201"], multimaster_firewall_ports=["51820/udp"]
        )

    found = computers(change)
    assert found["tibi-nav"]["firewall"] == {
        "networks": [],
        "guards": [{"networks": ["192.168.11.0/24"], "interface": "{own}"}],
        "also": ["192.168.2.201/32"],
        "open_ports": ["51820/udp"],
    }
    assert found["tibi-visio"]["firewall"]["open_ports"] == []


@pytest.mark.parametrize("value", ["51820/udp", ["51820"], ["0/udp"], ["70000/tcp"]])
def test_what_is_no_port_is_one_sentence(value):
    def change(data):
        data["variables"]["tibi-nav"]["multimaster_firewall_ports"] = value

    with pytest.raises(fleet_module.InventoryProblems, match="tibi-nav: multimaster_firewall_ports") as found:
        fleet(change)
    assert len(found.value.problems) == 1


def shared(firewall, strangers):
    return make(FleetVariables, {"multimaster_firewall": firewall, "multimaster_strangers": strangers})


def test_a_packet_filter_and_welcome_strangers_contradict():
    found = contradictions.find_excluded_strangers(shared("fleet", "allow"))
    assert len(found) == 1 and mentions(found[0], "multimaster_firewall", "fleet", "multimaster_strangers", "allow")
    for firewall, strangers in (("fleet", "ignore"), ("none", "allow"), (None, None)):
        assert contradictions.find_excluded_strangers(shared(firewall, strangers)) == []


# The tunnel: the same places as in the network that carries it

ANA, BOB, GATE, ARM = "ana-pc", "bob-pc", "dan-gate", "dan-arm"
OVER_WIFI = {
    "multimaster_common_network": "192.168.28.0/24",
    "multimaster_tunnel": "wireguard",
    "multimaster_tunnel_network": "10.77.0.0/24",
    "multimaster_transport": "unicast",
    "multimaster_firewall": "fleet",
}
OF_DAN = {
    "multimaster_network": "192.168.29.0/24",
    "multimaster_gateway": GATE,
    "multimaster_common_address": "192.168.28.24",
    "multimaster_master": GATE,
}
IN_WIFI = {
    ANA: {"multimaster_address": "192.168.28.21"},
    BOB: {"multimaster_address": "192.168.28.22"},
    GATE: {"multimaster_address": "192.168.29.1", **OF_DAN},
    ARM: {"multimaster_address": "192.168.29.2", **OF_DAN},
}
IN_TUNNEL = {"ana": [ANA], "bob": [BOB], "dan": [GATE, ARM]}


def tunnel_fleet(changes=None, **shared):
    values = {host: {**OVER_WIFI, **shared, **own, **(changes or {}).get(host, {})} for host, own in IN_WIFI.items()}
    return fleet_module.read_fleet(fleet_module.Inventory(robots=IN_TUNNEL, variables=values))


def test_each_computer_has_the_same_place_in_both():
    computers = {computer.name: computer for computer in tunnel_fleet().computers}
    assert {name: str(computer.discovery_address) for name, computer in computers.items()} == {
        ANA: "10.77.0.21",
        BOB: "10.77.0.22",
        GATE: "10.77.0.24",
        ARM: "192.168.29.2",
    }
    assert str(tunnel_fleet().variables.common_network) == "10.77.0.0/24"
    ends = {name: str(EndpointVariables.read(computer.variables).endpoint) for name, computer in computers.items()}
    assert ends == {ANA: "192.168.28.21", BOB: "192.168.28.22", GATE: "192.168.28.24", ARM: "None"}
    (peer,) = [
        of for of in Tunnel.find(plan_module.fleet_plan(tunnel_fleet()).computers[ANA]).peers if of.computer == GATE
    ]
    assert list(map(str, peer.networks)) == ["10.77.0.24/32", "192.168.29.0/24"]
    assert str(peer.endpoint) == "192.168.28.24"


def test_a_given_endpoint_counts_and_none_is_none():
    changes = {ANA: {"multimaster_endpoint": "203.0.113.7"}, BOB: {"multimaster_endpoint": "none"}}
    ana, bob, *_others = tunnel_fleet(changes).computers
    assert (
        str(EndpointVariables.read(ana.variables).endpoint) == "203.0.113.7"
        and EndpointVariables.read(bob.variables).endpoint is None
    )
    assert str(bob.address) == "10.77.0.22"


def test_without_a_tunnel_network_the_addresses_are_those_given():
    ana, *_others = tunnel_fleet(
        {ANA: {"multimaster_endpoint": "10.0.0.1"}}, multimaster_tunnel="none", multimaster_tunnel_network=None
    ).computers
    assert str(ana.address) == "192.168.28.21" and str(EndpointVariables.read(ana.variables).endpoint) == "10.0.0.1"


@pytest.mark.parametrize(
    ("shared", "sentence"),
    [
        ({"multimaster_tunnel": "none"}, "multimaster_tunnel_network 10.77.0.0/24 multimaster_tunnel none"),
        ({"multimaster_tunnel_network": "10.77.0.0/16"}, "24 length"),
        ({"multimaster_tunnel_network": "192.168.28.0/24"}, "they overlap"),
        ({"multimaster_tunnel_network": "192.168.29.0/24"}, "multimaster_network dan"),
        ({"multimaster_tunnel_network": "10.77.0.1"}, "IPv4 several"),
        ({"multimaster_router": "192.168.28.1"}, "common network router"),
    ],
)
def test_a_wrong_network_is_one_sentence(shared, sentence):
    with pytest.raises(fleet_module.InventoryProblems) as found:
        tunnel_fleet(**shared)
    assert len(found.value.problems) == 1 and mentions(found.value.problems[0], *sentence.split())
