# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The registrations that are to pass between robots, and the findings if their roscores hold other ones."""

import dataclasses
import sys

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import filters
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import read as fleet_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import plan as plan_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.registrations import (
    MOST,
    Exchanges,
    FlowRules,
    Flows,
    RegisteredItem,
    RoscoreIndex,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    Exchange,
    Import,
    NodeConnection,
    RegisteredService,
    RegisteredTopic,
)

STRING, IMAGE = ("std_msgs/String", "992c"), ("sensor_msgs/Image", "060021")


def plan(robots="abc", exports=None, diagnostics="local", **filters):
    """The plan of robots of one computer each; `exports` and `filters` by robot."""
    values = {
        f"{robot}1": {
            "multimaster_common_network": "192.168.1.0/24",
            "multimaster_multicast_group": "226.0.0.0",
            "multimaster_address": f"192.168.1.{number}",
            "multimaster_diagnostics": diagnostics,
            **({"multimaster_exports": exports[robot]} if robot in (exports or {}) else {}),
            **({"multimaster_filters": filters[robot]} if robot in filters else {}),
        }
        for number, robot in enumerate(robots, 1)
    }
    return plan_module.fleet_plan(
        fleet_module.read_fleet(
            fleet_module.Inventory(robots={robot: [f"{robot}1"] for robot in robots}, variables=values)
        )
    )


def component(topics=(), services=()):
    """Registrations out of (topic, (type, sum), publishers, subscribers) and (service, node)."""
    return Exchange(
        topics=tuple(
            RegisteredTopic(name, kind, tuple(publishers.split()), tuple(subscribers.split()), md5sum)
            for name, (kind, md5sum), publishers, subscribers in topics
        ),
        services=tuple(RegisteredService(name, node) for name, node in services),
    )


def holds(own, **imports):
    """The content of a roscore: own registrations, and those of other robots by their letters."""
    found = tuple(Import(f"http://{robot}1:11311/", it.topics, it.services) for robot, it in imports.items())
    return dataclasses.replace(own, imports=found)


def texts(found):
    return [str(item) for item in found]


@pytest.mark.parametrize(
    ("patterns", "name", "meant"),
    [
        ((), "/tf", False),
        (("/tf",), "/tf", True),
        (("/tf",), "/tf_static", False),
        (("/tf*",), "/tf_static", True),
        (("/TF*",), "/tf", True),
        (("/a", "/b|/c"), "/c", True),
        (("/a|/b",), "/a/b", False),
        (("(",), "(", False),  # no node starts with such a pattern
        (("(", "/b"), "/b", True),  # each pattern counts by itself
        (("(?i)/A",), "/a", sys.version_info < (3, 11)),  # a flag is refused; older Pythons accept it
    ],
)
def test_a_pattern_means_the_whole_name(patterns, name, meant):
    assert filters.matches(patterns, name) == meant


TALK, EAR, CALL = (
    RegisteredItem("publisher", "/chat", "/talker"),
    RegisteredItem("subscriber", "/chat", "/ear"),
    RegisteredItem("service", "/reset", "/base"),
)


@pytest.mark.parametrize(
    ("rules", "passing"),
    [
        ({}, [TALK, EAR, CALL]),
        ({"ignore_nodes": ("/talker",)}, [EAR, CALL]),
        ({"ignore_topics": ("/ch*",)}, [CALL]),
        ({"ignore_publishers": ("/chat",)}, [EAR, CALL]),
        ({"ignore_subscribers": ("*",)}, [TALK, CALL]),
        ({"hide_subscribers": ("*",)}, [TALK, CALL]),
        ({"hide_subscribers": ("*",), "ignore_subscribers": ("(",)}, [TALK, CALL]),  # lists of two robots
        ({"hide_subscribers": ("(",), "ignore_subscribers": ("*",)}, [TALK, CALL]),
        ({"ignore_services": ("/reset",)}, [TALK, EAR]),
        ({"ignore_type": ("std_msgs/*",)}, [CALL]),
        ({"do_not_sync": ("/reset", "std_msgs/String")}, []),
        ({"sync_topics": ("/chat",)}, [TALK, EAR]),  # a white list is one for services too
        ({"sync_services": ("/reset",)}, [CALL]),
        ({"sync_nodes": ("/ear", "/base")}, [EAR, CALL]),
        ({"sync_topics": ("/chat",), "ignore_nodes": ("/ear",)}, [TALK]),  # an ignored node is not admitted again
    ],
)
def test_what_passes_the_rules(rules, passing):
    made = FlowRules.from_patterns(rules)
    assert [
        item for item in (TALK, EAR, CALL) if made.passes(item, "" if item is CALL else "std_msgs/String")
    ] == passing


