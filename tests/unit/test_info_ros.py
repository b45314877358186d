# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Finding ROS: set-up files that are really sourced, by a user who may not read everything."""

import os
import pathlib
import shutil
import tempfile

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils import _ros

MODULE = "class Anything: pass\n"
pytestmark = pytest.mark.skipif(not os.path.exists(_ros.PYTHON), reason=f"there is no {_ros.PYTHON}")


@pytest.fixture(name="opt")
def fixture_opt():
    """A folder like /opt/ros that others may read, unlike pytest's own."""
    folder = pathlib.Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder)


def prefix(folder, distro="noetic", modules=_ros.MODULES, more=""):
    """A prefix with importable modules and commands."""
    here = folder / distro
    for module in modules:
        (here / "python" / module).mkdir(parents=True)
        (here / "python" / module / "__init__.py").write_text(MODULE)
    (here / "bin").mkdir(parents=True)
    (here / "bin/roscore").write_text("#!/bin/sh\n")
    (here / "bin/roscore").chmod(0o755)
    (here / "etc/catkin/profile.d").mkdir(parents=True)
    (here / "setup.sh").write_text(
        f"echo sourced as $(id -un)\nexport PATH={here}/bin:$PATH PYTHONPATH={here}/python ROS_DISTRO={distro}\n"
        f"export ROS_VERSION=1 CMAKE_PREFIX_PATH={here}\n{more}\n"
    )
    return here


def find(opt, choice="auto", debian="/nowhere"):
    return _ros.find(choice, root=str(opt), debian=debian)


def test_the_only_prefix_is_chosen_and_examined(opt):
    here = prefix(opt)
    found = find(opt)
    assert found["problem"] == ""
    assert found["chosen"] == {
        "kind": "prefix",
        "setup": f"{here}/setup.sh",
        "distro": "noetic",
        "version": "1",
        "python": "/usr/bin/python3",
        "python_version": found["chosen"]["python_version"],
        "environment": {
            "CMAKE_PREFIX_PATH": str(here),
            "PATH": f"{here}/bin",
            "PYTHONPATH": f"{here}/python",
            "ROS_DISTRO": "noetic",
            "ROS_VERSION": "1",
        },
        "rospy": True,
        "missing": [],
        "commands": {"roscore": f"{here}/bin/roscore", "rostopic": "", "rosservice": ""},
        "hooks": f"{here}/etc/catkin/profile.d",
        "problem": "",
    }
    assert found["chosen"]["python_version"].startswith("3.")


def test_bash_where_there_is_a_file_for_it(opt):
    here = prefix(opt)
    (here / "setup.bash").write_text(f'export BY="${{BASH_VERSION:+bash}}"\n. {here}/setup.sh\n')
    chosen = find(opt)["chosen"]
    assert (chosen["setup"], chosen["environment"]["BY"]) == (f"{here}/setup.bash", "bash")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_a_set_up_file_is_no_code_for_root(opt):
    prefix(opt, more="export WHO=$(id -un)")
    assert find(opt)["chosen"]["environment"]["WHO"] == "nobody"


@pytest.mark.skipif(os.geteuid() != 0, reason="root only can be stopped by nobody's rights")
@pytest.mark.parametrize("what", ["", "setup.sh", "python"])
def test_a_closed_folder_or_file_is_named(opt, what):
    here = prefix(opt)
    os.chmod(here / what, 0o640)
    problem = find(opt)["problem"]
    assert str(here / what).rstrip("/") + " (mode 0640) is closed" in problem
    assert f"chmod o+{'r' if what == 'setup.sh' else 'x'} " in problem


def test_several_prefixes_ask_for_a_choice(opt):
    first, second = prefix(opt, "melodic"), prefix(opt, "noetic")
    found = find(opt)
    assert (found["chosen"], len(found["found"])) == (None, 2)
    assert f"({first}/setup.sh, {second}/setup.sh)" in found["problem"]
    assert "multimaster_ros_setup" in found["problem"]
    assert find(opt, str(second))["chosen"]["distro"] == "noetic"


