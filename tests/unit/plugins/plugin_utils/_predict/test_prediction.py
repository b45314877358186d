# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Predictions: against the faults of the simulator, and as a person reads them."""

import pathlib
import re
import time
from dataclasses import replace
from ipaddress import IPv4Interface, IPv4Network
from random import Random

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.fault import INVENTORY
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.foreseen import PREDICTIONS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import Inventory, read_fleet
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network import packets
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import Route, Rule
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.plan_world import make_world
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._predict import prediction
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._predict.remedies import Scene
from mentioned import mentions
from worlds import change, change_interface, fig12, info_of, ping

from tests.simulator import faults, inventories
from tests.simulator.state import healthy

PLAN = fig12()
WORLD = make_world(PLAN)


def infos(world, plan=PLAN):
    return {name: info_of(world.machines[name]) for name in plan.computers}


def predicted(world):
    return prediction.predict(PLAN, infos(world))


def test_a_fleet_that_works_goes_on_to_work():
    found = predicted(WORLD)
    assert found.count() == found.count(now="reaches") == found.count(after="reaches")
    assert not prediction.warnings(found) and not found.assumed
    assert mentions(prediction.write_verdict(found), "PREDICTED", found.count(), "site.yml")


def test_where_every_computer_was_refused_nothing_is_said_to_work():
    found = prediction.predict(PLAN, infos(WORLD), PLAN.computers)
    assert not found.pairs and "would work" not in prediction.render(found)
    assert mentions(prediction.render(found), *(found.refused[:2]))


# A change, where the packets end, and a part of the sentence.
TOLD = {
    "filter": (change(WORLD, "tibi-visio", rules=(Rule("forward", "drop", "tcp"),)), "a packet filter on it drops connections of nodes"),
    "reject": (change(WORLD, "tibi-visio", rules=(Rule("in", "reject", "udp"),)), "a packet filter on it refuses heartbeats"),
    "length": (change(WORLD, "tibi-visio", rules=(Rule("forward", "drop", above=1000),)), "a packet filter on it drops large packets"),
    "masquerading": (change(WORLD, "tibi-visio", rules=(Rule("nat", "masquerade", leaving="eth1"),)), "it translates addresses"),
    "interface": (change_interface(WORLD, "tibi-visio", "eth1", up=False), "the interface of it to the network of dabo"),
}  # fmt: skip


@pytest.mark.parametrize("name", TOLD)
def test_the_first_hop_that_would_fail_is_told_in_one_sentence(name):
    world, text = TOLD[name]
    sentences = prediction.warnings(predicted(world))
    assert any(sentence.startswith("tibi-visio: after site.yml ") and text in sentence for sentence in sentences), (
        sentences
    )
    assert all(
        not re.search(r"{\w", sentence) and sentence.endswith(".") and "; expected " in sentence
        for sentence in sentences
    )


def _add_address(name, device, address):
    machine = WORLD.machines[name]
    own = tuple(
        replace(one, addresses=(*one.addresses, IPv4Interface(address))) if one.name == device else one
        for one in machine.interfaces
    )
    return change(WORLD, name, interfaces=own)


def _add_route(name, destination, kind):
    route = Route(IPv4Network(destination), kind=kind)
    return change(WORLD, name, routes=(route, *WORLD.machines[name].routes))


NETS = "192.168.1.0/24 192.168.10.0/24 192.168.11.0/24"
LETS_PASS = (
    f"for from in {NETS}; do for to in {NETS}; do nft insert rule {{}} ip saddr $from ip daddr $to accept; done; done"
)
# A change, the finding, the place of its remedy, and the remedy: what was read there is in it.
REMEDIES = {
    "filter": (TOLD["filter"][0], "RF-709", "tibi-visio", LETS_PASS.format("ip t0 own_forward")),
    "masquerading": (TOLD["masquerading"][0], "RF-716", "tibi-visio", LETS_PASS.format("ip t0 own_nat")),
    "own interface": (TOLD["interface"][0], "RF-706", "tibi-visio", "ip link set dev eth1 up"),
    "its interface": (change_interface(WORLD, "kobuki", "eth0", up=False), "RF-706", "kobuki", "ip link set dev eth0 up"),
    "blackhole": (_add_route("tibi-nav", "192.168.10.0/25", "blackhole"), "RF-702", "tibi-nav", "ip route del blackhole 192.168.10.0/25"),
    "prohibited": (_add_route("tibi-visio", "192.168.10.100/32", "prohibit"), "RF-702", "tibi-visio", "ip route del prohibit 192.168.10.100/32"),
    "twice": (_add_address("kobuki", "eth0", "192.168.1.201/24"), "RF-715", "", "give eth0 of kobuki another address than 192.168.1.201"),
}  # fmt: skip


