# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Nodes that people start wrongly, all at once on two robots: each is told with its computer, its fault and what has started it.

Each way of people and each kind of fault is there. Two faults at once are the rule here.
"""

import json

import pytest
from setups import people_nodes
from setups.people_nodes import (
    BRIDGED_AS_COMPUTER,
    DOCKER,
    FILTERED,
    FORGOTTEN,
    GONE,
    HUNG,
    announce,
    list_services_elsewhere,
    use_roscore,
)

FIRST, SECOND = "kobuki1computer", "kobuki2computer"
#: name of the node -> its computer, what starts it, what is wrong, and the part that says it: kind, mode, place
NODES = {
    "forgotten": (FIRST, "shell", FORGOTTEN, ("node", "unregistered", FIRST)),
    "loopback": (FIRST, "shell", announce("127.0.0.1", "", "ROS_IP"), ("node", "loopback", FIRST)),
    "launched": (FIRST, "launch", announce("localhost", ""), ("node", "loopback", FIRST)),
    "boxed": (FIRST, "container", announce("laptop-of-bob", ""), ("node", "name", FIRST)),
    "bridged": (SECOND, "container", BRIDGED_AS_COMPUTER, ("node", "network", SECOND)),
    "docker": (FIRST, "unit", DOCKER, ("node", "interface", FIRST)),
    "foreign": (SECOND, "unit", announce("192.168.66.9", "", "ROS_IP"), ("node", "address", SECOND)),
    "copied": (SECOND, "shell", announce("laptop-of-ann", ""), ("node", "name", SECOND)),
    "guest": (SECOND, "shell", use_roscore(f"http://{FIRST}:11311", ""), ("node", "robot", SECOND)),
    "lost": (
        SECOND,
        "unit",
        use_roscore("http://localhost:11399", "", registers=False),
        ("node", "master", SECOND),
    ),
    "served": (FIRST, "shell", list_services_elsewhere("192.168.66.9"), ("node", "services", FIRST)),
    "stuck": (SECOND, "unit", HUNG, ("node", "hung", SECOND)),
    "gone": (FIRST, "unit", GONE, ("registration", "ghost", FIRST)),
    "fenced": (SECOND, "shell", FILTERED, ("node", "fenced", SECOND)),
}


@pytest.fixture(scope="module")
def told(lab, tmp_path_factory):
    """The findings with all of them, and without any: (document, output) each."""
    folder = tmp_path_factory.mktemp("people")

    def verify(name):
        report = folder / f"{name}.json"
        _status, output = lab.play("playbooks/verify.yml", variables={"verify_report": str(report)})
        return json.loads(report.read_text()), output

    try:
        for name, (host, starter, wrong, _part) in NODES.items():
            lab.run(host, people_nodes.start(f"fault_{name}", starter, wrong), check=False)
        first = verify("with")
    finally:
        for name, (host, _starter, wrong, _part) in NODES.items():
            lab.run(host, people_nodes.stop(f"fault_{name}", wrong), check=False)
    return first, verify("without")


def _describe(document):
    return "\n".join(
        f"{one['kind']} {one['mode']} {one['place']} ({one['verdict']}, {one['sure']}): {one['sentence']}\n    {one['remedy']}"
        for one in document["findings"]
    )


def test_each_node_is_told_with_its_computer_and_its_fault(told):
    document, output = told[0]
    print(_describe(document), *(json.dumps(row) for row in document["nodes"]["odd"]), sep="\n")
    found = {(one["kind"], one["mode"], one["place"]) for one in document["findings"]}
    missing = {name: part for name, (*_words, part) in NODES.items() if part not in found}
    assert not missing, output
    texts = "\n".join(one["sentence"] for one in document["findings"])
    assert not [name for name in NODES if f"fault_{name}" not in texts], texts


def test_what_has_started_a_node_is_told(told):
    rows = {row["node"].rpartition("fault_")[2]: row["started_by"] for row in told[0][0]["nodes"]["odd"]}
    print(rows)
    for name in ("loopback", "launched", "boxed", "bridged", "docker", "foreign", "copied"):
        assert rows[name].startswith(NODES[name][1]), rows


def test_nothing_else_is_found_and_nothing_stays(told):
    (document, _output), (after, output) = told
    expected = {(kind, place) for *_words, (kind, _mode, place) in NODES.values()}
    other = [one for one in document["findings"] if (one["kind"], one["place"]) not in expected]
    print(_describe({"findings": other}))
    assert not document["unexplained"] and not other
    assert not after["findings"], output
