# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The remedy for a node depends on its starter: shell, unit, launch file or container."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.fault import write_advices
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.preflight import MachineState
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    AnnouncedHost,
    NodeHost,
    SilentNode,
    UnregisteredNodes,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from fleets import TWO, diagnosed, update

USER = "runuser -u ann -- env XDG_RUNTIME_DIR=/run/user/$(id -u ann) systemctl --user"  # on systemd 245, too


def _remedy(**process):
    values = {"host": "127.0.0.1", "source": "ROS_IP", "unit": "session-4.scope", "ports": (41233,), "node": "base"}

    def change(seen):
        update(seen[TWO].probe, node_hosts=[NodeHost(**{**values, **process})])
        update(seen[TWO].probe.exchange, announced=[AnnouncedHost("/kobuki2/base", "127.0.0.1", 41233)])

    (finding,) = [entry for entry in diagnosed(change).findings if entry.component.kind == "node"]
    return write_advices(finding.do)


@pytest.mark.parametrize(
    ("process", "words"),
    [
        (
            {"starter": "shell"},
            [
                "end /kobuki2/base; then in the shell that",
                "(session-4.scope)",
                "start it there again",
                "unset ROS_IP; . /etc/profile.d/",
            ],
        ),
        (
            {"starter": "unit", "unit": "odom.service", "of_unit": True},
            [f"on {TWO}: mkdir", "UnsetEnvironment=ROS_IP", "systemctl restart odom.service"],
        ),
        (
            {"starter": "unit", "unit": "odom.service"},
            [
                f"take ROS_IP out of the script or command that odom.service starts on {TWO}",
                f"on {TWO}: systemctl restart odom.service",
            ],
        ),
        (
            {"starter": "unit", "unit": "odom.service", "person": "ann"},
            [
                f"take ROS_IP out of odom.service of ann on {TWO}, or",
                f"on {TWO}: {USER} daemon-reload; {USER} restart odom.service",
            ],
        ),
        (
            {"starter": "unit", "unit": "odom.service", "person": "ann", "source": "hostname", "of_unit": True},
            ["/etc/systemd/user/odom.service.d/rosfleet.conf; ", f"{USER} daemon-reload; {USER} restart odom.service"],
        ),
        (
            {"starter": "launch", "launch": "robot.launch"},
            ["take ROS_IP out of robot.launch", "end roslaunch; then in the shell or unit that starts roslaunch"],
        ),
        (
            {"starter": "container", "unit": "docker-77.scope"},
            ["end the container", "--network host", f"--env ROS_HOSTNAME={TWO}"],
        ),
        ({"starter": "shell", "source": "hostname"}, ["unset ROS_HOSTNAME ROS_IP; "]),
        (
            {"starter": "launch", "readable": False, "host": "", "source": "", "ports": ()},
            ["take ROS_HOSTNAME and ROS_IP out of the launch file", "which variable is wrong is unknown"],
        ),
        ({}, ["end the node; then in the shell, launch file, unit or container on", "start it again"]),
    ],
)
def test_the_remedy_is_for_what_has_started_the_node(process, words):
    remedy = _remedy(**process)
    assert [word for word in words if word not in remedy] == [], remedy


@pytest.mark.parametrize("argument", ["__master", "__ip", "__hostname"])
@pytest.mark.parametrize(
    ("process", "word"),
    [
        (
            {"starter": "shell"},
            "end {node}, take {argument}:=... out of the command line that starts it on {place} (session-4.scope), and start it again",
        ),
        (
            {"starter": "unit", "unit": "odom.service"},
            "out of the script or command that odom.service starts on {place}",
        ),
        ({"starter": "launch", "launch": "robot.launch"}, 'out of robot.launch on {place} (<node args="...">)'),
        ({"starter": "container", "unit": "docker-77.scope"}, "out of its command line"),
    ],
)
def test_an_argument_is_taken_out_of_the_command_line_that_has_it(argument, process, word):
    """No variable of a shell or unit has a say beside it."""
    values = {
        "host": TWO,
        "source": "ROS_HOSTNAME",
        "unit": "session-4.scope",
        "ports": (41233,),
        "node": "base",
        **process,
    }
    values.update({"master": "http://old-pc:11311/", "master_source": argument})
    if argument != "__master":
        values.update(host="127.0.0.1", source=argument, master="", master_source="")
    found = MachineState(set_by=dict.fromkeys(("ROS_MASTER_URI", "ROS_IP"), "/home/ann/.bashrc, line 2"))

    def change(seen):
        update(seen[TWO], found=found)
        update(seen[TWO].probe, node_hosts=[NodeHost(**values)])
        if argument != "__master":
            update(seen[TWO].probe.exchange, announced=[AnnouncedHost("/kobuki2/base", "127.0.0.1", 41233)])

    (finding,) = [entry for entry in diagnosed(change).findings if entry.component.kind == "node"]
    assert f"by {argument}" in finding.sentence() and "ROS_MASTER_URI" not in finding.sentence()
    remedy = write_advices(finding.do)
    node = "base" if argument == "__master" else "/kobuki2/base"
    assert f"take {argument}:=..." in remedy and word.format(node=node, place=TWO, argument=argument) in remedy
    assert "unset" not in remedy and ".bashrc" not in remedy


