# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Machines in, an inventory out: the plan of the fleet that somebody has set up by hand."""

import random

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._adopt import facts
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._adopt.infer import propose
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import (
    Inventory,
    InventoryProblems,
    read_fleet,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan
from mentioned import mentions
from shown import FOLDER, machine, machines_of, read_folder, roscore

from tests.simulator import inventories


def adopted(infos, left_out=None):
    return propose([facts.read_machine(name, info) for name, info in infos.items()], left_out or {})


def plan_of(inventory):
    return fleet_plan(read_fleet(inventory))


@pytest.mark.parametrize("layout", ["single_computer", "multi_computer"])
def test_the_shipped_inventories_come_back_without_a_guess(layout):
    plan = plan_of(read_folder(FOLDER / layout))
    proposal = adopted(machines_of(plan))
    assert plan_of(proposal.inventory()) == plan
    assert not proposal.left_out
    assert not [text for text in proposal.guesses() if "guessed" in text]


# What machines do not show, or what is no choice of a person who works by hand.
UNSEEN = """
transport multicast_routing firewall answer_broadcast_pings strangers allow heartbeat_hz router filters exports provider
roscore aliases firewall_also firewall_ports
""".split()


def visible(inventory):
    """The inventory without the variables that no machine shows; gateways are computers."""
    variables = {}
    for host, own in inventory.variables.items():
        kept = {name: value for name, value in own.items() if name.removeprefix("multimaster_") not in UNSEEN}
        if kept.get("multimaster_routes") == "existing":
            del kept["multimaster_routes"]
        if kept.get("multimaster_gateway", "").endswith(".1"):
            (robot,) = [hosts for hosts in inventory.robots.values() if host in hosts]
            kept["multimaster_gateway"] = robot[-1]
        variables[host] = kept
    return Inventory(robots=dict(sorted(inventory.robots.items())), variables=variables, routers=inventory.routers)


def random_plans(seed, number):
    randomly = random.Random(seed)
    while number:
        try:
            plan = plan_of(visible(inventories.inventory(randomly)))
        except InventoryProblems:
            continue
        number -= 1
        yield plan


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_random_fleets_come_back(seed):
    for plan in random_plans(seed, 20):
        proposal = adopted(machines_of(plan))
        assert plan_of(proposal.inventory()) == plan


# What people have beside the report's layouts


def robot(number, name, master="gate", inner=("arm",), **gate):
    """Infos of a robot behind a gateway: its network is 192.168.(10 + number).0/24, its gateway .1 there."""
    network, uri = f"192.168.{10 + number}", f"http://{name}-{master}:11311"
    infos = {
        f"{name}-{place}": machine(
            f"{name}-{place}", f"{network}.{2 + count}/24", routes=[("0.0.0.0/0", f"{network}.1")], uri=uri
        )
        for count, place in enumerate(inner)
    }
    infos[f"{name}-gate"] = machine(
        f"{name}-gate", f"{network}.1/24", f"192.168.1.{200 + number}/24", forwards=1, uri=uri, **gate
    )
    address = f"192.168.1.{200 + number}" if master == "gate" else f"{network}.2"
    infos[f"{name}-{master}"]["masters"] = [roscore(f"{name}-{master}", address)]
    return infos


def fleet(**more):
    return {**robot(0, "ana"), **robot(1, "bob", "arm"), **more}


def choice(proposal, name, variable):
    robots = {robot.name: robot for robot in proposal.robots}
    return robots[name].choices[variable]


def valid(proposal):
    plan_of(proposal.inventory())
    return {robot.name: [computer.name for computer in robot.computers] for robot in proposal.robots}


ROBOTS = {"ana": ["ana-gate", "ana-arm"], "bob": ["bob-gate", "bob-arm"]}


def test_of_several_addresses_the_one_sent_from_counts():
    """A second address of an interface, or a wifi beside the wire: others know the machine by the one it sends from."""
    infos = {
        "ana": machine("ana", "192.168.1.10/24", "192.168.1.9/24", masters=[roscore("ana")]),
        "bob": machine("bob", "192.168.1.11/24", "192.168.1.12/24", masters=[roscore("bob")]),
    }
    for metric, source in ((600, "192.168.1.9"), (100, "192.168.1.10")):
        route = {"destination": "192.168.1.0/24", "gateway": "", "metric": metric, "source": source}
        infos["ana"]["routing"]["routes"].append(route)
    variables = adopted(infos).inventory().variables
    assert [variables[name]["multimaster_address"] for name in ("ana", "bob")] == ["192.168.1.10", "192.168.1.11"]


def test_a_network_for_administration_is_no_common_network():
    infos = fleet(laptop=machine("laptop", "10.0.0.9/24"))
    for number, info in enumerate(infos.values()):
        info["interfaces"] += machine("", f"10.0.0.{100 + number}/24")["interfaces"]
    proposal = adopted(infos)
    assert valid(proposal) == ROBOTS
    assert str(proposal.choices["common_network"].value) == "192.168.1.0/24"
    assert mentions(proposal.notes, "10.0.0.0/24", "connects")
    assert list(proposal.left_out) == ["laptop"]


def test_a_roscore_in_a_container_stays():
    process = {"unit": "docker-0badcafe.scope", "command": "rosmaster", "pid": 9, "user": "root", "container": True}
    boxed = machine("cid", "192.168.1.50/24", masters=[roscore("cid", process=process)])
    proposal = adopted(fleet(cid=boxed))
    choices = {robot.name: robot.choices.get("roscore") for robot in proposal.robots}
    assert choices["robot_cid"].value == "existing" and "container" in choices["robot_cid"].why
    assert choices["ana"] is choices["bob"] is None
    (note,) = [text for robot in proposal.robots for text in robot.notes if "docker-0badcafe.scope" in text]
    assert "it stays" in note and "end it" not in note
    assert valid(proposal) == {**ROBOTS, "robot_cid": ["cid"]}


def test_a_tunnel_that_is_there_stays_and_carries_no_multicast():
    infos = {
        name: machine(
            name, f"192.168.1.{number}/24", f"10.8.0.{number}/24", masters=[roscore(name, f"10.8.0.{number}")]
        )
        for number, name in enumerate(("one", "two"), 11)
    }
    for info in infos.values():  # at home in different networks
        info["interfaces"][0]["addresses"][0]["address"] = f"192.168.{len(info['hostname'])}.7"
        info["interfaces"][1].update(name="wg0", multicast=False, point_to_point=True)
    infos["two"]["interfaces"][0]["addresses"][0]["address"] = "192.168.9.7"
    plan = plan_of(adopted(infos).inventory())
    assert (str(plan.common_network), plan.transport) == ("10.8.0.0/24", "unicast")
    (why,) = [text for text in adopted(infos).guesses() if "multicast" in text]
    assert "wg0 of one" in why and "stays as it is" in why


def single(device, names, **link):
    """Infos of robots with one address in no network, as Tailscale and batman-adv give it, by their names."""
    infos = {name: machine(name, f"{one}/32", masters=[roscore(name, one)]) for name, one in names.items()}
    for info in infos.values():
        info["interfaces"][0].update({"name": device, "multicast": True, "point_to_point": True, **link})
    return infos


@pytest.mark.parametrize(
    ("device", "addresses", "network"),
    [
        ("tailscale0", ("100.64.3.7", "100.101.2.2"), "100.64.0.0/10"),
        ("bat0", ("10.7.3.7", "10.7.3.200"), "10.7.3.0/24"),
        ("wg0", ("10.7.3.1", "10.7.3.2"), "10.7.3.0/30"),
        ("wg0", ("10.7.3.9", "10.7.3.14"), "10.7.3.8/29"),
        ("wg0", ("10.7.3.12", "10.7.3.15"), "10.7.3.0/27"),  # .15 is the broadcast address of the smaller ones
        ("wg0", ("10.7.3.16", "10.7.3.19"), "10.7.3.0/27"),
    ],
)
def test_single_addresses_are_kept_and_discovered_without_multicast(device, addresses, network):
    infos = single(device, dict(zip(("ana", "bob"), addresses, strict=True)))
    for number, info in enumerate(infos.values()):  # at home in different networks
        info["interfaces"] += machine("", f"192.168.{number}.7/24")["interfaces"]
    proposal = adopted(infos)
    assert valid(proposal) == {"robot_ana": ["ana"], "robot_bob": ["bob"]} and not proposal.left_out
    plan = plan_of(proposal.inventory())
    assert (str(plan.common_network), plan.transport) == (network, "unicast")
    assert [str(entry.address) for entry in plan.hosts_entries] == list(addresses)
    assert mentions(proposal.choices["common_network"].why, "/32", device)


def test_a_single_address_belongs_to_the_network_of_its_server():
    infos = single("wg0", {"ana": "10.8.0.2", "bob": "10.8.0.3"}, multicast=False)
    infos["cid"] = machine("cid", "10.8.0.1/24", masters=[roscore("cid", "10.8.0.1")])
    plan = plan_of(adopted(infos).inventory())
    assert (str(plan.common_network), plan.transport) == ("10.8.0.0/24", "unicast")


@pytest.mark.parametrize(
    ("device", "one", "why"),
    [
        ("eth0", "192.168.1.100", "beside an address"),  # of keepalived
        ("ppp0", "10.64.64.64", "provider"),
        ("eth1", "203.0.114.5", "public"),
        ("kube-ipvs0", "10.96.0.1", "inside the computer"),
        ("bat0", "10.7.3.7", "in no network"),  # nobody else has one
    ],
)
def test_single_addresses_by_which_no_robot_is_reached_are_left_aside(device, one, why):
    infos = {
        name: machine(name, f"192.168.1.{number}/24", masters=[roscore(name)])
        for number, name in enumerate(("ana", "bob"), 110)
    }
    infos["ana"]["interfaces"] += single(device, {"": one})[""]["interfaces"]
    proposal = adopted(infos)
    assert valid(proposal) == {"robot_ana": ["ana"], "robot_bob": ["bob"]}
    assert "transport" not in proposal.choices and str(plan_of(proposal.inventory()).common_network) == "192.168.1.0/24"
    assert mentions([text for text in proposal.guesses() if "Left aside" in text], one, why)


def test_roscores_that_share_no_network_are_told_so():
    infos = {n: machine(n, f"192.168.{i}.5/24", masters=[roscore(n)]) for i, n in enumerate(("ana", "bob"))}
    assert mentions(adopted(infos).choices["common_network"].why, "share", "192.168.1.0/24")
    alone = adopted(single("tailscale0", {"ana": "100.64.3.7"})).left_out
    assert "network" in alone["ana"] and "no roscore" not in alone["ana"]


def test_a_uri_that_no_machine_has_is_named():
    laptop = machine("laptop", "192.168.1.9/24", uri="http://robot_9:11311")
    assert mentions(adopted({"laptop": laptop}).left_out["laptop"], "ROS_MASTER_URI", "robot_9")


def test_names_with_underscores_are_kept_as_aliases():
    infos = {
        "robot_2_nuc": machine("robot_2_nuc", "192.168.1.5/24", masters=[roscore("robot_2_nuc", "192.168.1.5")]),
        "192.168.1.6": machine("robot_2_arm", "192.168.1.6/24", uri="http://robot_2_nuc:11311"),
        "192.168.1.7": machine("cid", "192.168.1.7/24", masters=[roscore("cid", "192.168.1.7")]),
    }
    proposal = adopted(infos)
    assert valid(proposal) == {"robot_2": ["robot-2-nuc", "robot-2-arm"], "robot_cid": ["cid"]}
    plan = plan_of(proposal.inventory())
    assert plan.hosts_entries[0].names == ("robot-2-nuc", "robot_2_nuc")
    assert "http://robot_2_nuc:11311/" in plan.belonging.robots[0].uris
    assert mentions(proposal.guesses(), "underscores", "robot_2_nuc")


def test_whom_the_others_follow_in_time_is_the_source():
    infos = fleet()
    for name in ("ana-gate", "ana-arm", "bob-gate"):  # bob-arm follows somebody outside
        infos[name]["clock"] = {"sources": [{"address": "192.168.11.2", "selected": True}]}
    infos["bob-arm"]["clock"] = {"sources": [{"address": "192.0.2.1", "selected": True}]}
    proposal = adopted(infos)
    assert proposal.choices["clock"].value == "bob-arm" and "3 of 4" in proposal.choices["clock"].why
    assert "clock" not in adopted(fleet()).choices and valid(proposal) == ROBOTS


def test_a_sensor_network_in_each_robot_is_inside_it():
    infos = fleet(cid=machine("cid", "192.168.1.50/24", masters=[roscore("cid", "192.168.1.50")]))
    for info in infos.values():
        info["interfaces"] += machine("", "192.168.2.1/24")["interfaces"]
    proposal = adopted(infos)
    assert valid(proposal) == {**ROBOTS, "robot_cid": ["cid"]}
    assert any("192.168.2.0/24 machines have the same address" in note for note in proposal.notes)


def test_a_gateway_of_another_make_is_an_address():
    infos = fleet()
    del infos["bob-gate"]
    infos["ana-gate"]["routing"]["routes"] += [
        {"destination": "192.168.11.0/24", "gateway": "192.168.1.211", "metric": 0},
        {"destination": "0.0.0.0/0", "gateway": "192.168.1.254", "metric": 0},
    ]
    proposal = adopted(infos)
    assert valid(proposal) == {"ana": ROBOTS["ana"], "bob": ["bob-arm"]}
    assert str(choice(proposal, "bob", "gateway").value) == "192.168.11.1"
    assert str(choice(proposal, "bob", "common_address").value) == "192.168.1.211"
    assert str(proposal.choices["router"].value) == "192.168.1.254"
    assert "guessed" in choice(proposal, "bob", "gateway").why and "guessed" in proposal.choices["router"].why


def test_what_is_not_found_is_asked_for():
    infos = fleet()
    del infos["bob-gate"]
    proposal = adopted(infos)
    with pytest.raises(InventoryProblems, match="multimaster_common_address.*bob"):
        plan_of(proposal.inventory())
    assert any(text.startswith("multimaster_common_address, the address") for text in proposal.guesses())


def test_default_routes_that_lead_elsewhere_stay():
    infos = fleet()
    infos["ana-arm"]["routing"]["routes"] = [
        {"destination": "0.0.0.0/0", "gateway": "192.168.10.99", "metric": 0},
        {"destination": "192.168.1.0/24", "gateway": "192.168.10.1", "metric": 0},
    ]
    proposal = adopted(infos)
    assert choice(proposal, "ana", "routes").value == "networks"
    assert choice(proposal, "ana", "gateway").value == "ana-gate"
    assert valid(proposal) == ROBOTS


def test_the_roscore_that_most_nodes_name_counts():
    infos = fleet()
    infos["ana-arm"]["masters"] = [roscore("ana-arm", "192.168.10.2")]
    proposal = adopted(infos)
    assert choice(proposal, "ana", "master").value == "ana-gate"
    assert any("On ana-arm runs a roscore, too" in text for text in proposal.guesses())
    assert valid(proposal) == ROBOTS


@pytest.mark.parametrize(("make", "name"), [("upstream", "multimaster_fkie"), ("fkie_mas", "fkie_mas")])
def test_nodes_that_can_be_kept_are_told_by_their_name(make, name):
    there = roscore("robot", "192.168.1.7", implementation=make)
    notes = " ".join(
        propose([facts.read_machine("robot", machine("robot", "192.168.1.7/24", masters=[there]))], {}).robots[0].notes
    )
    assert f"The nodes of {name} run there" in notes
    assert mentions(notes, "multimaster_provider", "fkie_existing", "multimaster_ros_setup", name)


def test_a_roscore_that_does_not_run_is_a_guess():
    infos = fleet()
    infos["bob-arm"]["masters"] = []
    proposal = adopted(infos)
    assert choice(proposal, "bob", "master").value == "bob-arm"
    assert choice(proposal, "bob", "master").why.startswith("guessed from ROS_MASTER_URI")
    assert valid(proposal) == ROBOTS


def test_of_ports_that_are_named_as_often_the_lowest_counts():
    infos = fleet()
    infos["bob-arm"]["masters"] = []
    places = {"bob-arm": 11399, "bob-gate": 11312}
    for name, port in places.items():
        if name in infos:
            infos[name]["environment"]["login"]["ROS_MASTER_URI"] = f"http://bob-arm:{port}"
    assert choice(adopted(infos), "bob", "roscore_port").value == 11312


def test_the_master_uri_that_ros_is_delivered_with_says_nothing():
    infos = fleet(laptop=machine("laptop", "192.168.1.9/24", uri="http://localhost:11311"))
    infos["ana-arm"]["environment"]["login"]["ROS_MASTER_URI"] = "http://localhost:11311"
    proposal = adopted(infos)
    assert valid(proposal) == ROBOTS and list(proposal.left_out) == ["laptop"]
    assert not [text for text in proposal.guesses() if "ROS_MASTER_URI" in text]


def test_a_second_computer_belongs_to_the_roscore_that_it_names():
    infos = {
        "ana-nav": machine("ana-nav", "192.168.1.10/24", masters=[roscore("ana-nav", "192.168.1.10")]),
        "ana-arm": machine("ana-arm", "192.168.1.11/24", uri="http://192.168.1.10:11311"),
        "bob": machine("bob", "192.168.1.20/24", masters=[roscore("bob", "192.168.1.20")]),
    }
    infos["ana-arm"]["masters"] = [roscore("ana-arm")]  # a roscore that nobody discovers
    assert valid(adopted(infos)) == {"ana": ["ana-nav", "ana-arm"], "robot_bob": ["bob"]}


def test_addresses_in_the_list_become_host_names():
    infos = {
        "192.168.1.10": machine("Ana", "192.168.1.10/24", masters=[roscore("Ana", "192.168.1.10")]),
        "192.168.1.20": machine("ubuntu", "192.168.1.20/24", masters=[roscore("ubuntu", "192.168.1.20")]),
        "192.168.1.30": machine("ubuntu", "192.168.1.30/24"),
        "fourth": machine("cid", "192.168.1.40/24", masters=[roscore("cid", "192.168.1.40", port=11321, rpc=12000)]),
        "again": machine("cid", "192.168.1.40/24"),
    }
    proposal = adopted(infos, {"husky": "it cannot be reached"})
    assert valid(proposal) == {
        "robot_ana": ["Ana"],
        "host_192_168_1_20": ["host-192-168-1-20"],
        "robot_fourth": ["fourth"],
    }
    assert set(proposal.left_out) == {"husky", "192.168.1.30", "again"}
    assert proposal.left_out["again"] == "it is the same machine as fourth"
    fourth = next(computer for computer in proposal.computers if computer.name == "fourth")
    assert fourth.choices["aliases"].value == ["cid"]
    assert choice(proposal, "robot_fourth", "roscore_port").value == 11321
    assert choice(proposal, "robot_fourth", "rpc_port").value == 12000


def test_no_two_machines_or_robots_have_one_name():
    ends = {"robot_1": 10, "Robot_1": 20, "host-robot-1-2": 30, "ana": 40, "robot-ana": 50}
    infos = {
        name: machine("ubuntu", f"192.168.1.{end}/24", masters=[roscore("ubuntu", f"192.168.1.{end}")])
        for name, end in ends.items()
    }
    robots = valid(adopted(infos))
    assert sum(robots.values(), []) == [
        "host-robot-1",
        "host-robot-1-2",
        "robot-ana",
        "robot-1",
        "ana",
    ]
    assert len(robots) == 5


def test_names_of_programs_as_addresses_are_seen():
    infos = {
        name: machine(name, f"192.168.1.{number}/24", masters=[roscore(f"192.168.1.{number}", f"192.168.1.{number}")])
        for number, name in enumerate(("ana", "bob"), 10)
    }
    proposal = adopted(infos)
    assert proposal.choices["advertise"].value == "address"
    assert plan_of(proposal.inventory()).masters[0].uri == "http://192.168.1.10:11311/"


@pytest.mark.parametrize("infos", [{}, {"laptop": machine("laptop", "192.168.1.9/24")}, {"bare": machine("bare")}])
def test_without_a_robot_there_is_nothing_to_propose(infos):
    proposal = adopted(infos)
    assert not proposal.robots and set(proposal.left_out) == set(infos)


def test_a_hundred_machines_are_read_in_a_moment():
    infos = {}
    for number in range(25):
        infos.update(robot(number, f"r{number}", inner=("arm", "head", "base")))
    assert len(valid(adopted(infos))) == 25
