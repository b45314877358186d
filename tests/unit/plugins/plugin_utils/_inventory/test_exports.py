# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Declared data flow: how it is read, what contradicts itself, and what both sides' nodes make of it."""

import dataclasses
import fnmatch
import json

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.sentences import UnexpectedValue
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import contradictions
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import exports as exports_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import flows as flows_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import read as fleet_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.model import (
    Computer,
    Fleet,
    Inventory,
    Robot,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.variables import (
    ComputerVariables,
    FleetVariables,
    RobotVariables,
    make,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import plan as plan_module
from hypothesis import given, settings
from hypothesis import strategies as st
from mentioned import mentions
from rosfleet_multimaster.protocol import filters, graph, parameters
from rosfleet_multimaster.protocol.wire_filters import read_rules, write_rules
from rosfleet_multimaster.relay.core.channels import SERVICE, TOPIC, Channel

VERIFY = "/multimaster_verify/*"

# Tibi's master is its gateway, dabo's is behind its gateway, car is one computer on the common network.
HOSTS = {
    "tibi-visio": ("tibi", "192.168.11.101"),
    "dabo-visio": ("dabo", "192.168.10.101"),
    "dabo-nav": ("dabo", "192.168.10.100"),
    "car": ("car", "192.168.1.203"),
}
OF_ROBOT = {
    "tibi": {
        "multimaster_network": "192.168.11.0/24",
        "multimaster_gateway": "tibi-visio",
        "multimaster_common_address": "192.168.1.201",
    },
    "dabo": {
        "multimaster_network": "192.168.10.0/24",
        "multimaster_gateway": "dabo-visio",
        "multimaster_common_address": "192.168.1.202",
        "multimaster_master": "dabo-nav",
    },
    "car": {},
}
MASTER = {"tibi": "tibi-visio", "dabo": "dabo-nav", "car": "car"}
ADDRESS = {"tibi": "192.168.1.201", "dabo": "192.168.10.100", "car": "192.168.1.203"}  # as the others see the caller


def fleet(shared=None, **of_robot):
    """Three robots; `tibi={"exports": [...]}` sets multimaster_exports of its computers."""
    robots = {}
    variables = {}
    for host, (robot, address) in HOSTS.items():
        robots.setdefault(robot, []).append(host)
        variables[host] = {
            "multimaster_address": address,
            "multimaster_common_network": "192.168.1.0/24",
            **OF_ROBOT[robot],
            **(shared or {}),
            **{f"multimaster_{name}": value for name, value in of_robot.get(robot, {}).items()},
        }
    return fleet_module.read_fleet(fleet_module.Inventory(robots=robots, variables=variables))


def problems(shared=None, **of_robot):
    with pytest.raises(fleet_module.InventoryProblems) as caught:
        fleet(shared, **of_robot)
    return caught.value.problems


def exports(*entries, **filters_of_robot):
    return {"exports": list(entries), **({"filters": filters_of_robot} if filters_of_robot else {})}


def filters_of(parameters):
    """The parameters of master_sync without who belongs to the fleet, and without the topic that stays on each robot."""
    found = {name: value for name, value in parameters.items() if name not in ("strangers", "allow")}
    *topics, last = found.pop("ignore_topics")
    assert last == "/diagnostics"
    return {**found, "ignore_topics": topics} if topics else found


def both_sides(model):
    """(exports, hide_subscribers) of master_discovery and the filters of master_sync, by robot."""
    computers = to_plain(plan_module.fleet_plan(model))["computers"]
    return {
        robot: (
            computers[master]["discovery"].get("exports"),
            computers[master]["discovery"]["hide_subscribers"],
            filters_of(computers[master]["sync"]),
        )
        for robot, master in MASTER.items()
    }


# Reading


def test_a_declaration_is_read():
    (entry,) = exports_module.read_exports(
        [{"topics": ["/tibi/pose", "/tibi/scan*"], "actions": ["/dock"], "to": ["dabo"]}]
    )
    assert entry == exports_module.Export(topics=("/tibi/pose", "/tibi/scan*"), actions=("/dock",), to=("dabo",))
    assert mentions(str(entry), "/tibi/pose", "/tibi/scan*", "/dock", "dabo")
    assert exports_module.read_exports([]) == ()


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("/pose", "entries list"),
        ({"topics": ["/pose"]}, "entries list"),
        (["/pose"], "entries list"),
        ([{"topic": ["/pose"]}], "topic topics"),
        ([{"topics": "/pose"}], "topics /tibi/pose"),
        ([{"topics": [7]}], "topics"),
        ([{"topics": None}], "topics"),
        ([{"parameters": ["/robot_*"]}], "_ / parameters"),
        ([{"parameters": ["/"]}], "letters whole"),
        ([{"parameters": ["robot_description"]}], "robot_description parameters"),
        ([{"parameters": ["/" + "a" * 255]}], "letters whole"),
        ([{"parameters": ["/run_id"]}], "/run_id roscore"),
        ([{"parameters": ["/roslaunch/uris"]}], "/roslaunch/uris roscore"),
        ([{"parameters": ["/a", "/b/c"]}, {"parameters": ["/b"]}], "/b/c /b"),
        ([{"parameters": [f"/a{n}" for n in range(101)]}], "100 101"),
        ([{"topics": ["/pose"], "to": "dabo"}], "to dabo"),
        ([{"topics": ["/pose"], "to": []}], "to robot"),
        ([{}], "actions services"),
        ([{"to": ["dabo"]}], "actions services"),
        ([{"topics": []}], "actions services"),
        ([{"topics": ["pose"]}], "topics pose"),
        ([{"topics": ["~pose"]}], "topics ~pose"),
        ([{"topics": ["/pose.*"]}], "topics /pose.*"),
        ([{"services": ["/a|/b"]}], "services /a|/b"),
        ([{"topics": ["/pose\n"]}], "topics"),
        ([{"actions": ["/dock/"]}], "actions empty"),
        ([{"topics": ["//pose"]}], "topics empty"),
        ([{"topics": ["/*a*b*"]}], "2 *"),
        ([{"topics": [f"/{n}*" for n in range(501)]}], "500 1 *"),
        ([{"actions": [f"/*{n}*" for n in range(14)]}], "42"),
        ([{"topics": ["/" + "a" * 40000]}], "32768 characters"),
        ([{"topics": [f"/{n:03x}" for n in range(4096)] * 2}], "sync_topics 65536"),
        ([{"topics": ["/scan"], "as": "kobuki1"}], "/kobuki1 as kobuki1"),
        ([{"topics": ["/scan"], "as": "/"}], "/kobuki1 as"),
        ([{"topics": ["/scan", "/odom"], "as": {"/scan": "/front"}}], "/odom"),
        ([{"topics": ["/scan"], "as": {"/scan": "/front", "/odom": "/b"}}], "/odom"),
        ([{"topics": ["/scan"], "as": {"/scn": "/front"}}], "/scn mean /scan?"),
        ([{"topics": ["/*"], "as": {"/*": "/front"}}], "* /scan /front/scan /*"),
        ([{"topics": ["/scan"], "as": {"/scan": "front"}}], "as front"),
        ([{"topics": ["/scan"], "as": {}}], "/scan"),
        ([{"parameters": ["/a"], "as": {"/a": "/b"}}], "action topic"),
        ([{"topics": ["/scan"], "as": None}], "/kobuki1 as"),
        ([{"topics": ["/scan"], "rate": 0}], "0 1000 rate"),
        ([{"topics": ["/scan"], "rate": True}], "rate True"),
        ([{"topics": ["/scan"], "rate": 1e9}], "at 'rate'"),
        ([{"topics": ["/scan"], "whole": ["a/B"]}], "whole rate"),
        ([{"topics": ["/scan"], "rate": 5, "whole": "a/B"}], "100 whole"),
        ([{"topics": ["/scan"], "rate": 5, "whole": ["a/b/C"]}], "my_msgs/Status my_msgs/* a/b/C"),
        ([{"topics": ["/scan"], "newest": 1}], "newest 1"),
        ([{"services": ["/reset"], "rate": 5}], "rate newest frames"),
        ([{"parameters": ["/a"], "rate": 1}], "own entry"),
        ([{"services": ["/a"], "as": "/b", "frames": "b/"}], "own entry"),
        ([{"topics": ["/tf"], "frames": "kobuki1"}], "/ _ robot1/ frames"),
        ([{"topics": ["/tf"], "frames": "a//"}], "frames a//"),
        ([{"topics": ["/tf"], "frames": None}], "frames None"),
        ([{"parameters": ["/a"], "as": "/rosdistro"}], "/rosdistro/a roscore"),
        ([{"parameters": ["/run_id"], "as": "/b"}], "/run_id roscore"),
        ([{"parameters": ["/b/a"]}, {"parameters": ["/a"], "as": "/b"}, {"parameters": ["/b"]}], "/b/a is in /b"),
        ([{"parameters": ["/b/a"], "to": ["x"]}, {"parameters": ["/a"], "as": "/b"}], "/b/a receivers"),
        ([{"topics": ["/diagnostics"], "rate": 1}], "/diagnostics as"),
        ([{"services": ["/a"], "as": "/b", "rate": 1}], "rate actions"),
        ([{"topics": ["/scan"], "newst": True}], "newst newest"),
        ([{"topics": ["/a", "/b"]}, {"topics": ["/b", "/a"]}], "/b /a"),
    ],
)
def test_a_wrong_declaration_is_one_sentence(value, expected):
    with pytest.raises(UnexpectedValue) as caught:
        exports_module.read_exports(value)
    assert mentions(str(caught.value), *expected.split())


