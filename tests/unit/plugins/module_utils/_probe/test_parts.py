# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The parts: their keys, and the environment of services."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.fields import find_struct
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.machine import Machine
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.verify import Probe
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe import parts
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.facts import machine
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client.ros import Ros

EMPTY = {**{part.name: part.nothing for part in machine.PARTS if part.name != "system"}, **machine.NO_SYSTEM}


def test_a_variable_that_the_file_has_lost_is_still_wanted(tmp_path):
    file = tmp_path / "environment"
    file.write_text("ROS_MASTER_URI=http://one:11311\nROS_PACKAGE_PATH=/opt\n")
    ros = Ros(str(file), {})
    wanted = parts.environment({"variables": {"ROS_HOSTNAME": "one"}}, ros)
    assert wanted["ROS_HOSTNAME"] == "one" and wanted["ROS_MASTER_URI"] == "http://one:11311"


def test_no_result_has_the_name_of_one_that_every_module_has():
    """`changed` and the like are Ansible's own."""
    common = {"changed", "failed", "msg", "skipped", "diff", "warnings", "deprecations", "invocation", "exception"}
    names = {part.name for part in parts.PARTS}
    assert names and not names & common


@pytest.mark.parametrize("name", [part.name for part in parts.PARTS if isinstance(part.default, dict)])
def test_a_part_that_cannot_be_read_has_all_its_keys(name):
    (default,) = (part.default for part in parts.PARTS if part.name == name)
    assert set(default) == set(find_struct(Probe.FIELDS[name].kind).FIELDS)


@pytest.mark.parametrize("name", [name for name, value in EMPTY.items() if isinstance(value, dict)])
def test_a_part_of_a_machine_that_cannot_be_read_has_all_its_keys(name):
    assert set(EMPTY[name]) == set(find_struct(Machine.FIELDS[name].kind).FIELDS)
