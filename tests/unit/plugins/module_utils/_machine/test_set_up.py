# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The variables that a set-up file may give to whom: real folders of several users."""

import os
import pwd

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import trust
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import ros, set_up
from mentioned import mentions

NOBODY = pwd.getpwnam("nobody")
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file to somebody else")


def test_names_of_variables():
    found = set_up.sort(
        {
            "LD_PRELOAD": "/evil.so",
            "LD_AUDIT": "/evil.so",
            "BASH_ENV": "/evil",
            "ENV": "/evil",
            "PYTHONSTARTUP": "/evil",
            "PYTHONHOME": "/evil",
            "IFS": "x",
            "PROMPT_COMMAND": "id",
            "BASH_FUNC_ls%%": "() { id; }",
            "PATH": "bin:/opt/bin::.",
            "PYTHONPATH": "./lib",
            "LD_LIBRARY_PATH": "/opt/lib",
            "ROS_DISTRO": "noetic",
            "TURTLEBOT3_MODEL": "burger",
        }
    )
    assert found.usable == {
        "PATH": "/opt/bin",
        "LD_LIBRARY_PATH": "/opt/lib",
        "ROS_DISTRO": "noetic",
        "TURTLEBOT3_MODEL": "burger",
    }
    assert sorted(set(found.usable) - set(found.of_root)) == ["TURTLEBOT3_MODEL"]
    assert {"LD_PRELOAD", "BASH_ENV", "PATH (bin)", "PATH (.)", "PYTHONPATH (./lib)"} <= set(found.left_out)


def test_the_paths_in_values():
    values = {"A": "http://localhost:11311", "B": "/x:/y/z:w", "C": "file:///etc/x", "D": "no/path"}
    assert set_up.paths(values) == ["///etc/x", "/x", "/y/z"]
    assert set_up.paths({"A": "//home/x", "B": "/a://home/y"}) == ["//home/x", "//home/y", "/a"]


@pytest.mark.parametrize(
    "entry", ["/opt/x;/home/y", "/$ORIGIN/../../home/y", '/opt/x" LD_PRELOAD=/home/y.so "', "/opt/x\\"]
)
def test_entries_that_others_read_as_another_folder_are_left_out(entry):
    found = set_up.sort({"LD_LIBRARY_PATH": f"/opt/lib:{entry}"})
    assert found.usable == found.of_root == {"LD_LIBRARY_PATH": "/opt/lib"}
    assert found.left_out == [f"LD_LIBRARY_PATH ({entry})"]


def reach(tree, **variables):
    return set_up.reach(str(tree / "ws/devel/setup.sh"), set_up.sort(variables))


@pytest.mark.slow
@as_root
def test_a_set_up_of_ten_thousand_folders_is_no_service_code(tree):
    found = reach(tree, PATH=":".join(f"/{number}" for number in range(trust.MOST + 1)))
    assert (found.for_root, found.person) == ({}, "")
    assert mentions(found.refusal, "10000", "paths")


@as_root
def test_roots_own_set_up_reaches_root(tree):
    found = reach(tree, PATH=f"{tree}/ws/bin", ROS_DISTRO="noetic", MODEL="burger", ROS_HOME="/tmp")
    assert found == ({"PATH": f"{tree}/ws/bin", "ROS_DISTRO": "noetic"}, "*", "", "")


@as_root
@pytest.mark.parametrize(
    "value",
    ["../home/x.conf", "x.conf", "//tmp/rosfleet-missing.conf", "/usr/x:y/z", 'a" LD_PRELOAD=/tmp/x.so "', "a\\"],
)
def test_root_gets_no_value_that_means_what_others_can_change(tree, value):
    found = reach(tree, ROS_PYTHON_LOG_CONFIG_FILE=value, ROS_DISTRO="noetic", ROS_MASTER_URI="http://a-b:11311/")
    assert found.for_root == {"ROS_DISTRO": "noetic", "ROS_MASTER_URI": "http://a-b:11311/"}
    assert found.person == "*"


@as_root
def test_two_slashes_lead_to_a_persons_folder_too(tree):
    (tree / "theirs").mkdir()
    os.chown(tree / "theirs", NOBODY.pw_uid, NOBODY.pw_gid)
    assert reach(tree, PYTHONPATH=f"/{tree}/theirs")[:2] == ({}, "nobody")


@as_root
@pytest.mark.parametrize("theirs", ["ws/devel/setup.sh", "ws"])
def test_a_persons_set_up_reaches_the_person(tree, theirs):
    os.chown(tree / theirs, NOBODY.pw_uid, NOBODY.pw_gid)
    found = reach(tree, PATH=f"{tree}/ws/bin", ROS_DISTRO="noetic")
    assert (found.for_root, found.person, found.refusal) == ({}, "nobody", "")
    assert found.doubt == f"{tree / theirs} belongs to nobody"


@as_root
def test_a_file_that_names_a_persons_folder_is_not_roots_alone(tree):
    (tree / "theirs").mkdir()
    os.chown(tree / "theirs", NOBODY.pw_uid, NOBODY.pw_gid)
    assert reach(tree, PYTHONPATH=f"{tree}/theirs")[:2] == ({}, "nobody")
    os.chown(tree / "ws/devel/setup.sh", 1, 1)  # whose file it is decides
    assert reach(tree, PYTHONPATH=f"{tree}/theirs").person == pwd.getpwuid(1).pw_name
    os.chown(tree / "ws", NOBODY.pw_uid, 1)  # files of several people are nobody's
    assert reach(tree, PYTHONPATH=f"{tree}/theirs").person == ""


@as_root
@pytest.mark.parametrize("open_one", ["ws/devel/setup.sh", "ws", "lib"])
def test_what_everybody_can_change_is_no_code_even_for_services(tree, open_one):
    (tree / "lib").mkdir()
    (tree / open_one).chmod(0o777)
    assert reach(tree, PYTHONPATH=f"{tree}/lib").refusal == f"{tree / open_one} can be written by everybody"
    (tree / "ws/devel/setup.sh").write_text(f"export PYTHONPATH={tree}/lib\n")
    record = ros.examine("workspace", str(tree / "ws/devel/setup.sh"))
    assert record["environment"] == record["for_root"] == {} and record["rospy"] is False
    assert "is no code for the services, since" in record["problem"] and "chmod o-w" in record["problem"]