@given(
    st.lists(
        st.dictionaries(
            st.sampled_from(["topics", "services", "actions", "parameters", "to", "x"]),
            st.none()
            | st.text(max_size=3)
            | st.lists(st.sampled_from(["/a", "a", "*", "/a/*", "", "dabo"]), max_size=3),
        ),
        max_size=3,
    )
)
def test_any_exports_give_entries_or_a_sentence(value):
    try:
        found = exports_module.read_exports(value)
    except UnexpectedValue as problem:
        assert str(problem)
    else:
        assert len(found) == len(value)


# Contradictions

POSE = {"topics": ["/pose"]}
RESET = {"services": ["/reset"]}
DOCK = {"actions": ["/dock"]}

WRONG = {
    "unknown robot": ({"tibi": exports({**POSE, "to": ["dabbo"]})}, ["tibi-visio multimaster_exports dabbo dabo"]),
    "a computer for a robot": (
        {"tibi": exports({**POSE, "to": ["dabo-nav"]})},
        ["tibi-visio multimaster_exports dabo-nav dabo"],
    ),
    "to itself": ({"tibi": exports({**POSE, "to": ["tibi", "dabo"]})}, ["tibi-visio multimaster_exports tibi"]),
    "never exchanged": (
        {"tibi": exports({"topics": ["/rosout", "/master_sync/*"], "services": ["/base/get_loggers"]})},
        ["multimaster_exports /rosout", "multimaster_exports /master_sync/*", "multimaster_exports /base/get_loggers"],
    ),
    "the same service": (
        {"tibi": exports(RESET), "dabo": exports(RESET)},
        ["tibi-visio multimaster_exports /reset car dabo roscore"],
    ),
    "the same action": (
        {"tibi": exports(DOCK), "dabo": exports({**DOCK, "to": ["car"]})},
        ["tibi-visio multimaster_exports /dock car dabo"],
    ),
    "a service and a pattern": (
        {"tibi": exports({"services": ["/r*"]}), "dabo": exports(RESET)},
        ["dabo-nav multimaster_exports /reset car tibi"],
    ),
    "an ignored topic": (
        {"tibi": exports({**POSE, "to": ["dabo"]}), "dabo": {"filters": {"ignore_topics": ["/po.e", "/x"]}}},
        ["dabo-nav multimaster_filters /pose multimaster_exports tibi dabo group_vars/dabo.yml group_vars/tibi.yml"],
    ),
    "a topic of an ignored action": (
        {
            "tibi": exports({"topics": ["/dock/goal"], "to": ["dabo"]}),
            "dabo": {"filters": {"ignore_actions": ["/dock"]}},
        },
        ["dabo-nav multimaster_filters /dock/goal"],
    ),
    "an ignored service": (
        {"tibi": exports({**RESET, "to": ["dabo"]}), "dabo": {"filters": {"ignore_services": ["*set"]}}},
        ["dabo-nav multimaster_filters /reset"],
    ),
    "an ignored action": (
        {"tibi": exports({**DOCK, "to": ["dabo"]}), "dabo": {"filters": {"ignore_actions": ["/dock"]}}},
        ["dabo-nav multimaster_filters /dock"],
    ),
    "ignored goals": (
        {"tibi": exports({**DOCK, "to": ["dabo"]}, ignore_topics=["/dock/goal"])},
        ["tibi-visio multimaster_filters /dock"],
    ),
    "an ignored master": (
        {"tibi": exports({**POSE, "to": ["dabo"]}), "dabo": {"filters": {"ignore_hosts": ["tibi*"]}}},
        ["dabo-nav multimaster_filters /pose"],
    ),
    "a master outside the white list": (
        {"tibi": exports({**POSE, "to": ["dabo"]}), "dabo": {"filters": {"sync_hosts": ["car"]}}},
        ["dabo-nav multimaster_filters /pose"],
    ),
    "a master outside a white list": (
        {"tibi": exports({**POSE, "to": ["dabo"]}), "dabo": {"filters": {"sync_hosts": ["(car)", "dabo-*"]}}},
        ["dabo-nav multimaster_filters /pose"],
    ),
    "a parameter of two robots": (
        {"tibi": exports({"parameters": ["/model"], "to": ["dabo"]}), "car": exports({"parameters": ["/model"]})},
        ["tibi-visio multimaster_exports /model dabo car roscore"],
    ),
    "a parameter of all robots": (
        {robot: exports({"parameters": ["/model"]}) for robot in ("tibi", "dabo", "car")},
        [
            "dabo-nav multimaster_exports /model tibi car",
            "tibi-visio multimaster_exports /model dabo car",
            "tibi-visio multimaster_exports /model car dabo",
        ],
    ),
    "a parameter in that of another robot": (
        {"tibi": exports({"parameters": ["/arm"]}), "dabo": exports({"parameters": ["/arm/joints"]})},
        ["tibi-visio multimaster_exports /arm car /arm/joints dabo"],
    ),
    "a parameter of an ignored master": (
        {"tibi": exports({"parameters": ["/a"], "to": ["dabo"]}), "dabo": {"filters": {"ignore_hosts": ["tibi*"]}}},
        ["dabo-nav multimaster_filters /a"],
    ),
    "a second white list": (
        {"tibi": exports(POSE), "dabo": {"filters": {"sync_topics": ["/pose"], "sync_nodes": ["/n"]}}},
        ["dabo-nav multimaster_filters sync_nodes sync_topics multimaster_exports tibi"],
    ),
    "a second white list beside goals": (
        {"tibi": exports(DOCK, sync_topics=["/x"]), "dabo": exports()},
        ["tibi-visio multimaster_filters sync_topics multimaster_exports dabo"],
    ),
    "too few heartbeats": (
        {"shared": {"multimaster_heartbeat_hz": 0.35, "multimaster_offline_after": 5}},
        ["multimaster_heartbeat_hz 0.35 0.4 multimaster_offline_after 5 6.7 1.5 2 group_vars/robots.yml"],
    ),
    "no heartbeats": (
        {"shared": {"multimaster_heartbeat_hz": 0.05, "multimaster_offline_after": 60}},
        ["0 2 multimaster_heartbeat_hz 0.1 group_vars"],
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_contradiction_is_named(case):
    declared, expected = WRONG[case]
    found = problems(**declared)
    assert len(found) == len(expected), found
    for sentence, part in zip(found, expected, strict=True):
        assert mentions(sentence, *part.split())


def test_computers_of_a_robot_that_disagree_are_named():
    variables = {
        host: {
            "multimaster_address": HOSTS[host][1],
            "multimaster_common_network": "192.168.1.0/24",
            **OF_ROBOT["dabo"],
        }
        for host in ("dabo-visio", "dabo-nav")
    }
    variables["dabo-visio"]["multimaster_exports"] = [RESET]
    variables["dabo-nav"]["multimaster_exports"] = [POSE]
    with pytest.raises(fleet_module.InventoryProblems) as caught:
        fleet_module.read_fleet(fleet_module.Inventory(robots={"dabo": list(variables)}, variables=variables))
    (found,) = caught.value.problems
    assert mentions(found, "dabo-nav", "multimaster_exports", "/pose", "dabo-visio", "/reset")


def test_a_declaration_on_one_computer_is_the_robots_and_checked():
    variables = {
        host: {
            "multimaster_address": HOSTS[host][1],
            "multimaster_common_network": "192.168.1.0/24",
            **OF_ROBOT["dabo"],
        }
        for host in ("dabo-visio", "dabo-nav")
    }
    variables["dabo-visio"]["multimaster_exports"] = [{**POSE, "to": ["nobody"]}]
    with pytest.raises(fleet_module.InventoryProblems, match="multimaster_exports.*nobody"):
        fleet_module.read_fleet(fleet_module.Inventory(robots={"dabo": list(variables)}, variables=variables))


@pytest.mark.parametrize(("rate", "after"), [(1, 5), (0.5, 5), (0.4, 5), (0.35, 6.7), (0.1, 20), (0.02, 65)])
def test_without_a_value_a_slow_rate_is_waited_for(rate, after):
    assert fleet({"multimaster_heartbeat_hz": rate}).variables.offline_after == after


@pytest.mark.parametrize(
    "declared",
    [
        {"tibi": exports({**RESET, "to": ["dabo"]}), "dabo": exports({**RESET, "to": ["car"]})},  # one provider each
        {"tibi": exports({"services": ["/r*"]}), "dabo": exports({"services": ["/re*"]})},  # may be, and is not sure
        {"tibi": exports(POSE), "dabo": exports(POSE)},  # a topic may have many publishers
        {"tibi": exports(POSE), "dabo": {"filters": {"ignore_topics": ["/pose"]}}},  # for all who want it
        {"tibi": exports(POSE), "dabo": {"filters": {"sync_hosts": ["tibi-visio"], "sync_topics": []}}},
        {"tibi": exports({**POSE, "to": ["dabo"]}), "dabo": {"filters": {"sync_hosts": ["Tibi-visio"]}}},
        {
            "tibi": exports({**POSE, "to": ["dabo"]}),
            "dabo": {"filters": {"sync_hosts": ["(?P<a>car)", "(?P<b>tibi)-visio"]}},
        },
        {"tibi": exports({**POSE, "to": ["car"]}), "dabo": {"filters": {"sync_topics": ["/pose"]}}},  # gets nothing
        {
            "tibi": exports({**POSE, "to": ["dabo"]}),
            "dabo": {"filters": {"ignore_nodes": ["/n"], "ignore_types": ["a/B"]}},
        },
        {"shared": {"multimaster_heartbeat_hz": 0.1, "multimaster_offline_after": 20}},
        {"tibi": exports({"services": ["*"]}), "dabo": exports(RESET)},  # whatever tibi has: hardly the same
        {"tibi": exports({"actions": ["/*/dock"]}), "dabo": exports({"actions": ["/dabo/dock"]})},
    ],
)
def test_what_may_be_meant_is_no_problem(declared):
    assert fleet(**declared)


def test_a_hundred_robots_with_one_service_are_a_few_sentences():
    entries = exports_module.read_exports([RESET])
    own = make(RobotVariables, {"multimaster_exports": entries})
    computers = [Computer(f"c{number}", f"r{number}", None, make(ComputerVariables, {})) for number in range(100)]
    parties = tuple(Robot(computer.robot, None, (computer,), own) for computer in computers)
    inventory = Inventory({party.name: party.hosts for party in parties}, {})
    found = list(contradictions.find_contradictions(Fleet(parties, None, make(FleetVariables, {})), inventory))
    assert len(found) == 3
    assert any(mentions(sentence, "c0", "multimaster_exports", "/reset", "r2", "r3", "r4") for sentence in found)


# Both sides' parameters


def test_without_a_declaration_everything_is_exchanged():
    plan = to_plain(plan_module.fleet_plan(fleet()))
    assert plan["flows"] == []
    assert [master["declared"] for master in plan["masters"]] == [False, False, False]
    assert both_sides(fleet()) == {robot: (None, [], {}) for robot in MASTER}


def test_two_robots_give_to_a_third():
    """Tibi and car give to dabo; nothing flows between tibi and car, nor from dabo."""
    model = fleet(
        tibi=exports({**POSE, "to": ["dabo"]}),
        car=exports({"topics": ["/scan*"], "services": ["/reset"], "to": ["dabo"]}),
        dabo=exports(),
    )
    assert both_sides(model) == {
        "tibi": (
            [{"to": ["192.168.10.100"], "topics": ["/pose", VERIFY], "services": []}],
            ["*"],
            {"ignore_subscribers": ["*"], "ignore_hosts": ["dabo-nav", "car"]},
        ),
        "car": (
            [{"to": ["192.168.10.100"], "topics": ["/scan*", VERIFY], "services": ["/reset"]}],
            ["*"],
            {"ignore_subscribers": ["*"], "ignore_hosts": ["tibi-visio", "dabo-nav"]},
        ),
        "dabo": (
            [],
            ["*"],
            {
                "ignore_subscribers": ["*"],
                "tibi-visio": {"sync_topics": ["/pose", VERIFY], "sync_services": []},
                "car": {"sync_topics": ["/scan*", VERIFY], "sync_services": ["/reset"]},
            },
        ),
    }
    assert to_plain(plan_module.fleet_plan(model))["flows"] == [
        {"from": ["tibi"], "to": ["dabo"], "topics": ["/pose"], "services": []},
        {"from": ["car"], "to": ["dabo"], "topics": ["/scan*"], "services": ["/reset"]},
    ]


def test_parameters_are_copied_by_whom_they_are_given():
    model = fleet(
        tibi=exports(
            {"parameters": ["/tibi/model", "/limits"], "to": ["dabo"]}, {"parameters": ["/map"], "to": ["car"]}
        ),
        car=exports({"parameters": ["/car/model"]}, {**POSE, "to": ["dabo"]}),
        dabo=exports(),
    )
    plan = plan_module.fleet_plan(model)
    copied = {robot: plan.computers[master].sync.get("sync_parameters") for robot, master in MASTER.items()}
    assert copied == {
        "tibi": [{"from": "car", "names": ["/car/model"]}],
        "dabo": [{"from": "tibi-visio", "names": ["/tibi/model", "/limits"]}, {"from": "car", "names": ["/car/model"]}],
        "car": [{"from": "tibi-visio", "names": ["/map"]}],
    }
    for master in MASTER.values():
        parameters.overlay(parameters.SYNC, plan.computers[master].sync)
        assert parameters.overlay(parameters.DISCOVERY, plan.computers[master].discovery)[1] == []
    assert plan.computers["car"].crossing == ("/map", "/car/model") and plan.computers["dabo-visio"].crossing is None
    assert to_plain(plan)["flows"][0]["parameters"] == ["/tibi/model", "/limits"]
    assert "parameters" not in to_plain(plan)["flows"][3]


def test_who_names_no_parameter_copies_none():
    plan = plan_module.fleet_plan(fleet(tibi=exports({"topics": ["*"], "services": ["*"]})))
    assert not any("sync_parameters" in computer.sync or computer.crossing for computer in plan.computers.values())


def test_both_sides_refuse_the_same_parameters():
    assert exports_module.NEVER_CROSSING == parameters.NEVER_CROSSING
    assert exports_module.CROSSING == parameters.CROSSING
    for name in (
        "/a",
        "/a/b_1",
        "/a/",
        "/",
        "a",
        "/a//b",
        "/a*",
        "/1",
        "/run_id",
        "/run_ids",
        "/master_sync/x",
        "/" + "a" * 255,
    ):
        try:
            exports_module.read_exports([{"parameters": [name]}])
            refused = False
        except UnexpectedValue:
            refused = True
        assert refused is bool(parameters.problem_of_parameter(name)), name


def test_upstreams_nodes_copy_no_parameters():
    model = fleet(
        tibi=exports({"parameters": ["/model"]}), dabo={"provider": "fkie_existing", "exports": []}, car=exports()
    )
    own = plan_module.fleet_plan(model).computers["dabo-nav"]
    assert "sync_parameters" not in own.sync
    assert any(mentions(text, "multimaster_exports", "/model") for text in own.limits)


def test_an_action_flows_in_each_direction():
    model = fleet(tibi=exports(DOCK), dabo=exports(), car=exports({**POSE, "to": ["tibi"]}))
    sides = both_sides(model)
    server, client = ["/dock/status", "/dock/feedback", "/dock/result"], ["/dock/goal", "/dock/cancel"]
    at_tibi = ["192.168.11.101", "192.168.1.201"]  # a gateway has two addresses
    assert sides["tibi"][0] == [{"to": ["*"], "topics": [*server, VERIFY], "services": []}]
    assert sides["dabo"][0] == [{"to": at_tibi, "topics": [*client, VERIFY], "services": []}]
    assert sides["car"][0] == [
        {"to": at_tibi, "topics": [*client, VERIFY], "services": []},
        {"to": at_tibi, "topics": ["/pose", VERIFY], "services": []},
    ]
    assert sides["tibi"][2] == {
        "ignore_subscribers": ["*"],
        "dabo-nav": {"sync_topics": [*client, VERIFY], "sync_services": []},
        "car": {"sync_topics": [*client, "/pose", VERIFY], "sync_services": []},
    }
    assert sides["dabo"][2] == {
        "ignore_subscribers": ["*"],
        "tibi-visio": {"sync_topics": [*server, VERIFY], "sync_services": []},
        "ignore_hosts": ["car"],
    }
    assert to_plain(plan_module.fleet_plan(model))["flows"][:2] == [
        {"from": ["tibi"], "to": ["dabo", "car"], "topics": server, "services": []},
        {"from": ["dabo", "car"], "to": ["tibi"], "topics": client, "services": []},
    ]


def test_undeclared_robots_give_all_but_subscribers():
    model = fleet(tibi=exports({**DOCK, "to": ["dabo"]}))
    assert [master["declared"] for master in to_plain(plan_module.fleet_plan(model))["masters"]] == [True, False, False]
    sides = both_sides(model)
    assert sides["dabo"][:2] == sides["car"][:2] == (None, ["*"])
    assert sides["car"][2] == {"ignore_subscribers": ["*"], "ignore_hosts": ["tibi-visio"]}
    assert sides["tibi"][2] == {"ignore_subscribers": ["*"]}
    assert [flow["from"] for flow in to_plain(plan_module.fleet_plan(model))["flows"]] == [["tibi"]]


@pytest.mark.parametrize("name", ["ignore_services", "ignore_subscribers"])
def test_a_filter_without_lost_publishers_keeps_subscribers(name):
    sides = both_sides(fleet(tibi={"filters": {name: ["/x"]}, "exports": None}))
    assert sides["tibi"] == (None, [], {name: ["/x"]})


@pytest.mark.parametrize("name", ["ignore_actions", "ignore_hosts", "ignore_types", "sync_nodes", "sync_services"])
def test_a_robot_that_filters_takes_and_gives_no_subscribers(name):
    sides = both_sides(fleet(tibi={"filters": {name: ["/x"]}}))
    assert sides["tibi"][1] == sides["tibi"][2]["ignore_subscribers"] == ["*"]
    assert sides["dabo"] == (None, [], {})


def test_a_host_of_the_white_list_that_gives_nothing_is_empty():
    sides = both_sides(fleet(tibi=exports(), car={"filters": {"sync_hosts": ["*"]}}))
    assert sides["car"][2] == {
        "sync_hosts": ["*"],
        "ignore_subscribers": ["*"],
        "ignore_hosts": ["tibi-visio"],
        "tibi-visio": {"ignore_nodes": ["*"]},
    }


# What the nodes make of it

VERIFYING = "/multimaster_verify/x"
NAMES = [
    "/pose",
    "/scan",
    "/scan/raw",
    "/dock/goal",
    "/dock/status",
    "/dock/x",
    "/arm/dock/cancel",
    "/arm/dock/result",
    "/reset",
    "/rosout",
]
PATTERNS = [
    "*",
    "/*",
    "/scan*",
    "/pose",
    "*/raw",
    "/DOCK",
    "/dock",
    "/*dock",
    "/arm/dock",
    "/scan/raw",
    "/reset",
    "/r*t",
]
FILTERS = {
    "ignore_topics": ["/pose", "/dock/*", "*"],
    "ignore_services": ["/reset"],
    "ignore_hosts": ["tibi*", "car"],
    "sync_hosts": ["dabo*", "car", "*"],
}
some = st.lists(st.sampled_from(PATTERNS), max_size=3).map(tuple)


def entries_of(robot):
    others = st.lists(st.sampled_from([other for other in MASTER if other != robot]), max_size=2, unique=True).map(
        tuple
    )
    return st.none() | st.lists(
        st.builds(exports_module.Export, topics=some, services=some, actions=some, to=others), max_size=3
    ).map(tuple)


def names(patterns, name):
    """Return True if a list of patterns names this: another implementation than the nodes' and the collection's."""
    return any(fnmatch.fnmatchcase(name.lower(), pattern.lower()) for pattern in patterns)


def declared(robots, giver, taker, key, name):
    """Return True if the declarations say so; word by word."""

    def mine(of, other):
        return [entry for entry in robots[of] if not entry.to or other in entry.to]

    if robots[giver] is None:
        return True
    if any(names(getattr(entry, key), name) for entry in mine(giver, taker)):
        return True
    action, _slash, part = name.rpartition("/")
    if key == "services":
        return False
    if part in ("status", "feedback", "result"):
        return any(names(entry.actions, action) for entry in mine(giver, taker))
    if part in ("goal", "cancel"):
        return any(names(entry.actions, action) for entry in (mine(taker, giver) if robots[taker] else ()))
    return False


EVERY = [*NAMES, VERIFYING]
OF_BOTH = dict.fromkeys(EVERY, ("/n", "/import"))
SERVICES, TYPES = dict.fromkeys(EVERY, ("/n",)), dict.fromkeys(EVERY, "a/B")
STATE = graph.build(
    graph.State("http://giver:11311/", "giver", 0.0, 0.0, OF_BOTH, OF_BOTH, SERVICES, TYPES),
    {"/n": "http://giver:1/", "/import": "http://third:1/"},
    dict.fromkeys(EVERY, "rosrpc://giver:2"),
    {("/import", "http://third:1/"): "http://third:11311/"},
)


class Served:
    """The answer of a master_discovery to a caller at an address, whose robot has everything, and imports of a third."""

    def __init__(self, policy, address):
        told = graph.document(*policy.view(STATE, address))
        self.publishers, self.subscribers, self.services = (dict(part) for part in told[4:7])
        self.nodes = {node for nodes in self.publishers.values() for node in nodes}

    def has(self, key, name):
        return name in (self.services if key == "services" else self.publishers)


class Taken:
    """The registrations that master_sync with these parameters takes of a master; its rules as the other side applies them."""

    def __init__(self, of_taker, master):
        taken = filters.Filters(of_taker)
        self.rules = read_rules(write_rules(taken.rules(master), False)) if taken.wants_host(master) else None

    def has(self, key, name, publisher=True):
        if self.rules is None:
            return False
        return self.rules.service("/n", name) if key == "services" else self.rules.topic("/n", name, "a/B", publisher)


@settings(max_examples=25)
@given(
    st.fixed_dictionaries({robot: entries_of(robot) for robot in MASTER}),
    st.fixed_dictionaries(
        {
            robot: st.fixed_dictionaries(
                {}, optional={key: st.lists(st.sampled_from(values), max_size=2) for key, values in FILTERS.items()}
            )
            for robot in MASTER
        }
    ),
)
def test_both_sides_let_pass_exactly_what_is_declared(robots, filters_of):
    model = fleet()
    model = dataclasses.replace(
        model,
        robots=tuple(
            dataclasses.replace(
                robot,
                variables=dataclasses.replace(
                    robot.variables, exports=robots[robot.name], filters=filters_of[robot.name]
                ),
            )
            for robot in model.robots
        ),
    )
    computers = to_plain(plan_module.fleet_plan(model))["computers"]
    for giver in MASTER:
        of_giver, warnings = parameters.overlay(parameters.DISCOVERY, computers[MASTER[giver]]["discovery"])
        assert not warnings
        policy = graph.ExportPolicy.from_parameters(of_giver)
        for taker in MASTER.keys() - {giver}:
            of_taker = computers[MASTER[taker]]["sync"]
            served, taken = Served(policy, ADDRESS[taker]), Taken(of_taker, MASTER[giver])
            wanted = Taken(filters_of[taker], MASTER[giver])  # the robot's own filters apply beside any declaration
            for key in ("topics", "services"):
                for name in NAMES:
                    expected = declared(robots, giver, taker, key, name)
                    assert served.has(key, name) == expected
                    assert taken.has(key, name) == (expected and wanted.has(key, name))
            flows = robots[giver] is None or giver in flows_module.list_givers(model.flows, taker)
            assert served.has("topics", VERIFYING) == flows
            assert robots[giver] is None or served.nodes <= {"/n"}  # what it has from others is not its to give
            if any(entries is not None for entries in robots.values()):
                assert not served.subscribers
                assert not any(taken.has("topics", name, publisher=False) for name in NAMES)


def test_the_largest_declaration_is_one_that_the_nodes_accept():
    entry = {"topics": [f"/*{number}*" for number in range(40)], "services": [f"/s{number}*" for number in range(500)]}
    model = fleet(tibi=exports(entry))
    assert Taken(both_sides(model)["dabo"][2], "tibi-visio").has("topics", "/x7y")
    entry = {"actions": [f"/a{number}*" for number in range(166)]}
    assert Taken(both_sides(fleet(tibi=exports(entry)))["dabo"][2], "tibi-visio").has("topics", "/a7/status")


@pytest.mark.slow
def test_the_plan_of_a_hundred_exporting_robots_stays_small():
    """Half of a kilobyte for each pair of robots, and each computer gets its hundredth."""
    robots = {f"r{number}": [f"r{number}-c"] for number in range(100)}
    variables = {
        f"r{number}-c": {
            "multimaster_address": f"10.1.{number}.1",
            "multimaster_common_network": "10.1.0.0/16",
            "multimaster_exports": [
                {"topics": [f"/r{number}/pose", f"/r{number}/scan"], "actions": [f"/r{number}/dock"]}
            ],
        }
        for number in range(100)
    }
    plan = to_plain(
        plan_module.fleet_plan(fleet_module.read_fleet(fleet_module.Inventory(robots=robots, variables=variables)))
    )
    assert len(json.dumps(plan["flows"])) < 200_000
    assert len(json.dumps(plan["computers"]["r7-c"])) < 40_000


# What crosses by the relay


def identical(frames=None, provider="bundled", **changed):
    """Three robots, of which two are alike, and what each declares; `frames`: multimaster_frames of each robot."""
    entry = {"topics": ["/scan", "/cmd_vel"], "services": ["/reset"], "to": ["station"]}
    declared = {
        "kobuki1": [{**entry, "as": "/kobuki1"}],
        "kobuki2": [{**entry, "as": "/kobuki2"}],
        "station": [],
        **changed,
    }
    variables = {
        f"{robot}-pc": {
            "multimaster_common_network": "192.168.1.0/24",
            "multimaster_address": f"192.168.1.{number}",
            "multimaster_provider": provider,
            **({} if entries is None else {"multimaster_exports": entries}),
            **({"multimaster_frames": frames[robot]} if robot in (frames or {}) else {}),
        }
        for number, (robot, entries) in enumerate(declared.items(), 1)
    }
    robots = {robot: [f"{robot}-pc"] for robot in declared}
    return fleet_module.read_fleet(fleet_module.Inventory(robots=robots, variables=variables))


def test_both_sides_of_a_channel_have_the_same_names():
    plan = plan_module.fleet_plan(identical(station=None))
    robot, station = (plan.computers[f"{name}-pc"].relay for name in ("kobuki1", "station"))
    shared = {
        "topics": ["/scan", "/cmd_vel"],
        "services": ["/reset"],
        "back": [],
        "as": "/kobuki1",
        "base": "",
        "rate": 0.0,
        "newest": False,
        "whole": [],
        "frames": "",
        "world": "",
        "root": "",
        "port": 11911,
    }
    assert robot["channels"] == [{**shared, "peer": "station", "hosts": ["192.168.1.3"], "inner": True}]
    assert station["channels"][0] == {**shared, "peer": "kobuki1", "hosts": ["192.168.1.1"], "inner": False}
    assert [entry["peer"] for entry in station["channels"]] == ["kobuki1", "kobuki2"]
    assert parameters.overlay(parameters.RELAY, {**station, "members": []})[1] == []
    own = plan.computers["kobuki1-pc"]
    assert "relay" in own.services and ("tcp", 11911) in {(port.protocol, port.port) for port in own.ports}
    # The station gives everything, but what comes by the relay does not come twice.
    assert own.sync["station-pc"]["ignore_topics"] == ["/kobuki1/scan", "/kobuki1/cmd_vel"]
    assert own.sync["station-pc"]["ignore_services"] == ["/kobuki1/reset"]
    assert own.discovery["exports"] == []


def test_upstreams_nodes_leave_the_relay_beside_them_alone():
    plan = plan_module.fleet_plan(identical(provider="fkie_existing", station=None))
    for computer in plan.computers.values():
        assert "relay" in computer.services and computer.relay
        assert "/master_relay" in computer.sync["ignore_nodes"]
    without = plan_module.fleet_plan(identical(provider="fkie_existing", kobuki1=[], kobuki2=[]))
    assert not any("/master_relay" in computer.sync["ignore_nodes"] for computer in without.computers.values())


def test_without_such_an_entry_there_is_no_relay():
    plan = plan_module.fleet_plan(identical(kobuki1=[{"topics": ["/scan"]}], kobuki2=[]))
    for computer in plan.computers.values():
        assert computer.relay is None and "relay" not in computer.services and "relay" not in to_plain(computer)


def test_each_name_may_have_another_one():
    names = {"/scan": "/front", "/reset": "/kobuki1/start", "/dock": "/docking"}
    entry = {"topics": ["/scan"], "services": ["/reset"], "actions": ["/dock"], "as": names, "to": ["station"]}
    fleet = identical(kobuki1=[entry], kobuki2=[])
    plan = plan_module.fleet_plan(fleet)
    for host, inner in (("kobuki1-pc", True), ("station-pc", False)):
        channels = plan.computers[host].relay["channels"]
        crossing = [
            (name, flows_module.find_outer_name(entry, name))
            for entry in channels
            for name in (*entry["topics"], *entry["services"], *entry["back"])
        ]
        parts = [(f"/dock/{part}", f"/docking/{part}") for part in ("status", "feedback", "result", "goal", "cancel")]
        assert crossing == [("/scan", "/front"), ("/reset", "/kobuki1/start"), *parts]
        node = [Channel.from_entry(entry) for entry in channels]
        for own, theirs in crossing:
            kind = SERVICE if own == "/reset" else TOPIC
            local = own if inner else theirs
            given = inner != own.endswith(("goal", "cancel"))
            assert {one.find_name(kind, local) for one in node} - {None} == ({theirs} if given else set())
            for way in (True, False):
                found = {one.find_local(kind, theirs, given=way) for one in node} - {None}
                assert found == ({local} if given == way else set())
            assert own in {flows_module.find_inner_name(entry, theirs) for entry in channels}
        for other in ("/front/scan", "/frontal", "/scan/front", "/dockings/goal", "/docking", ""):
            assert {one.find_local(TOPIC, other, given=way) for one in node for way in (True, False)} == {None}


COMMANDS = {"topics": ["/scan"], "back": ["/cmd_vel", "/goal/*"], "as": "/kobuki1", "to": ["station"]}
GIVEN = {"topics": ["/kobuki1/*"], "to": ["kobuki1"]}


@pytest.mark.parametrize("station", [None, [GIVEN], [{"topics": ["*"]}]])
def test_what_comes_back_is_named_and_given(station):
    """Each of the two relays gives and takes that alone: the station publishes /kobuki1/scan as well."""
    plan = plan_module.fleet_plan(identical(kobuki1=[COMMANDS], kobuki2=[], station=station))
    robot, there = (
        Channel.from_entry(plan.computers[f"{name}-pc"].relay["channels"][0]) for name in ("kobuki1", "station")
    )
    for one, gives, takes in ((robot, ["/scan"], ["/cmd_vel", "/goal/x"]), (there, ["/cmd_vel", "/goal/x"], ["/scan"])):
        local = (lambda name: name) if one is robot else (lambda name: f"/kobuki1{name}")
        for names, way in ((gives, True), (takes, False)):
            for name in names:
                assert one.find_name(TOPIC, local(name)) == (f"/kobuki1{name}" if way else None)
                assert one.find_local(TOPIC, f"/kobuki1{name}", given=way) == local(name)
                assert one.find_local(TOPIC, f"/kobuki1{name}", given=not way) is None
    # By the relay, and not by sync as well.
    assert {"/kobuki1/cmd_vel", "/kobuki1/goal/*"} <= set(
        plan.computers["kobuki1-pc"].sync["station-pc"]["ignore_topics"]
    )


@pytest.mark.parametrize(
    "station",
    [
        [],
        [{"topics": ["/kobuki1/cmd_vel"], "to": ["kobuki1"]}],
        [{"topics": ["/kobuki1/goal/*"], "to": ["kobuki2"]}],
        [{"topics": ["/kobuki1/*"], "as": "/station"}],
    ],
)
def test_a_robot_gives_back_what_it_declares_alone(station):
    with pytest.raises(fleet_module.InventoryProblems) as found:
        identical(kobuki1=[COMMANDS], kobuki2=[], station=station)
    lacking = "/kobuki1/goal/*" if "cmd_vel" in str(station) else "/kobuki1/cmd_vel"
    assert f"does not give {lacking} to kobuki1; expected" in found.value.problems[0]
    to_all = [{**COMMANDS, "to": []}]
    del to_all[0]["to"]
    for channel in identical(kobuki1=to_all, kobuki2=[], station=station).channels:
        assert not {name for name in channel.back if f"/kobuki1{name}" == lacking}
        assert channel.other != "kobuki2" or not channel.back


@pytest.mark.parametrize(
    ("entries", "expected"),
    [
        ([{"topics": ["/scan"], "back": ["/cmd_vel"]}], "'back' with 'as', 'rate', 'newest' or 'frames'"),
        ([{"back": ["/diagnostics"], "as": "/k"}], "no /diagnostics at 'back'"),
        ([{"back": ["cmd_vel"], "as": "/k"}], "absolute names of letters"),
        ([{"back": "/cmd_vel", "as": "/k"}], "a list of names at 'back', such as [/cmd_vel]"),
        ([{"back": ["/rosout"], "as": "/k"}], "has the topic /rosout, which is never exchanged"),
        (
            [{"back": ["/cmd_vel"], "as": name, "to": ["station"]} for name in ("/a", "/b")],
            "has /cmd_vel at 'back' for station in two entries",
        ),
    ],
)
def test_a_wrong_way_back_is_one_sentence(entries, expected):
    with pytest.raises(fleet_module.InventoryProblems) as found:
        identical(kobuki1=entries, kobuki2=[], station=None)
    assert len(found.value.problems) == 1 and expected in found.value.problems[0], found.value.problems


@pytest.mark.parametrize(
    ("entry", "station", "lost"),
    [
        ({"topics": ["/scan"], "rate": 5}, {"topics": ["/scan"]}, "/scan"),
        ({"topics": ["/sc*"], "rate": 5}, {"topics": ["/scan"]}, "/scan"),
        ({"topics": ["/scan/*"], "newest": True}, {"topics": ["/scan/front"]}, "/scan/front"),
        ({"topics": ["/scan"], "as": "/kobuki1"}, {"topics": ["/kobuki1/scan"]}, "/kobuki1/scan"),
        ({"topics": ["/dock/status"], "rate": 5}, {"actions": ["/dock"]}, "/dock/status"),
        ({"topics": ["/scan"], "back": ["/scan"], "rate": 5}, {"topics": ["/scan"]}, ""),
        ({"topics": ["/scan"], "rate": 5}, {"topics": ["/*"]}, ""),
        ({"topics": ["/scan"], "rate": 5}, {"topics": ["/scan"], "to": ["kobuki2"]}, ""),
        ({"topics": ["/scan"], "rate": 5}, {"topics": ["/scan"], "rate": 5}, ""),
        ({"topics": ["/scan"]}, {"topics": ["/scan"]}, ""),
    ],
)
def test_a_topic_that_would_be_lost_on_its_way_back_is_refused(entry, station, lost):
    """The exchange leaves out what the relay takes across, so the station's own /scan never came, and nobody said so."""
    try:
        identical(kobuki1=[{"to": ["station"], **entry}], kobuki2=[], station=[{"to": ["kobuki1"], **station}])
        problems = []
    except fleet_module.InventoryProblems as found:
        problems = found.problems
    assert len(problems) == bool(lost), problems
    assert all(f"gives {lost} to kobuki1, which is lost" in problem for problem in problems)


def test_a_way_back_has_names_of_its_own():
    names = {"/scan": "/front/scan", "/cmd_vel": "/drive"}
    entry = {"topics": ["/scan"], "back": ["/cmd_vel"], "as": names, "to": ["station"]}
    fleet = identical(kobuki1=[entry], kobuki2=[], station=[{"topics": ["/drive"], "to": ["kobuki1"]}])
    assert [(c.entry.namespace, c.entry.given_topics, c.back) for c in fleet.channels] == [
        ("/front/scan", ("/scan",), ()),
        ("/drive", (), ("/cmd_vel",)),
    ]


def test_an_action_crosses_with_all_its_topics():
    (channel,) = identical(kobuki1=[{"actions": ["/dock"], "rate": 5, "to": ["station"]}], kobuki2=[]).channels
    assert channel.entry.given_topics == ("/dock/status", "/dock/feedback", "/dock/result")
    assert channel.back == ("/dock/goal", "/dock/cancel"), "the station declares []: who may call it sends goals"
    assert channel.entry.rate == 5.0


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        (
            {"kobuki2": [{"topics": ["/scan"], "as": "/kobuki1"}]},
            "gives /kobuki1/scan to station, and so does that of kobuki1",
        ),
        ({"kobuki2": [{"topics": ["/kobuki1/*"]}]}, "and so does that of kobuki1"),
        (
            {"kobuki1": [{"topics": ["/scan"]}, {"topics": ["/sc*"], "rate": 5, "to": ["station"]}]},
            "gives /sc* to station, and so does another entry",
        ),
        ({"kobuki2": [{"services": ["/reset"], "as": "/kobuki1"}]}, "gives /kobuki1/reset to station"),
        (
            {**{f"kobuki{number}": [{"topics": ["/scan"], "as": "/k"}] for number in (1, 2)}, "display": []},
            "gives /k/scan to station, display, and so does that of kobuki1",
        ),
        ({"kobuki2": [{"topics": ["/scan"], "as": "/k", "to": ["kobuki3"]}]}, "is for 'kobuki3', which is no robot"),
        ({"kobuki2": [{"topics": ["/rosout"], "as": "/k"}]}, "has the topic /rosout, which is never exchanged"),
    ],
)
def test_names_that_would_meet_are_one_sentence(changed, expected):
    with pytest.raises(fleet_module.InventoryProblems) as found:
        identical(**changed)
    assert len(found.value.problems) == 1 and expected in found.value.problems[0], found.value.problems


