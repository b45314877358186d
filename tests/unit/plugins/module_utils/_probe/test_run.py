# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The states: the variables of ROS, and the options of other modules."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe import parts, run

CHOSEN = {"chosen": {"environment": {"PATH": "/opt/ros/noetic/bin", "ROS_HOSTNAME": "old"}}}


@pytest.mark.parametrize(
    "machine, variables",
    [
        (None, {"ROS_HOSTNAME": "given"}),
        ({"owned": [], "ros": CHOSEN}, {"PATH": "/opt/ros/noetic/bin", "ROS_HOSTNAME": "one"}),
        ({"owned": ["routes"], "ros": CHOSEN}, {}),
        ({"owned": [], "ros": {"chosen": None}}, {}),
        ({"owned": []}, {}),
    ],
)
def test_the_variables_of_a_machine_that_somebody_set_up_by_hand(machine, variables):
    options = {"variables": {"ROS_HOSTNAME": "one"}, "environment": {"ROS_HOSTNAME": "given"}}
    assert run.choose_environment(options, machine) == variables


def test_the_options_of_another_module_are_checked_as_there():
    with pytest.raises(Problem, match=r"^look: .*parts.*\.$"):
        run.look_at_machine(dict(look={"parts": ["engine"]}))
    with pytest.raises(Problem, match=r"^look: The option ports has 0; expected numbers from 1 to 65535\.$"):
        run.look_at_machine(dict(look={"ports": [{"protocol": "tcp", "port": 0}]}))
    assert run.look_at_machine(dict(look=None)) is None
    assert parts.group(dict(multicast={"name": "one"}), "start") == {
        "failed": True,
        "msg": "multicast: action is start but all of the following are missing: interface_address, computers.",
    }