@pytest.mark.parametrize(
    ("parameters", "wanted"),
    [
        ({}, True),
        ({"ignore_hosts": ["A1"]}, False),
        ({"sync_hosts": ["b1"]}, False),
        ({"sync_hosts": ["a1"]}, True),
        ({"ignore_hosts": ["*"], "sync_hosts": ["a1"]}, True),
        ({"ignore_hosts": ["b1"], "sync_hosts": ["b1"]}, False),  # a white list, beside ignore_hosts too
    ],
)
def test_of_which_masters_anything_is_taken(parameters, wanted):
    assert filters.Filters(parameters).wants_host("a1") == wanted


def test_patterns_for_one_master_in_all_their_forms():
    parameters = {"ignore_topics": ["/x", {"A1": ["/y"], "b1": ["/z"]}], "a1": {"ignore_topics": ["/w"]}}
    own = [text for text in filters.Filters(parameters).patterns("ignore_topics", "a1") if len(text) == 2]
    assert own == ["/x", "/y", "/w"]
    assert "/rosout" in filters.Filters({}).patterns("ignore_topics", "a1")


def test_without_a_declaration_everything_passes_subscribers_too():
    flows = Flows(plan())
    assert all(flows.rules("a", "b").passes(item, "std_msgs/String") for item in (TALK, EAR, CALL))
    assert not flows.declares_nothing("a", "b")
    assert not flows.rules("a", "b").passes(RegisteredItem("publisher", "/rosout", "/talker"), "rosgraph_msgs/Log")


def test_only_the_declared_flow_passes():
    fleet = plan(
        exports={"a": [{"topics": ["/chat"], "to": ["b"]}], "c": [{"services": ["/reset"], "to": ["b"]}], "b": []}
    )
    flows = Flows(fleet)
    passing = {
        (source, target): [
            item for item in (TALK, EAR, CALL) if flows.rules(source, target).passes(item, "std_msgs/String")
        ]
        for source in "abc"
        for target in "abc"
        if source != target
    }
    assert passing == {**dict.fromkeys(passing, []), ("a", "b"): [TALK], ("c", "b"): [CALL]}
    assert flows.declares_nothing("a", "c") and not flows.declares_nothing("a", "b")
    test = RegisteredItem("publisher", "/multimaster_verify/a1", "/multimaster_verify_talker_a1_x")
    assert flows.rules("a", "b").passes(test, "std_msgs/String") and not flows.rules("a", "c").passes(
        test, "std_msgs/String"
    )


def test_robots_without_exports_give_all_but_subscribers():
    flows = Flows(plan(exports={"a": []}))
    assert [item for item in (TALK, EAR, CALL) if flows.rules("b", "c").passes(item, "std_msgs/String")] == [TALK, CALL]


def test_an_action_flows_in_both_directions():
    fleet = plan("ab", exports={"a": [{"actions": ["/move"], "to": ["b"]}], "b": []})
    flows = Flows(fleet)

    def passes(source, target, name):
        return flows.rules(source, target).passes(RegisteredItem("publisher", f"/move/{name}", "/n"), "x/Y")

    assert all(passes("a", "b", name) for name in ("status", "feedback", "result"))
    assert all(passes("b", "a", name) for name in ("goal", "cancel"))
    assert not passes("a", "b", "goal") and not passes("b", "a", "result")


