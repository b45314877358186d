# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The parts: their keys, and the environment of services."""

from ansible_collections.rosfleet.multimaster.plugins.module_utils._client.ros import Ros
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe import parts


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
