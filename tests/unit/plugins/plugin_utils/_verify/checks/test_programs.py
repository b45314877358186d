# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of what programs have: their parameters, and room to write."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import FAILED, WARNING
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.programs import find_full
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    ContainerNames,
    Disk,
    FileLimit,
    FullProcess,
    NodeParameters,
    ParameterDifference,
    Probe,
    RegisteredTopic,
    SilentNode,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from fleets import ONE, TWO, assert_told, components, diagnosed, evaluate, notable, of, update

BOTH = ("master_discovery", "master_sync")


def _differs(node, name, found):
    differing = (ParameterDifference(node, name, "planned", found),)
    return lambda seen: update(seen[ONE].probe, parameters=NodeParameters(BOTH, differing))


def _disk(*free):
    return lambda seen: update(seen[TWO].probe, disks=(Disk("/var/lib", 10**9, 10**6), Disk("/var/log", *free)))


def _limit(unit, person=""):
    return lambda seen: update(seen[ONE].probe, file_limits=(FileLimit("/amcl", 1073741816, unit, person),))


def _full(unit="robot.service"):
    return lambda seen: update(seen[ONE].probe, full_processes=(FullProcess("rosbridge", 4711, unit, 1024, 1024),))


def _old_container(seen):
    return update(seen[ONE].probe, container_names=(ContainerNames("rosmaster", "docker-0badcafe.scope", (TWO,)),))


FAULTS = [
    (_differs("master_discovery", "mcast_group", "239.1.2.3"), "parameters", FAILED, "discovery", ONE, "group"),
    (_differs("master_discovery", "mcast_port", "11512"), "parameters", FAILED, "discovery", ONE, "group"),
    (_differs("master_discovery", "rpc_port", "11612"), "parameters", FAILED, "discovery", ONE, "port"),
    (_differs("master_discovery", "interface", "192.168.7.7"), "parameters", FAILED, "interface", ONE, "multicast"),
    (_differs("master_discovery", "exports", "[]"), "parameters", FAILED, "discovery", ONE, "configuration"),
    (_differs("master_sync", "ignore_topics", "[]"), "parameters", FAILED, "sync", ONE, "configuration"),
    (_disk(0, 10**6), "room", FAILED, "computer", TWO, "disk"),
    (_disk(10**9, 0), "room", FAILED, "computer", TWO, "disk"),
    (_limit("robot.service"), "file_limits", WARNING, "limit", ONE, "unit"),
    (_limit(""), "file_limits", WARNING, "limit", ONE, "shell"),
    (_full(), "open_files", WARNING, "program", ONE, "full"),
    (_old_container, "container_names", WARNING, "container", ONE, "names"),
]


@pytest.mark.parametrize(("change", "check", "verdict", "kind", "place", "mode"), FAULTS)
def test_each_fault_is_named(change, check, verdict, kind, place, mode):
    assert_told(change, check, verdict, kind, place, mode)


def test_the_finding_says_which_parameter_and_which_disk():
    (group,) = diagnosed(_differs("master_discovery", "mcast_group", "239.1.2.3")).findings
    assert group.proof[0].found == "mcast_group of master_discovery is 239.1.2.3"
    (disk,) = diagnosed(_disk(0, 10**6)).findings
    assert "/var/log" in disk.sentence()
    (old,) = diagnosed(_old_container).findings
    assert f"docker-0badcafe.scope lacks {TWO}" in old.sentence()


def test_the_finding_names_the_process_that_has_all_of_its_files_open():
    (full,) = diagnosed(_full()).findings
    assert full.component.what == "rosbridge (PID 4711) has 1024 of 1024 files open"
    assert full.component.what in full.sentence()
    assert not notable(evaluate(_full("multimaster-roscore.service")))  # the check of services says that


def _full_and_silent(node):
    def seen_so(seen):
        _full()(seen)
        silence = SilentNode(node, ONE, "timed out", Outcome.NO_ANSWER, Outcome.OPEN)
        update(seen[ONE].probe.exchange, silent=(node,), silences=(silence,))

    return diagnosed(seen_so).findings


@pytest.mark.parametrize("node", ["/rosbridge", "/kobuki1/rosbridge", "/rosbridge_4711_1700000000000"])
def test_a_node_that_hangs_since_its_files_are_open_is_no_finding_of_its_own(node):
    (full,) = _full_and_silent(node)
    assert (full.component.kind, full.component.mode) == ("program", "full")
    assert {row.check for row in (*full.rows, *full.proof)} == {"open_files", "nodes_answer"}