@pytest.mark.parametrize("name", REMEDIES)
def test_the_remedy_has_the_values_that_were_read(name):
    world, identity, where, text = REMEDIES[name]
    ends = [end for end in predicted(world).failures if end.fault.id == identity]
    assert [(one.where, one.text) for end in ends for one in prediction.list_do(end) if one.text.startswith(text)] == [
        (where, ends[0].remedy[0].text)
    ]
    assert "<" not in prediction.render(predicted(world))


def test_of_a_machine_that_was_not_looked_at_no_interface_is_named():
    world = change_interface(WORLD, "kobuki", "eth0", up=False)
    scene = Scene(PLAN, world, ())
    way = packets.trace(world, "tibi-visio", ping("192.168.1.229"))
    assert way.outcome == packets.DOWN and scene.advise(way, way.outcome, way.where) == ()
    assert scene._replace(known=("kobuki",)).advise(way, way.outcome, way.where)


def test_an_address_that_nobody_has_is_that_of_a_computer_with_another_one():
    machine = WORLD.machines["dabo-visio"]
    moved = tuple(
        replace(one, addresses=(IPv4Interface("192.168.10.77/24"),)) if one.name == "eth0" else one
        for one in machine.interfaces
    )
    (end, *_more) = predicted(change(WORLD, "dabo-visio", interfaces=moved)).failures
    change_of_inventory, run = prediction.list_do(end, "hosts.yml")
    assert end.fault.id == "RF-704" and change_of_inventory.where == INVENTORY
    assert mentions(change_of_inventory.text, "multimaster_address", "dabo-visio", "192.168.10.77")
    assert run.text == "ansible-playbook -i hosts.yml rosfleet.multimaster.site"


def test_what_ends_at_one_place_is_one_sentence():
    everything = change(WORLD, "tibi-visio", rules=(Rule("forward", "drop"),))
    (sentence,) = prediction.warnings(predicted(everything))
    assert mentions(sentence, "tibi-nav", "dabo-nav")
    assert " and 2 more would not work" in sentence


def test_what_a_filter_would_drop_is_unsure_where_it_says_more():
    world = change(WORLD, "kobuki", rules=(Rule("in", "drop", "icmp"),))
    read = infos(world)
    read["kobuki"]["filters"]["chains"][0]["unread"] = 1
    found = prediction.predict(PLAN, read)
    assert found.count(after="fails") == 0 and found.count(after="unsure", traffic="ping") > 0
    assert list(found.unclear) == ["kobuki"] and "The packet filter says more" in prediction.render(found)


def test_the_table_shows_now_and_after():
    world = change_interface(WORLD, "tibi-visio", "eth1", forwarding=False)
    world = change_interface(world, "tibi-visio", "eth0", forwarding=False)
    world = change(world, "dabo-nav", rules=(Rule("in", "drop", "icmp"),))
    read = {name: info for name, info in infos(world).items() if name != "kobuki"}
    text = prediction.render(prediction.predict(PLAN, read))
    for line in (
        "PREDICTION for 5 computers, after site.yml",
        "  ping                         20        8       12        4        -        -",
        "   1  tibi-nav       -    ok  part  ok +  ok +",
        "  1. a packet filter on dabo-nav drops ping [RF-709]",
        "     look:   on dabo-nav: nft -a list ruleset",
        "Not looked at, and taken as planned: kobuki.",
    ):
        assert line in text.splitlines() or line in text, text
    assert max(map(len, text.splitlines())) <= 120
    entry = next(one for one in prediction.list_ways(prediction.predict(PLAN, read)) if one["after"] == "fails")
    assert entry["where"] == "dabo-nav" and entry["why"] == "a packet filter on dabo-nav drops ping"


def test_every_end_has_a_sentence():
    ends = {value for name, value in vars(packets).items() if name.isupper() and isinstance(value, str)}
    assert {outcome for _predicted, outcome in PREDICTIONS} == ends - {
        packets.DELIVERED,
        "accept",
        "drop",
        "reject",
        "in",
        "out",
        "forward",
        "nat",
        "masquerade",
    } | {prediction.TRANSLATED}