# Frames, and parameters of robots that are alike

TREE = {"topics": ["/tf", "/tf_static"], "to": ["station"]}
TREES = {f"kobuki{number}": [{**TREE, "frames": f"kobuki{number}/"}] for number in (1, 2)}
ROOTS = {"kobuki1": {"world": "map"}, "kobuki2": "external"}


def test_both_sides_know_how_the_frames_are_called():
    plan = plan_module.fleet_plan(identical(ROOTS, **TREES))
    words = ("peer", "frames", "world", "root")
    channels = {
        name: [tuple(entry[word] for word in words) for entry in plan.computers[f"{name}-pc"].relay["channels"]]
        for name in ("kobuki1", "kobuki2", "station")
    }
    of_first, of_second = ("kobuki1/", "world", "map"), ("kobuki2/", "", "")
    assert channels["kobuki1"] == [("station", *of_first)] and channels["kobuki2"] == [("station", *of_second)]
    assert channels["station"] == [("kobuki1", *of_first), ("kobuki2", *of_second)]


@pytest.mark.parametrize(
    ("frames", "changed", "expected"),
    [
        (
            None,
            {},
            "kobuki1-pc: multimaster_exports gives /tf and /tf_static to station with 'frames', but multimaster_frames does not say",
        ),
        (
            ROOTS,
            {"kobuki1": [{"topics": ["/tf"], "frames": "kobuki1/", "to": ["station"]}]},
            "kobuki1-pc: multimaster_exports gives /tf to station with 'frames', but not /tf_static",
        ),
        (
            ROOTS,
            {"kobuki2": [{**TREE, "frames": "kobuki1/arm/"}]},
            "of kobuki1 with 'kobuki1/' to station, and those of kobuki2 with 'kobuki1/arm/', which begins with it",
        ),
        (
            ROOTS,
            {"kobuki2": [{**TREE, "frames": "kobuki1/"}]},
            "of kobuki1 with 'kobuki1/' to station, and those of kobuki2 with 'kobuki1/'",
        ),
        (
            ROOTS,
            {"kobuki1": [*TREES["kobuki1"], {"topics": ["/scan"], "as": "/k", "frames": "k/"}]},
            "kobuki1-pc: multimaster_exports gives frames to station with 'kobuki1/' and with 'k/'; expected one prefix",
        ),
        (
            ROOTS,
            {
                "kobuki1": [
                    {"topics": [f"/{name}"], "frames": "kobuki1/", "to": [to]}
                    for name, to in (("tf", "station"), ("tf_static", "kobuki2"))
                ]
            },
            "kobuki1-pc: multimaster_exports gives /tf to station with 'frames', but not /tf_static",
        ),
    ],
)
def test_frames_that_do_not_hang_together_are_one_sentence(frames, changed, expected):
    with pytest.raises(fleet_module.InventoryProblems) as found:
        identical(frames, **{**TREES, **changed})
    assert expected in found.value.problems[0], found.value.problems