def test_what_another_program_has_open_explains_nothing_else():
    """A dead sync node and a hung node were told as consequences of a web server without a free file."""
    assert {entry.component[:3] for entry in _full_and_silent("/amcl")} == {
        ("program", ONE, "full"),
        ("node", ONE, "hung"),
    }

    def seen_so(seen):
        _full("nginx.service")(seen)
        services = seen[ONE].probe.services
        (sync,) = [one for one in services if one.unit == "multimaster-sync.service"]
        update(sync, active_state="inactive", sub_state="dead")

    assert {entry.component[:3] for entry in diagnosed(seen_so).findings} == {
        ("program", ONE, "full"),
        ("sync", ONE, "dead"),
    }


def test_a_strange_node_is_told_and_costs_nobody_the_report():
    found = diagnosed(_differs("/strange_node", "mcast_group", "239.1.2.3"))
    (row,) = found.unexplained or found.findings[0].rows
    assert row.check == "parameters" and row.found == "mcast_group of /strange_node is 239.1.2.3"


def test_files_that_are_not_counted_are_enough():
    assert not notable(evaluate(_disk(10**9, None)))


def test_the_one_with_a_foreign_group_is_named():
    """Without its parameters, each of the two might be the one."""

    def apart(seen):
        for one, other in ((ONE, TWO), (TWO, ONE)):
            listed = seen[one].probe.list_masters
            update(listed, masters=tuple(entry for entry in listed.masters if other not in entry.name))
        _differs("master_discovery", "mcast_group", "239.1.2.3")(seen)

    (found,) = diagnosed(apart).findings
    assert found.component[:3] == ("discovery", ONE, "group") and not found.rivals and len(found.rows) == 2


def test_of_two_clocks_the_one_that_nothing_keeps_right_is_off():
    def off(seen):
        update(of(seen[ONE].probe.masters, TWO, "computer"), clock_offset_s=2.0)
        update(of(seen[TWO].probe.masters, ONE, "computer"), clock_offset_s=-2.0)
        update(seen[TWO].probe.clock, synchronised=False)

    found = diagnosed(off)
    assert components(found) == [("clock", TWO, "off")] and not found.findings[0].rivals


def test_a_unit_with_many_files_is_told_with_its_command():
    (found,) = diagnosed(_limit("robot.service")).findings
    assert found.commands[0].text.startswith("mkdir -p /etc/systemd/system/robot.service.d; ")
    assert found.commands[0].text.endswith("systemctl restart robot.service")
    (own,) = diagnosed(_limit("robot.service", "ann")).findings
    assert own.commands[0].text.startswith("mkdir -p /etc/systemd/user/robot.service.d; ")
    assert (
        own.commands[0].text.endswith("systemctl --user restart robot.service")
        and "runuser -u ann" in own.commands[0].text
    )
    (strange,) = diagnosed(_limit("../x.service")).findings
    assert not strange.commands


def _simulate(seen, *computers, clock=("/gazebo",)):
    for name in computers:
        probe = seen[name].probe
        topics = (*probe.exchange.topics, RegisteredTopic("/clock", "", clock))  # without a type, it does not cross
        update(probe.exchange, topics=topics if clock else probe.exchange.topics)
        update(probe, parameters=NodeParameters(BOTH, simulated=True))


def test_simulated_time_on_one_robot_alone_is_one_warning_with_both_names():
    told = diagnosed(lambda seen: _simulate(seen, ONE))
    assert components(told) == [("time", ONE, "simulated")]
    sentence = told.findings[0].sentence()
    assert ONE in sentence and "kobuki2" in sentence and "/gazebo" in sentence


def test_where_all_robots_are_simulated_all_is_well():
    assert not notable(evaluate(lambda seen: _simulate(seen, ONE, TWO)))


def test_a_clock_that_nobody_publishes_is_named():
    told = diagnosed(lambda seen: _simulate(seen, ONE, TWO, clock=()))
    assert {(component[0], component[2]) for component in components(told)} == {("time", "stopped")}


@pytest.mark.parametrize("name", ["camera", '"camera"', "camera.py", '"camera.py"'])
def test_a_full_process_is_that_of_its_node_also_with_its_name_in_quotes(name):
    probe = Probe(full_processes=(FullProcess(name, 4711, "robot.service", 1024, 1024),))
    assert {one.mode for one in find_full(probe, "/robot/camera_17_42", ONE)} == {"full"}
    assert not find_full(probe, "/robot/camera_front", ONE)
