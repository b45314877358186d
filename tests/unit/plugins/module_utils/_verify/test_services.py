# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The services of the collection: the environment of their processes."""

from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import services


def test_differing_names_what_the_process_lacks():
    process = {"ROS_MASTER_URI": "http://old:11311", "PATH": "/bin"}
    wanted = {"ROS_MASTER_URI": "http://new:11311", "ROS_HOSTNAME": "kobuki1computer", "PATH": "/bin"}
    assert services.differing(process, wanted) == ["ROS_HOSTNAME", "ROS_MASTER_URI"]