def test_ros_2_beside_ros_1_is_no_choice(opt):
    prefix(opt, "foxy", more="export ROS_VERSION=2")
    assert "only ROS 2" in find(opt)["problem"]
    prefix(opt, "noetic")
    assert find(opt)["chosen"]["distro"] == "noetic"


def test_a_prefix_is_preferred_to_debians_packages(opt):
    debian = opt / "dist-packages/rospy"
    debian.mkdir(parents=True)
    assert find(opt, debian=str(debian))["chosen"]["kind"] == "debian"
    prefix(opt)
    found = find(opt, debian=str(debian))
    assert [record["kind"] for record in found["found"]] == ["prefix", "debian"]
    assert found["chosen"]["kind"] == "prefix"


def test_nothing_there(opt):
    assert f"neither {opt}/<distro>/setup.sh nor Debian's python3-rospy" in find(opt)["problem"]
    assert "multimaster_ros_setup is debian, but /nowhere is not there" in find(opt, "debian")["problem"]
    assert f"multimaster_ros_setup is {opt}/ws, but that is neither" in find(opt, f"{opt}/ws")["problem"]


def test_a_workspace_by_its_folder(opt):
    here = prefix(opt)
    (opt / "my ws/devel").mkdir(parents=True)
    (opt / "my ws/devel/setup.bash").write_text(f". {here}/setup.sh\nexport ROS_PACKAGE_PATH='{opt}/my ws/src'\n")
    chosen = find(opt, f"{opt}/my ws")["chosen"]
    assert (chosen["kind"], chosen["distro"], chosen["rospy"]) == ("workspace", "noetic", True)
    assert chosen["environment"]["ROS_PACKAGE_PATH"] == f"{opt}/my ws/src"


def test_missing_modules_are_named(opt, monkeypatch):
    monkeypatch.setattr(_ros, "MODULES", ("rospy", "no_such_msgs", "no_such_srvs"))
    prefix(opt, modules=("rospy",))
    found = find(opt)
    assert (found["chosen"]["rospy"], found["chosen"]["missing"]) == (True, ["no_such_msgs", "no_such_srvs"])
    assert "cannot import no_such_msgs, no_such_srvs out of" in found["problem"]


@pytest.mark.parametrize(
    "more", ["export ROS_PYTHON_VERSION=2", "export PYTHONPATH=/opt/ros/melodic/lib/python2.7/dist-packages"]
)
def test_python_2_is_told(opt, more):
    prefix(opt, more=more)
    found = find(opt)
    assert found["chosen"]["rospy"] is False
    assert "is made for Python 2, but the bundled nodes need Python 3.8 or later" in found["problem"]


@pytest.mark.parametrize(("more", "said"), [("exit 3", "it says nothing."), ("echo no luck. >&2; exit 3", "no luck.")])
def test_a_set_up_file_that_ends_the_shell(opt, more, said):
    (opt / "setup.sh").write_text(more)
    expected = f"The set-up file {opt}/setup.sh, sourced by sh, sets no variables: {said}"
    assert find(opt, f"{opt}/setup.sh")["problem"] == expected


def test_a_set_up_file_that_hangs_is_ended(opt, monkeypatch):
    monkeypatch.setattr(_ros, "_SOURCING", 0.3)
    (opt / "setup.sh").write_text("sleep 7343\n")
    assert "gave no answer within 0.3 s" in find(opt, f"{opt}/setup.sh")["problem"]


def test_values_that_fit_into_no_file_are_left_out():
    output = b"ROS_NOTE=a\nb\0ROS_IP=1\0BASH_FUNC_x%%=() { :; }\0PATH=/x/bin:/usr/bin:/bin\0PYTHONPATH=/x::\0_=/x\0"
    assert _ros.added(output) == {"ROS_IP": "1", "PATH": "/x/bin", "PYTHONPATH": "/x"}