@pytest.mark.parametrize(
    "wrong", ["map", {}, {"world": 1}, {"world": ""}, {"a": "b", "c": "d"}, ["world"], {"/world": "map"}, None]
)
def test_a_wrong_tree_is_one_sentence(wrong):
    with pytest.raises(UnexpectedValue, match="such as {world: map}, or external"):
        exports_module.read_frames(wrong)


def test_parameters_of_two_robots_are_in_their_namespaces():
    entry = {"parameters": ["/robot_description"], "to": ["station"]}
    declared = {robot: [{**entry, "topics": ["/scan"], "as": f"/{robot}"}] for robot in ("kobuki1", "kobuki2")}
    fleet = identical(**declared)
    plan = plan_module.fleet_plan(fleet)
    copied = plan.computers["station-pc"].sync["sync_parameters"]
    assert copied == [
        {"from": f"{robot}-pc", "names": ["/robot_description"], "as": f"/{robot}"} for robot in ("kobuki1", "kobuki2")
    ]
    assert parameters.overlay(parameters.SYNC, {"sync_parameters": copied})[1] == []
    assert plan.computers["kobuki1-pc"].crossing == ("/robot_description",)
    assert plan.computers["station-pc"].crossing == ("/kobuki1/robot_description", "/kobuki2/robot_description")
    alone = plan_module.fleet_plan(identical(kobuki1=[{**entry, "as": "/kobuki1"}], kobuki2=[]))
    assert alone.computers["kobuki1-pc"].relay is None, "they do not cross by the relay"


def test_one_name_of_parameters_of_two_robots_is_a_sentence():
    declared = {"kobuki1": [{"parameters": ["/a"], "as": "/k"}], "kobuki2": [{"parameters": ["/k/a"]}]}
    with pytest.raises(fleet_module.InventoryProblems) as found:
        identical(**declared)
    assert mentions(found.value.problems[0], "/k/a", "kobuki2")