def test_the_line_that_sets_the_variable_is_named():
    found = MachineState(set_by={"ROS_IP": "/home/ann/robot_env.sh, line 2"})

    def change(seen):
        values = {"host": "127.0.0.1", "source": "ROS_IP", "ports": (41233,), "node": "base", "starter": "shell"}
        update(seen[TWO], found=found)
        update(seen[TWO].probe, node_hosts=[NodeHost(**values)])
        update(seen[TWO].probe.exchange, announced=[AnnouncedHost("/kobuki2/base", "127.0.0.1", 41233)])

    (finding,) = [entry for entry in diagnosed(change).findings if entry.component.kind == "node"]
    assert f"remove the line that sets ROS_IP on {TWO}: /home/ann/robot_env.sh, line 2" in write_advices(finding.do)


@pytest.mark.parametrize("unit", ["x;reboot.service", "$(reboot).service"])
def test_no_command_is_made_of_a_strange_unit(unit):
    assert "reboot" not in _remedy(starter="unit", unit=unit, of_unit=True)
    assert "restart" not in _remedy(starter="unit", unit=unit)


@pytest.mark.parametrize("person", ["x;reboot", "$(reboot)", "-x", "DOM\\\\ann", "1000"])
def test_no_command_is_made_of_a_strange_person(person):
    remedy = _remedy(starter="unit", unit="odom.service", person=person)
    assert "restart" not in remedy and "reboot" not in remedy and "its unit" in remedy


@pytest.mark.parametrize(
    ("starter", "word"),
    [("container", f"--network host --env ROS_MASTER_URI=http://{TWO}"), ("unit", "PrivateNetwork")],
)
def test_a_node_in_a_network_of_its_own_gets_that_of_the_computer(starter, word):
    def change(seen):
        process = NodeHost(TWO, "ROS_HOSTNAME", "odom.service", (41233,), "base", starter=starter, apart=True)
        update(seen[TWO].probe, node_hosts=[process])
        silence = SilentNode("/kobuki2/base", TWO, "Connection refused", Outcome.REFUSED, port=41233)
        update(seen[TWO].probe.exchange, silent=["/kobuki2/base"], silences=[silence])

    (finding,) = diagnosed(change).findings
    assert (finding.component.kind, finding.component.mode) == ("node", "network")
    assert word in write_advices(finding.do)


@pytest.mark.parametrize(
    ("process", "words"),
    [
        ({"starter": "shell"}, [f"on {TWO}: kill 2314", "(session-4.scope)", "in a new login"]),
        ({"starter": "unit", "unit": "odom.service"}, [f"on {TWO}: systemctl restart odom.service"]),
        ({"starter": "unit", "unit": "odom.service", "person": "ann"}, ["systemctl --user restart odom.service"]),
        ({"starter": "unit", "unit": "$(reboot).service"}, ["a node registers only when it starts"]),
        ({"starter": "launch", "launch": "robot.launch"}, [f"end roslaunch with robot.launch on {TWO}"]),
        (
            {"starter": "container", "unit": "docker-77.scope"},
            [f"restart the container of base on {TWO} (docker-77.scope)"],
        ),
        ({"starter": "?"}, ["a node registers only when it starts"]),
    ],
)
def test_a_node_without_a_registration_is_started_again(process, words):
    values = {
        "host": TWO,
        "source": "ROS_HOSTNAME",
        "unit": "session-4.scope",
        "ports": (4,),
        "node": "base",
        "pid": 2314,
    }
    nodes = UnregisteredNodes((NodeHost(**{**values, **process}),), 1, 1)
    (finding,) = diagnosed(lambda seen: update(seen[TWO].probe, unregistered=nodes)).findings
    remedy = write_advices(finding.do)
    assert [word for word in words if word not in remedy] == [], remedy
