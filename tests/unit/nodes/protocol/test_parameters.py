# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

import pytest
from mentioned import mentions
from rosfleet_multimaster.protocol.parameters import DISCOVERY, SYNC, ParameterError, overlay


def test_defaults_and_what_is_given():
    values, warnings = overlay(DISCOVERY, {"mcast_group": "224.0.0.1", "rpc_port": 11611})
    assert (values["mcast_group"], values["rpc_port"], values["mcast_port"]) == ("224.0.0.1", 11611, 11511)
    assert warnings == []


@pytest.mark.parametrize(
    ("table", "given", "words"),
    [
        (DISCOVERY, {"mcast_grup": "224.0.0.1"}, "did you mean ~mcast_group?"),
        (SYNC, {"ignore_topic": ["/a"]}, "did you mean ~ignore_topics?"),
        (SYNC, {"zzz": 1}, "is no parameter of this node"),
        (SYNC, {"check_host": True}, "has no effect"),
        (DISCOVERY, {"timeout_factor": 2}, "~offline_after says"),
    ],
)
def test_an_unknown_name_is_a_warning_that_names_the_nearest(table, given, words):
    _values, warnings = overlay(table, given)
    assert len(warnings) == 1 and words in warnings[0]


def copied(master, *names, **more):
    return {"from": master, "names": list(names), **more}


@pytest.mark.parametrize(
    ("table", "given", "words"),
    [
        (DISCOVERY, {"mcast_port": 0}, "~mcast_port 0"),
        (DISCOVERY, {"mcast_port": True}, "a port number"),
        (DISCOVERY, {"measurement_intervals": True}, "1 whole"),
        (DISCOVERY, {"heartbeat_hz": 0}, "a number above 0"),
        (DISCOVERY, {"robot_hosts": "kobuki2"}, "texts list"),
        (DISCOVERY, {"send_mcast": "yes"}, "true or false"),
        (DISCOVERY, {"mcast_group": "192.168.1.1"}, "IPv4 multicast group"),
        (DISCOVERY, {"mcast_group": "ff02::1"}, "IPv4 multicast group"),
        (DISCOVERY, {"hide_topics": ["/a["]}, "hide_topics /a["),
        (DISCOVERY, {"hide_subscribers": "/a["}, "hide_subscribers /a["),
        (DISCOVERY, {"offline_after": 0.5}, "~offline_after 0.5 2"),
        (DISCOVERY, {"offline_after": float("nan")}, "~offline_after"),
        (DISCOVERY, {"hide_nodes": {"robot2": ["/a"]}}, "patterns pattern"),
        (DISCOVERY, {"do_not_sync": [{"robot2": ["/a"]}]}, "patterns pattern"),
        (SYNC, {"ignore_topics": ["/a["]}, "ignore_topics /a["),
        (SYNC, {"sync_hosts": 5}, "~sync_hosts is 5"),
        (SYNC, {"sync_parameters": ["/a"]}, "robot2 entries"),
        (SYNC, {"sync_parameters": [{"from": "r"}]}, "texts list"),
        (SYNC, {"sync_parameters": [copied("r", "/a", more=1)]}, "from master names"),
        (SYNC, {"sync_parameters": [copied(7, "/a")]}, "from master names"),
        (SYNC, {"sync_parameters": [copied("r", "/a*")]}, "/a* whole"),
        (SYNC, {"sync_parameters": [copied("r", "/run_id")]}, "/run_id roscore"),
        (SYNC, {"sync_parameters": [copied("r", *[f"/a{n}" for n in range(101)])]}, "100"),
        (SYNC, {"sync_parameters": [copied("r", "/a/b"), copied("s", "/a")]}, "/a/b /a"),
        (SYNC, {"sync_parameters": [copied("r", "/a", "/a")]}, "has /a twice"),
        (SYNC, {"sync_parameters": [copied("r", "/a"), copied("r", "/b")]}, "for 'r'"),
        (SYNC, {"sync_parameters": [copied("r", "/a", **{"as": "k"})]}, "k namespace"),
        (SYNC, {"sync_parameters": [copied("r", "/a", **{"as": "/run_id"})]}, "/run_id"),
        (SYNC, {"sync_parameters": [copied("r", "/a", **{"as": "/k"}), copied("s", "/k/a")]}, "has /k/a twice"),
    ],
)
def test_a_wrong_value_is_a_sentence(table, given, words):
    with pytest.raises(ParameterError) as caught:
        overlay(table, given)
    assert mentions(str(caught.value), *words.split())


@pytest.mark.parametrize(
    ("table", "given"),
    [
        (SYNC, {"ignore_topics": ["/a[0-9]"]}),
        (SYNC, {"robot2": {"sync_hosts": "robot.*"}}),
        (DISCOVERY, {"hide_nodes": "(?:(?:){65000}){65000}x"}),
        (DISCOVERY, {"exports": [{"to": ["*"], "topics": ["/a+"]}]}),
    ],
)
def test_what_anybody_may_have_set_is_no_expression(table, given):
    with pytest.raises(ParameterError, match="a name is expected"):
        overlay(table, given, foreign=True)
    if "exports" not in given and "hide_nodes" not in given:
        assert overlay(table, given)[1] == []


def test_the_interface_may_follow_the_group():
    assert overlay(DISCOVERY, {"mcast_group": "226.0.0.0@192.168.1.201"})[1] == []
    values, warnings = overlay(SYNC, {"robot2": {"ignore_topics": ["/a"]}})
    assert warnings == [] and values["robot2"] == {"ignore_topics": ["/a"]}
