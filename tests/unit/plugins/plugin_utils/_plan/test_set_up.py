# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Sentences about a set-up file that root may not trust."""

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import set_up
from mentioned import mentions

SETUP = "/home/robot/ws/devel/setup.bash"
ALL = {"PATH": "/home/robot/ws/bin", "MODEL": "burger"}


def said(shells="all", **changes):
    chosen = {"setup": SETUP, "environment": ALL, "for_root": ALL, "person": "*", "doubt": "", "left_out": []}
    found = list(set_up.list_warnings("kobuki1computer", {**chosen, **changes}, shells))
    assert all(text.startswith("kobuki1computer: ") and "; expected " in text for text in found)
    return found


def test_what_is_roots_needs_no_words():
    assert said() == []
    assert not list(set_up.list_warnings("kobuki1computer", {"setup": ""}))


def test_a_persons_workspace():
    (text,) = said(for_root={}, person="robot", doubt="/home/robot belongs to robot")
    assert mentions(text, "root", SETUP, "/home/robot belongs to robot")
    assert 'the services and the user "robot" get them' in text
    assert "root and other users get the collection's own only" in text
    below = "/opt/ros/noetic/setup.bash"
    (text,) = said(for_root={"PATH": "/opt/bin"}, person="robot", doubt="/home/robot belongs to robot", below=below)
    assert f"root and other users get those of {below}." in text
    (text,) = said(for_root={}, person="", doubt="/home can be written by a group")
    assert mentions(text, "root", "own")


def test_no_hook():
    (text,) = said(hooks_doubt="below /home/robot/ws/devel, since /home/robot belongs to robot")
    assert mentions(text, "below /home/robot/ws/devel, since /home/robot belongs to robot", "catkin")


def test_who_is_to_get_less_misses_nothing():
    parts = {"for_root": {}, "person": "robot", "doubt": "/home/robot belongs to robot", "hooks_doubt": "below /home"}
    assert [len(said(shells, **parts)) for shells in ("all", "names", "none")] == [2, 1, 0]
    assert len(said("none", left_out=["LD_PRELOAD"])) == 1, "services have no such variable either"


def test_names():
    (text,) = said(for_root={"PATH": "/opt/bin"})
    assert 'sets "MODEL", which root does not get' in text
    (text,) = said(left_out=["LD_PRELOAD", "PATH (./bin)"])
    assert 'sets LD_PRELOAD, "PATH (./bin)", which nobody gets' in text


def test_what_moves_nodes_is_told_in_one_line():
    moving = {"ROS_NAMESPACE": "robot1", "ROS_LOG_DIR": "/home/robot/logs"}
    (text,) = said(environment=moving, for_root=moving)
    assert mentions(text, "ROS_NAMESPACE, ROS_LOG_DIR", "persons")