def test_filters_hold_beside_a_declaration():
    fleet = plan("ab", exports={"a": [{"topics": ["/chat", "/scan"]}]}, b={"ignore_topics": ["/scan"]})
    rules = Flows(fleet).rules("a", "b")
    assert rules.passes(TALK, "std_msgs/String") and not rules.passes(
        RegisteredItem("publisher", "/scan", "/laser"), "x/Y"
    )


# What robots have


A = component([("/chat", STRING, "/talker", "/ear"), ("/odom", STRING, "/base", "")], [("/reset", "/base")])
B = component([("/pose", STRING, "/pose", "")])


def test_what_is_missing_and_what_is_there_against_the_plan():
    fleet = plan("ab", exports={"a": [{"topics": ["/chat"], "services": ["/reset"]}]})
    good = component([("/chat", STRING, "/talker", "")], [("/reset", "/base")])
    found = Exchanges(fleet, {"a": holds(A), "b": holds(B, a=good)})
    assert found.find_missing("a", "b") == found.superfluous("a", "b") == []
    assert texts(found.find_missing("b", "a")) == ["the publisher /pose of /pose"]
    found = Exchanges(
        fleet,
        {"a": holds(A), "b": holds(B, a=component([("/odom", STRING, "/base", ""), ("/chat", STRING, "", "/ear")]))},
    )
    assert texts(found.find_missing("a", "b")) == ["the publisher /chat of /talker", "the service /reset"]
    assert texts(found.superfluous("a", "b")) == ["the publisher /odom of /base", "the subscriber /chat of /ear"]


def test_publishers_without_a_type_and_our_own_are_not_missed():
    own = component(
        [("/x", ("*", ""), "/n", ""), ("/multimaster_verify/a1", STRING, "/multimaster_verify_talker_a1", "")]
    )
    assert Exchanges(plan("ab"), {"a": holds(own), "b": holds(B)}).find_missing("a", "b") == []


def test_of_a_robot_that_was_not_looked_at_nothing_is_missed():
    found = Exchanges(plan("ab", exports={"a": []}), {"b": holds(B, a=component([("/odom", STRING, "/base", "")]))})
    assert found.find_missing("a", "b") == [] and texts(found.superfluous("a", "b")) == ["the publisher /odom of /base"]


def test_a_name_that_two_robots_have():
    same = component([("/other", STRING, "/talker", "")], [("/reset", "/calibration")])
    found = Exchanges(plan("ab"), {"a": holds(A), "b": holds(same)})
    clashes = [("node", "/talker", ("a", "b")), ("service", "/reset", ("a", "b"))]
    assert [tuple(clash) for clash in found.clashes("a", "b")] == clashes
    # what is refused for its name is not told a second time as missing
    assert texts(found.find_missing("a", "b")) == ["the publisher /odom of /base", "the subscriber /chat of /ear"]


def test_a_node_that_is_twice_is_told_without_its_services():
    found = Exchanges(plan("ab"), {"a": holds(A), "b": holds(component([], [("/reset", "/base")]))})
    assert [clash.name for clash in found.clashes("a", "b")] == ["/base"]


def test_a_name_counts_only_where_it_passes():
    same = component([("/other", STRING, "/talker", "")])
    fleet = plan("ab", exports={"a": [{"topics": ["/odom"]}], "b": []})
    found = Exchanges(fleet, {"a": holds(A), "b": holds(same)})
    assert found.clashes("a", "b") == found.clashes("b", "a") == []
    rosout = component([("/rosout_agg", STRING, "/rosout", "")])
    assert Exchanges(plan("ab"), {"a": holds(rosout), "b": holds(rosout)}).clashes("a", "b") == []


def test_two_robots_that_give_a_third_one_name():
    seen = {"a": holds(A), "b": holds(B), "c": holds(component([("/other", STRING, "/talker", "")]))}
    fleet = plan(
        exports={"a": [{"topics": ["/chat"], "to": ["b"]}], "b": [], "c": [{"topics": ["/other"], "to": ["b"]}]}
    )
    found = Exchanges(fleet, seen)
    assert [clash.robots for clash in found.clashes("a", "b")] == [("a", "c")]
    assert found.clashes("a", "c") == []


