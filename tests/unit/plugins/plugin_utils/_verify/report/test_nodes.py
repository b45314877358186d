# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The nodes of people in the report: a number where all is well, a row for each with which something is wrong."""

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.diagnosis import Diagnosis
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    AnnouncedHost,
    HostOfNodes,
    NodeCount,
    NodeHost,
    SilentNode,
    UnregisteredNodes,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.nodes import (
    describe_nodes,
    list_nodes,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.summary import summarise
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.terminal import render
from fleets import ONE, TWO, observed, plan, topic, update
from mentioned import mentions


def _count(seen, numbers=(4, 3), asked=None):
    for computer, number in zip((ONE, TWO), numbers, strict=True):
        hosts = [HostOfNodes(computer, number)]
        update(seen[computer].probe.exchange, nodes=NodeCount(number, asked or number, hosts))


def _list(*changes):
    fleet = plan()
    seen = observed(fleet)
    for change in (_count, *changes):
        change(seen)
    return list_nodes(fleet, seen)


def _break(seen):
    process = NodeHost("127.0.0.1", "ROS_IP", "session-4.scope", (41233,), "odom", starter="shell")
    silence = SilentNode("/camera", TWO, "timed out", Outcome.NO_ANSWER, Outcome.OPEN)
    update(seen[TWO].probe, node_hosts=[process])
    update(
        seen[TWO].probe.exchange,
        announced=[AnnouncedHost("/odom", "127.0.0.1", 41233)],
        silent=[silence.node],
        silences=[silence],
    )


def _print(nodes):
    return render(summarise([], [], 0), Diagnosis(), everything=False, nodes=nodes).split("\n\n")[1]


def test_where_all_is_well_there_is_a_number():
    nodes = _list()
    assert nodes["odd"] == [] and [entry["computers"] for entry in nodes["roscores"]] == [{ONE: 4}, {TWO: 3}]
    assert mentions(_print(nodes), "7", "kobuki1 4", "kobuki2 3", "all answer")


def test_each_node_with_which_something_is_wrong_has_a_row():
    lines = _print(_list(_break)).splitlines()
    assert lines[0].endswith("something is wrong with 2 of them:")
    assert "127.0.0.1 (ROS_IP)" in lines[2] and "shell: session-4.scope" in lines[2] and TWO in lines[2]
    assert "/camera" in lines[3] and "no: it hangs" in lines[3]


def test_a_sample_is_said():
    assert "10 of them were asked, which is a sample" in describe_nodes(
        _list(lambda seen: _count(seen, (3000, 2000), 5))
    )


def test_where_no_roscore_was_read_nothing_is_said():
    assert describe_nodes({"roscores": [], "odd": [], "left_out": 0}) == ""


def test_thousands_of_odd_nodes_fit_into_the_terminal():
    def change(seen):
        announced = [AnnouncedHost(f"/{number}/{'x' * 200}", "127.0.0.1", number) for number in range(900)]
        update(seen[TWO].probe.exchange, announced=announced)

    lines = _print(_list(change)).splitlines()
    assert len(lines) < 30 and max(map(len, lines)) <= 160 and lines[-1].startswith("  and 880 more")


def _end(seen):
    """Only the collection's own nodes are left."""
    for computer in (ONE, TWO):
        update(seen[computer].probe.exchange, services=(), topics=[topic("/rosout", "rosgraph_msgs/Log", ["/rosout"])])


def test_that_no_node_is_of_a_person_is_said():
    assert mentions(describe_nodes(_list(_end)), "7", "all of the collection: no node of yours is registered")
    assert "of the collection" not in describe_nodes(_list())


def test_a_node_without_a_registration_has_a_row():
    def change(seen):
        process = NodeHost(TWO, "ROS_HOSTNAME", "driver.service", (4,), "driver.py", starter="unit", pid=7)
        update(seen[TWO].probe, unregistered=UnregisteredNodes((process,), 1, 1))

    nodes = _list(_end, change)
    assert describe_nodes(nodes).endswith("is registered; all answer; 1 more runs without a registration:")
    assert "all answer, at places of their robots; 1 more runs without" in describe_nodes(_list(change))
    row = _print(nodes).splitlines()[-1]
    assert mentions(row, "driver.py (process 7)", TWO, "unit: driver.service", "none", "yes")
