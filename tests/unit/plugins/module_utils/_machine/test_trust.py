# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Ownership decides: real folders of several users, and the variables that a set-up file may give to whom."""

import os
import pathlib
import pwd
import shutil
import tempfile
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import ros, trust

NOBODY = pwd.getpwnam("nobody")
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file to somebody else")


@pytest.fixture(name="tree")
def fixture_tree():
    """A folder that root alone can change: below /tmp, which has the sticky bit."""
    folder = pathlib.Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    (folder / "ws/devel").mkdir(parents=True)
    (folder / "ws/devel/setup.sh").write_text("export ROS_DISTRO=noetic\n")
    yield folder
    shutil.rmtree(folder)


def words(path):
    return [doubt.words for doubt in trust.doubts(str(path))]


@as_root
def test_what_root_alone_can_change_raises_no_doubt(tree):
    assert words(tree / "ws/devel/setup.sh") == []
    assert words(tree / "ws/missing/entry") == []
    assert words("/usr/bin") == words("/") == []


@as_root
@pytest.mark.parametrize("part", ["", "ws", "ws/devel", "ws/devel/setup.sh"])
def test_each_folder_on_the_way_counts(tree, part):
    os.chown(tree / part, NOBODY.pw_uid, NOBODY.pw_gid)
    assert words(tree / "ws/devel/setup.sh") == [f"{tree / part} belongs to nobody".replace("/ ", " ")]


@as_root
def test_what_is_not_there_is_in_the_hands_of_its_folder(tree):
    (tree / "ws").chmod(0o1777)
    assert words(tree / "ws/missing/entry") == [f"{tree}/ws can be written by everybody"]
    assert words("/tmp/nobody-has-this/x") == ["/tmp can be written by everybody"]
    assert words(tree / "ws/devel") == []  # the sticky bit: nobody can replace it


@as_root
def test_the_right_to_write_of_a_group_counts_if_somebody_is_in_it(tree):
    (tree / "ws").chmod(0o775)
    assert words(tree / "ws/devel") == []  # root's own group
    os.chown(tree / "ws", 0, NOBODY.pw_gid)
    assert words(tree / "ws/devel") == [f"{tree}/ws can be written by a group"]


@as_root
def test_links_are_followed(tree):
    (tree / "theirs").mkdir()
    os.chown(tree / "theirs", NOBODY.pw_uid, NOBODY.pw_gid)
    (tree / "link").symlink_to("theirs/x")
    (tree / "around").symlink_to("around")
    assert words(tree / "link/setup.sh") == [f"{tree}/theirs belongs to nobody"]
    assert words(tree / "ws/../theirs") == [f"{tree}/theirs belongs to nobody"]
    assert words(tree / "around/x") == []  # root's own loop leads nowhere


@as_root
def test_a_look_has_a_limit_of_parts(tree):
    look = trust.Look(most=100)
    found = [doubt for number in range(200) for doubt in look.doubts(f"{tree}/{number}/x")]
    assert {doubt.who for doubt in found} == {trust.EVERYBODY}
    assert found[0].words == "its paths have more than 100 parts, so it is not known who can change them"


@as_root
def test_a_look_has_a_limit_of_time(tree):
    """A chain of links, each with 2,000 parts, again and again."""
    for number in range(40):
        (tree / f"l{number}").symlink_to("./" * 1900 + f"l{number + 1}")
    look = trust.Look(limit=0.5)
    began = time.monotonic()
    found = [doubt for _time in range(1000) for doubt in look.doubts(f"{tree}/l0/x")]
    assert time.monotonic() - began < 5
    assert set(found) == {
        trust.Doubt(
            trust.EVERYBODY, "a look at its paths takes more than 0.5 s, so it is not known who can change them"
        )
    }


@as_root
def test_a_set_up_with_ten_thousand_folders_is_no_code_for_the_services(tree):
    found = reach(tree, PATH=":".join(f"/{number}" for number in range(trust.MOST + 1)))
    assert (found.for_root, found.person) == ({}, "")
    assert found.refusal == "its paths have more than 10000 parts, so it is not known who can change them"


def test_names_of_variables():
    found = trust.sort(
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
    assert trust.paths(values) == ["///etc/x", "/x", "/y/z"]
    assert trust.paths({"A": "//home/x", "B": "/a://home/y"}) == ["//home/x", "//home/y", "/a"]


@pytest.mark.parametrize(
    "entry", ["/opt/x;/home/y", "/$ORIGIN/../../home/y", '/opt/x" LD_PRELOAD=/home/y.so "', "/opt/x\\"]
)
def test_entries_that_others_read_as_another_folder_are_left_out(entry):
    found = trust.sort({"LD_LIBRARY_PATH": f"/opt/lib:{entry}"})
    assert found.usable == found.of_root == {"LD_LIBRARY_PATH": "/opt/lib"}
    assert found.left_out == [f"LD_LIBRARY_PATH ({entry})"]


def reach(tree, **variables):
    return trust.reach(str(tree / "ws/devel/setup.sh"), trust.sort(variables))


@as_root
def test_roots_own_set_up_reaches_root(tree):
    found = reach(tree, PATH=f"{tree}/ws/bin", ROS_DISTRO="noetic", MODEL="burger", ROS_HOME="/tmp")
    assert found == ({"PATH": f"{tree}/ws/bin", "ROS_DISTRO": "noetic"}, "*", "", "")


@as_root
@pytest.mark.parametrize(
    "value", ["../home/x.conf", "x.conf", "//tmp/x.conf", "/usr/x:y/z", 'a" LD_PRELOAD=/tmp/x.so "', "a\\"]
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
def test_roots_file_that_names_a_persons_folder_is_not_roots_alone(tree):
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
