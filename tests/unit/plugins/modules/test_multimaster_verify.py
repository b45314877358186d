# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The options of multimaster_verify: what is wrong is said before anything is sent, in check mode, too."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.modules import multimaster_verify

MEMBER = {
    "name": "kobuki1computer",
    "address": "192.168.1.229",
    "discovery_address": "",
    "network": "",
}
MASTER = {"computer": "kobuki2computer", "address": "192.168.1.239", "rpc_port": 11611}


def params(**changed):
    found = {
        "run": "x",
        "patience": 20,
        "lifetime": 300,
        "seconds": 0.5,
        "name": "kobuki1computer",
        "is_router": False,
        "port": 11511,
    }
    return {**found, "members": [MEMBER], "masters": [MASTER], **changed}


@pytest.mark.parametrize(
    "good",
    [
        {},
        {"members": None, "masters": None},
        {"members": [{**MEMBER, "discovery_address": "10.0.0.1", "network": "192.168.1.0/24"}]},
        {"port": 65535},
    ],
)
def test_usual_options_are_right(good):
    assert multimaster_verify.find_wrong_option(params(**good)) is None


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ({"members": [{**MEMBER, "address": "x"}]}, "members: the address of kobuki1computer is 'x', expected an IPv4"),
        ({"members": [{**MEMBER, "discovery_address": "::1"}]}, "the discovery_address of kobuki1computer is '::1'"),
        (
            {"members": [{**MEMBER, "network": "192.168.1.1"}]},
            "the network of kobuki1computer is '192.168.1.1', expected a",
        ),
        ({"members": [{**MEMBER, "network": "192.168.1.1/24"}]}, "the network of kobuki1computer"),
        ({"masters": [{**MASTER, "address": "300.1.1.1"}]}, "masters: the address of kobuki2computer is '300.1.1.1'"),
        ({"masters": [{**MASTER, "rpc_port": 0}]}, "masters: the rpc_port of kobuki2computer is 0, expected a port"),
        ({"port": 0}, "port is 0, expected a port from 1 to 65535"),
        ({"port": 65536}, "port is 65536"),
        ({"seconds": 3.0}, "seconds is 3.0, expected 0.1 to 2 seconds"),
    ],
)
def test_an_address_or_a_port_that_is_none_is_a_sentence(bad, words):
    assert words in multimaster_verify.find_wrong_option(params(**bad))


def test_check_mode_refuses_the_same():
    """As Ansible runs it: a program of its own."""
    arguments = {
        "state": "collected",
        "name": "kobuki1computer",
        "members": [{"name": "kobuki1computer", "address": "x"}],
        "masters": [],
        "port": 0,
        "_ansible_check_mode": True,
    }
    done = subprocess.run(
        [sys.executable, str(Path(multimaster_verify.__file__))],
        input=json.dumps({"ANSIBLE_MODULE_ARGS": arguments}),
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        capture_output=True,
        text=True,
        check=False,
    )
    result = json.loads(done.stdout)
    assert result["failed"] and "the address of kobuki1computer is 'x'" in result["msg"]


def test_a_variable_that_the_file_has_lost_is_still_wanted(tmp_path):
    file = tmp_path / "environment"
    file.write_text("ROS_MASTER_URI=http://one:11311\nROS_PACKAGE_PATH=/opt\n")
    ros = multimaster_verify.Ros(str(file), {})
    wanted = multimaster_verify.environment(params(variables={"ROS_HOSTNAME": "one"}), ros)
    assert wanted["ROS_HOSTNAME"] == "one" and wanted["ROS_MASTER_URI"] == "http://one:11311"


def test_no_result_has_the_name_of_one_that_every_module_has():
    """`changed` and the like are Ansible's own."""
    common = {"changed", "failed", "msg", "skipped", "diff", "warnings", "deprecations", "invocation", "exception"}
    names = {part.name for part in multimaster_verify.PARTS}
    assert names and not names & common


CHOSEN = {"chosen": {"environment": {"PATH": "/opt/ros/noetic/bin", "ROS_HOSTNAME": "old"}}}


@pytest.mark.parametrize(
    "machine, found",
    [
        (None, {"ROS_HOSTNAME": "given"}),
        ({"owned": [], "ros": CHOSEN}, {"PATH": "/opt/ros/noetic/bin", "ROS_HOSTNAME": "one"}),
        ({"owned": ["routes"], "ros": CHOSEN}, {}),
        ({"owned": [], "ros": {"chosen": None}}, {}),
        ({"owned": []}, {}),
    ],
)
def test_the_variables_of_a_machine_that_somebody_set_up_by_hand(machine, found):
    options = params(variables={"ROS_HOSTNAME": "one"}, environment={"ROS_HOSTNAME": "given"})
    assert multimaster_verify.choose_environment(options, machine) == found


def test_the_options_of_another_module_are_checked_as_there():
    with pytest.raises(Problem, match=r"^look: .*parts.*\.$"):
        multimaster_verify.look_at_machine(params(look={"parts": ["engine"]}))
    with pytest.raises(Problem, match=r"^look: The option ports has 0; expected numbers from 1 to 65535\.$"):
        multimaster_verify.look_at_machine(params(look={"ports": [{"protocol": "tcp", "port": 0}]}))
    assert multimaster_verify.look_at_machine(params(look=None)) is None
    assert multimaster_verify.group(params(multicast={"name": "one"}), "started") == {
        "failed": True,
        "msg": "multicast: state is started but all of the following are missing: interface_address, computers.",
    }
