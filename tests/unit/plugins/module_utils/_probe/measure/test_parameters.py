# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The parameters of nodes, as a real XML-RPC server tells them."""

import json

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import parameters

PLANNED = {
    "master_discovery": {"mcast_group": "226.0.0.0", "mcast_port": 11511, "allow": [], "exports": None},
    "master_sync": {"ignore_topics": ["/tf"]},
}


class Told:
    """A roscore that answers getParam and hasParam."""

    def __init__(self, values):
        self.values = values

    def ask(self, method, name):
        if method == "hasParam":
            return name in self.values
        if name not in self.values:
            raise OSError(f"http://127.0.0.1:11311: {method}: Parameter [{name}] is not set")
        return self.values[name]


def test_what_is_as_planned():
    there = {
        "/master_discovery": {**PLANNED["master_discovery"], "members": [1]},
        "/master_sync": PLANNED["master_sync"],
    }
    del there["/master_discovery"]["exports"]  # None is not set
    found = parameters.parameters(Told(there), PLANNED)
    assert found == {
        "nodes": ["master_discovery", "master_sync"],
        "differing": [],
        "crossing": [],
        "simulated": False,
        "error": "",
    }


@pytest.mark.parametrize(("value", "simulated"), [(True, True), (False, False), ("true", False), (None, False)])
def test_simulated_time_is_told(value, simulated):
    told = Told({} if value is None else {"/use_sim_time": value})
    assert parameters.parameters(told, None)["simulated"] is simulated


def test_what_differs_and_what_is_not_there():
    found = parameters.parameters(
        Told({"/master_discovery": {"mcast_group": "239.1.2.3", "mcast_port": 11511}}), PLANNED
    )
    assert found["nodes"] == ["master_discovery"] and "not set" in found["error"]
    assert found["differing"] == [
        {"node": "master_discovery", "name": "allow", "expected": "[]", "found": "not set"},
        {"node": "master_discovery", "name": "mcast_group", "expected": '"226.0.0.0"', "found": '"239.1.2.3"'},
    ]


@pytest.mark.parametrize(
    ("name", "value", "counts"),
    [
        ("exports", [], True),  # it declares that it gives nothing
        ("ignore_topics", ["/tf"], True),
        ("ignore_topics", [], False),
        ("husky", {"sync_topics": ["/odom"]}, True),
        ("sync_remote_nodes", False, False),
        ("log_level", "DEBUG", False),
        ("members", [{"name": "husky"}], False),
    ],
)
def test_of_what_the_plan_does_not_have_only_filters_count(name, value, counts):
    assert bool(parameters.compare("master_sync", {}, {name: value})) == counts


@pytest.mark.parametrize("value", ["x" * 10**6, "\x1b[2J", [[1]] * 10**5, b"\x00", float("nan")])
def test_what_anybody_may_have_set_is_short_and_plain(value):
    (entry,) = parameters.compare("master_sync", {"ignore_topics": []}, {"ignore_topics": value})
    assert len(entry["found"]) <= parameters.LONGEST and entry["found"].isprintable()


def test_a_namespace_that_is_no_namespace_is_not_compared():
    assert parameters.parameters(Told({"/master_sync": "a text"}), {"master_sync": {"a": 1}})["nodes"] == []


def test_nodes_of_fkie_mas_are_compared_below_their_own_names():
    told = Told({"/mas_discovery": {"mcast_group": "239.1.2.3", "mcast_port": 11511, "allow": []}})
    found = parameters.parameters(told, PLANNED)
    assert found["nodes"] == ["master_discovery"] and "not set" in found["error"]
    assert [(entry["node"], entry["name"]) for entry in found["differing"]] == [("master_discovery", "mcast_group")]


class Holding:
    """A roscore that has parameters."""

    def __init__(self, values):
        self.values = values

    def ask(self, method, name):
        if self.values is None:
            raise OSError("http://127.0.0.1:11311: refused")
        return name in self.values if method == "hasParam" else self.values[name]


def test_digests_of_crossing_parameters():
    one, other = ({"/a": {"model": "<a/>" + end, "k": [1, 2.5]}, "/c": {}} for end in ("\r\n", "\n"))
    here, there = (
        parameters.parameters(Holding(values), {}, ["/a", "/b", "/c"])["crossing"] for values in (one, other)
    )
    assert here == there and [bool(entry["digest"]) for entry in here] == [True, False, False]
    assert parameters.digest(1) != parameters.digest(1.0) != parameters.digest("1")
    deep = []
    for _level in range(100_000):
        deep = [deep]
    assert parameters.digest(deep)


def test_a_roscore_without_an_answer_tells_no_digests():
    found = parameters.parameters(Holding(None), {}, ["/a"])
    assert found["crossing"] == [] and "refused" in found["error"]


def test_the_parameters_of_the_relay_are_those_of_its_file(tmp_path, monkeypatch):
    path = tmp_path / "master_relay.json"
    monkeypatch.setitem(parameters.FILES, "master_relay", str(path))
    channel = {"peer": "kobuki2", "topics": ["/scan"], "rate": 0}
    planned = {"port": 11711, "channels": [{**channel, "peer": "a" * 90}, {**channel, "topics": ["/scan", "/odom"]}]}
    path.write_text(json.dumps({"port": 11711, "channels": [{**channel, "peer": "a" * 90}, channel], "members": [1]}))
    found = parameters.parameters(Told({}), {"master_relay": planned})
    (entry,) = found["differing"]
    assert (entry["name"], entry["expected"], entry["found"]) == ("channels", '{"topics": ["/odom"]}', '{"topics": []}')
    path.write_text("[")
    assert "no JSON" in parameters.parameters(Told({}), {"master_relay": planned})["error"]