def test_a_topic_that_is_something_else_on_two_robots():
    other = component([("/chat", IMAGE, "/camera", ""), ("/odom", ("std_msgs/String", "1234"), "", "/screen")])
    found = Exchanges(plan("ab"), {"a": holds(A), "b": holds(other)})
    assert [(conflict.topic, conflict.one, conflict.other) for conflict in found.conflicts("a", "b")] == [
        ("/chat", ("a", *STRING), ("b", *IMAGE)),
        ("/odom", ("a", *STRING), ("b", "std_msgs/String", "1234")),
    ]
    assert texts(found.find_missing("a", "b")) == ["the service /reset"]


@pytest.mark.parametrize("other", [("*", ""), ("std_msgs/String", ""), STRING])
def test_an_unknown_type_or_sum_is_no_conflict(other):
    seen = {"a": holds(A), "b": holds(component([("/chat", other, "", "/ear2")]))}
    assert Exchanges(plan("ab"), seen).conflicts("a", "b") == []


def test_a_conflict_counts_only_where_the_topic_passes():
    seen = {"a": holds(A), "b": holds(component([("/chat", IMAGE, "/camera", "")]))}
    assert Exchanges(plan("ab", exports={"a": [{"topics": ["/odom"]}], "b": []}), seen).conflicts("a", "b") == []


def link(direction, topic, node, peer, robot):
    return NodeConnection(node, topic, direction, peer, f"{robot}1", robot)


def test_connections_that_nothing_explains():
    fleet = plan(
        exports={"a": [{"topics": ["/chat"], "to": ["b"]}], "b": [], "c": [{"topics": ["/chat"], "to": ["b"]}]}
    )
    found = Exchanges(fleet, {"a": holds(A), "b": holds(B), "c": holds(A)})
    heard, hears = link("out", "/chat", "/talker", "/ear", "b"), link("in", "/chat", "/ear", "http://c1:4711/", "c")
    backwards = link("in", "/chat", "/ear", "http://b1:4711/", "b")
    assert found.find_crossing_links([heard, hears, backwards], "a", "b") == [backwards]  # nothing flows from b to a
    assert found.find_crossing_links([heard, hears, backwards], "a", "c") == [hears]


def test_subscribers_of_a_hidden_nodes_topic_are_exchanged():
    """Somebody echoes /diagnostics: the subscriber passes, and hears the discovery node of the other robot, too."""
    seen = {"a": holds(component([("/diagnostics", STRING, "/master_discovery", "/echo")])), "b": holds(B)}
    hears = link("in", "/diagnostics", "/echo", "/master_discovery", "b")
    heard = link("out", "/diagnostics", "/master_discovery", "/echo", "b")
    restricted = plan(exports={"a": [{"topics": ["/chat"]}], "b": []})
    unrestricted, by_default = plan("ab", diagnostics="exchanged"), plan("ab")
    assert Exchanges(by_default, seen).find_crossing_links([hears, heard], "a", "b") == [
        hears,
        heard,
    ]  # it stays on each robot
    assert Exchanges(unrestricted, seen).find_crossing_links([hears, heard], "a", "b") == []
    assert Exchanges(restricted, seen).find_crossing_links([hears, heard], "a", "b") == [hears, heard]


def test_of_a_hostile_robots_answer_so_many_are_compared():
    services = tuple(RegisteredService(f"/s{number}", "/n") for number in range(MOST + 5))
    topics = tuple(RegisteredTopic(f"/t{number}", *STRING[:1], publishers=("/n",)) for number in range(MOST + 5))
    imports = (Import("http://b:11311", (), services),)
    found = RoscoreIndex.from_content(Exchange(topics=topics, services=services, imports=imports))
    assert [len(found.own), len(found.sums), *map(len, found.imports.values())] == [MOST] * 3