# The faults of the simulator that are in what multimaster_info reads: the others are in no machine, or in its programs.
READ = (
    "another address", "another prefix length", "small MTU", "interface down", "no route", "another route",
    "two default routes", "forwarding off", "strict reverse path", "filter of what is forwarded", "masquerading",
    "filter of ICMP", "filter of UDP", "filter of UDP out", "filter of nodes", "filter of nodes out",
)  # fmt: skip


@pytest.mark.slow
def test_the_prediction_of_now_is_what_packets_do():
    """In at least 98 % of the pairs of random fleets with a fault: here they are all right."""
    wrong, total = [], 0
    for number in range(4 * len(READ)):
        random = Random(number)
        plan = inventories.plan(random)
        made = faults.BY_NAME[READ[number % len(READ)]].inject(healthy(random, plan), random)
        if made is None:
            continue
        world = made[0].world
        owned = {name: ("files-firewall",) if entry.firewall else () for name, entry in plan.computers.items()}
        read = {name: _read(plan, world, name, owned[name]) for name in plan.computers}
        for pair in prediction.predict(plan, read).pairs:
            if pair.traffic == "ping":
                total += 1
                address = next(member.address for member in plan.members if member.name == pair.target)
                way = packets.echo(world, pair.observer, ping(address))
                good = way.ok and way.there.where == pair.target
                if (pair.now == "reaches") != good:
                    wrong.append((number, pair))
    assert total > 500 and len(wrong) <= 0.02 * total, wrong[:5]
    assert not wrong, wrong[:5]


def _read(plan, world, name, owned):
    machine = world.machines[name]
    own = make_world(plan).machines[name].rules
    return info_of(replace(machine, rules=tuple(rule for rule in machine.rules if rule not in own)), owned)


def test_a_large_fleet_takes_seconds():
    robots = {f"r{number}": [f"r{number}-a", f"r{number}-b"] for number in range(40)}
    values = {
        host: {
            "multimaster_common_network": "10.0.0.0/16",
            "multimaster_network": f"10.{1 + number}.0.0/24",
            "multimaster_gateway": f"r{number}-a",
            "multimaster_common_address": f"10.0.0.{1 + number}",
            "multimaster_master": f"r{number}-b",
            "multimaster_address": f"10.{1 + number}.0.{1 + place}",
        }
        for number, hosts in enumerate(robots.values())
        for place, host in enumerate(hosts)
    }
    plan = fleet_plan(read_fleet(Inventory(robots=robots, variables=values)))
    began = time.process_time()
    found = prediction.predict(plan, infos(make_world(plan), plan))
    assert {pair.observer for pair in found.pairs} == {pair.target for pair in found.pairs} == set(plan.computers)
    assert found.count(after="reaches") == len(found.pairs) < 80 * 79 * 4
    assert time.process_time() - began < 5


DECLARED = fig12(
    {"dabo": {"multimaster_exports": [{"topics": ["/scan"], "as": "/dabo", "to": ["tibi"]}]}},
    multimaster_clock="tibi-nav",
)
PORTS = {11911: "topics by the relay", 123: "the time"}


@pytest.mark.parametrize("port", PORTS)
def test_a_port_that_only_some_need_is_tried_between_them(port):
    world = make_world(DECLARED)
    well = prediction.predict(DECLARED, infos(world, DECLARED))
    assert well.count(after="reaches") == len(well.pairs)
    closed = change(
        world, "tibi-visio", rules=(Rule("forward", "drop", ports=(port, port)), Rule("in", "drop", ports=(port, port)))
    )
    found = prediction.predict(DECLARED, infos(closed, DECLARED))
    assert {pair.traffic for pair in found.pairs if pair.after == "fails"} == {PORTS[port]}
    assert f"a packet filter on it drops {PORTS[port]}" in prediction.warnings(found)[0]
    assert f"  {PORTS[port]:<22}" in prediction.render(found)


def test_undeclared_relays_and_sources_are_not_asked_for():
    assert {pair.traffic for pair in predicted(WORLD).pairs} == {traffic.name for traffic in prediction.TRAFFIC}
    assert not any(name in prediction.render(predicted(WORLD)) for name in PORTS.values())


def test_the_module_names_each_kind_of_packets():
    module = pathlib.Path(__file__).resolve().parents[5] / "plugins/modules/fleet_predict.py"
    said = re.search(r"traffic:\n +description: (.+)\n", module.read_text(encoding="utf-8"))
    assert said and re.findall(r"V\(([^)]+)\)", said[1]) == [
        row.name for row in (*prediction.TRAFFIC, *prediction.list_declared())
    ]
