# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The parts: their keys, and the environment of services."""

import json

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.fields import find_struct
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.verify import Probe
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe import parts
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.facts import machine
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client.ros import Ros
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io.answer import check_answer
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io.robot_action import answer_of


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


@pytest.mark.parametrize("part", parts.PARTS, ids=lambda part: part.name)
def test_a_part_that_cannot_be_read_has_all_its_keys(part):
    if isinstance(part.default, dict):
        assert set(part.default) == set(find_struct(Probe.FIELDS[part.name].kind).FIELDS)


@pytest.mark.parametrize("part", machine.PARTS, ids=lambda part: part.name)
def test_a_part_of_a_machine_that_cannot_be_read_is_as_the_contract_has_it(part):
    answer = {"problems": [], **machine.empty(part.name)}
    taken = check_answer(json.dumps(answer), answer_of("multimaster_info"))
    assert (taken.result, taken.left_out) == (answer, [])
