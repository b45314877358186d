# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Finding ROS: set-up files that are really sourced, by a user who may not read everything."""

import json
import os
import pathlib
import shutil
import tempfile

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import fkie, ros
from mentioned import mentions

MODULE = "class Anything: pass\n"
pytestmark = pytest.mark.skipif(not os.path.exists(ros.PYTHON), reason=f"there is no {ros.PYTHON}")


@pytest.fixture(name="opt")
def fixture_opt():
    """A folder like /opt/ros that others may read, unlike pytest's own."""
    folder = pathlib.Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder)


def prefix(folder, distro="noetic", modules=ros.MODULES, more=""):
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
    return ros.find(choice, root=str(opt), debian=debian)


@pytest.mark.root
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
        "for_root": found["chosen"]["environment"],
        "below": "",
        "person": "*",
        "doubt": "",
        "left_out": [],
        "rospy": True,
        "missing": [],
        "commands": {"roscore": f"{here}/bin/roscore", "rostopic": "", "rosservice": ""},
        "hooks": f"{here}/etc/catkin/profile.d",
        "hooks_doubt": "",
        "nodes": [],
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


def workspace(opt, below, more=""):
    """A workspace of nobody's, built on a prefix."""
    here = opt / "ws"
    (here / "devel/etc/catkin/profile.d").mkdir(parents=True)
    (here / "devel/setup.sh").write_text(
        f". {below}/setup.sh\nexport CMAKE_PREFIX_PATH={here}/devel:$CMAKE_PREFIX_PATH PYTHONPATH={here}/python:$PYTHONPATH\n{more}\n"
    )
    for path in (here, *here.rglob("*")):
        shutil.chown(path, "nobody")
    return here / "devel"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file to somebody else")
def test_below_a_persons_workspace_is_roots_own_ros(opt):
    below = prefix(opt, more="export MODEL=burger ROS_ETC_DIR=$CMAKE_PREFIX_PATH/etc")
    chosen = find(opt, str(workspace(opt, below, more="export ROS_ETC_DIR=/etc")))["chosen"]
    assert (chosen["person"], chosen["below"]) == ("nobody", f"{below}/setup.sh")
    assert chosen["environment"]["PYTHONPATH"] == f"{opt}/ws/python:{below}/python"
    assert chosen["for_root"] == {
        "CMAKE_PREFIX_PATH": str(below),
        "PATH": f"{below}/bin",
        "PYTHONPATH": f"{below}/python",
        "ROS_DISTRO": "noetic",
        "ROS_ETC_DIR": f"{below}/etc",
        "ROS_VERSION": "1",
    }
    assert (chosen["hooks"], chosen["hooks_doubt"]) == (f"{below}/etc/catkin/profile.d", "")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file to somebody else")
@pytest.mark.parametrize("lie", ["not there", "not root's", "names a person's folder", "ROS 2"])
def test_a_workspace_cannot_name_anything_else_as_roots(opt, lie):
    below = prefix(
        opt,
        more={"names a person's folder": f"export PATH={opt}/ws/bin:$PATH", "ROS 2": "export ROS_VERSION=2"}.get(
            lie, ""
        ),
    )
    away = shutil.move(below, opt / "deeper/away") if lie == "not there" else below
    if lie == "not root's":
        shutil.chown(below, "nobody")
    chosen = find(opt, str(workspace(opt, away, more=f"export ROS_VERSION=1 CMAKE_PREFIX_PATH={opt}/ws/devel:{away}")))[
        "chosen"
    ]
    assert (chosen["for_root"], chosen["below"], chosen["person"]) == ({}, "", "nobody")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file to somebody else")
def test_a_folder_for_hooks_that_is_not_roots_is_named(opt):
    here = workspace(opt, opt / "nothing", more="true")
    assert ros.hooks({"CMAKE_PREFIX_PATH": f"relative:{here}"}) == (
        "",
        f"below {here}, since {opt}/ws belongs to nobody",
    )
    assert ros.hooks({}) == ("", "")


@pytest.mark.parametrize(("given", "seen"), [({}, "1"), ({"SOME_VERSION": "2"}, "2")])
def test_a_node_sees_the_variables_that_it_needs(opt, given, seen):
    """As fkie_mas sees ROS_VERSION, which Debian's ROS does not set."""
    package(opt / "src")
    (opt / "src/python/some_sync/sync.py").write_text("import os\nraise ValueError(os.environ['SOME_VERSION'])\n")
    problem = nodes(opt, ROS_PACKAGE_PATH=str(opt), **given)[1]
    assert problem == f"some_sync.sync cannot be imported: ValueError: {seen}"


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
    assert mentions(find(opt, "debian")["problem"], "multimaster_ros_setup", "/nowhere")
    assert mentions(find(opt, f"{opt}/ws")["problem"], "multimaster_ros_setup", f"{opt}/ws")


def test_a_workspace_by_its_folder(opt):
    here = prefix(opt)
    (opt / "my ws/devel").mkdir(parents=True)
    (opt / "my ws/devel/setup.bash").write_text(f". {here}/setup.sh\nexport ROS_PACKAGE_PATH='{opt}/my ws/src'\n")
    chosen = find(opt, f"{opt}/my ws")["chosen"]
    assert (chosen["kind"], chosen["distro"], chosen["rospy"]) == ("workspace", "noetic", True)
    assert chosen["environment"]["ROS_PACKAGE_PATH"] == f"{opt}/my ws/src"


def test_missing_modules_are_named(opt, monkeypatch):
    monkeypatch.setattr(ros, "MODULES", ("rospy", "no_such_msgs", "no_such_srvs"))
    prefix(opt, modules=("rospy",))
    found = find(opt)
    assert (found["chosen"]["rospy"], found["chosen"]["missing"]) == (True, ["no_such_msgs", "no_such_srvs"])
    assert "cannot import no_such_msgs, no_such_srvs out of" in found["problem"]


PYTHON_2 = ["export ROS_PYTHON_VERSION=2", "export PYTHONPATH=/opt/ros/melodic/lib/python2.7/dist-packages"]


@pytest.mark.parametrize("more", PYTHON_2)
def test_a_ros_for_python_2_needs_it(opt, more, monkeypatch):
    monkeypatch.setattr(ros, "PYTHON2", "/nowhere/python2.7")
    prefix(opt, more=more)
    found = find(opt)
    assert found["chosen"]["rospy"] is False
    assert mentions(found["problem"], "Python", "2", "/nowhere/python2.7")


@pytest.mark.parametrize("more", PYTHON_2)
def test_a_ros_for_python_2_is_examined_with_it(opt, more, monkeypatch):
    interpreter = opt / "python2.7"
    interpreter.write_text("""#!/bin/sh\necho '{"version": "2.7.17", "missing": []}'\n""")
    interpreter.chmod(0o755)
    monkeypatch.setattr(ros, "PYTHON2", str(interpreter))
    prefix(opt, more=more)
    chosen = find(opt)["chosen"]
    assert (chosen["python"], chosen["python_version"], chosen["rospy"]) == (str(interpreter), "2.7.17", True)
    assert chosen["problem"] == ""


def interpreter(path, missing, version="3.12.1"):
    """A program in the place of an interpreter: what it says of the modules that it is asked for."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"""#!/bin/sh\necho '{{"version": "{version}", "missing": {json.dumps(missing)}}}'\n""")
    path.chmod(0o755)
    return str(path)


def environment_of_conda(opt, missing=()):
    """An environment of conda with RoboStack's ROS: its set-up file asks for what conda sets, and gives no PYTHONPATH."""
    here = opt / "miniforge3/envs/ros"
    interpreter(here / "bin/python3", list(missing))
    (here / "conda-meta").mkdir()
    for name in ("bin/roscore", "bin/env-python"):
        (here / name).write_text("#!/bin/sh\necho yes\n")
        (here / name).chmod(0o755)
    (here / "setup.bash").write_text(
        f'[ "$CONDA_PREFIX" = {here} ] && [ "$(env-python)" = yes ] || return 1\nexport ROS_DISTRO=noetic ROS_VERSION=1\n'
    )
    return here


@pytest.mark.root
@pytest.mark.parametrize("named", ["", "setup.bash"])
def test_an_environment_of_conda_has_its_own_python(opt, named):
    here = environment_of_conda(opt)
    chosen = find(opt, str(here / named))["chosen"]
    assert (chosen["python"], chosen["python_version"], chosen["problem"]) == (f"{here}/bin/python3", "3.12.1", "")
    assert chosen["commands"]["roscore"] == f"{here}/bin/roscore"
    assert chosen["environment"] == {
        "CONDA_PREFIX": str(here),
        "PATH": f"{here}/bin",
        "ROS_DISTRO": "noetic",
        "ROS_VERSION": "1",
    }
    assert chosen["for_root"] == chosen["environment"]


def test_what_an_environment_of_conda_lacks_is_named(opt):
    here = environment_of_conda(opt, ["std_srvs"])
    chosen = find(opt, str(here))["chosen"]
    assert (chosen["python"], chosen["missing"]) == (f"{here}/bin/python3", ["std_srvs"])
    assert mentions(chosen["problem"], f"{here}/bin/python3", "std_srvs", f"{here}/setup.bash")


@pytest.mark.skipif(os.geteuid() != 0, reason="root only can be stopped by nobody's rights")
def test_a_closed_environment_of_conda_is_named(opt):
    here = environment_of_conda(opt)
    os.chmod(here / "bin", 0o700)
    (here / "setup.bash").write_text("export ROS_DISTRO=noetic\n")
    problem = find(opt, str(here))["problem"]
    assert mentions(problem, f"{here}/bin", "0700")


def test_a_prefix_may_be_made_for_another_python(opt, monkeypatch):
    monkeypatch.setattr(ros, "PYTHON", interpreter(opt / "system/python3", list(ros.MODULES)))
    here = prefix(opt)
    other = interpreter(here / "bin/python3", [])
    chosen = find(opt)["chosen"]
    assert (chosen["python"], chosen["rospy"], chosen["problem"]) == (other, True, "")


def test_the_first_python_is_named_if_none_has_rospy(opt, monkeypatch):
    system = interpreter(opt / "system/python3", ["rospy", "genpy"])
    monkeypatch.setattr(ros, "PYTHON", system)
    interpreter(prefix(opt) / "bin/python3", ["rospy"])
    found = find(opt)
    assert found["chosen"]["python"] == system
    assert f'{system} cannot import "rospy", "genpy" out of' in found["problem"]


def test_a_python_of_another_environment_is_no_reason(opt):
    base = environment_of_conda(opt, ["rospy"])
    chosen = find(opt, str(prefix(opt, more=f"export CONDA_PREFIX={base}")))["chosen"]
    assert (chosen["python"], chosen["problem"]) == (ros.PYTHON, "")


@pytest.mark.parametrize(
    ("more", "said"), [("exit 3", "it says nothing."), ("echo no luck. >&2; exit 3", '"no luck".')]
)
def test_a_set_up_file_that_ends_the_shell(opt, more, said):
    (opt / "setup.sh").write_text(more)
    expected = f"The set-up file {opt}/setup.sh, sourced by sh, sets no variables: {said}"
    assert find(opt, f"{opt}/setup.sh")["problem"] == expected


def test_a_set_up_file_that_hangs_is_ended(opt, monkeypatch):
    monkeypatch.setattr(ros, "_SOURCING", 0.3)
    (opt / "setup.sh").write_text("sleep 7343\n")
    assert "gave no answer within 0.3 s" in find(opt, f"{opt}/setup.sh")["problem"]


def test_values_that_fit_into_no_file_are_left_out():
    output = b"ROS_NOTE=a\nb\0ROS_IP=1\0BASH_FUNC_x%%=() { :; }\0PATH=/x/bin:/usr/bin:/bin\0PYTHONPATH=/x::\0_=/x\0"
    assert ros.read_variables(output) == {"ROS_IP": "1", "PATH": "/x/bin", "PYTHONPATH": "/x"}


# Executables of ROS packages


WANTED = [
    {
        "package": "some_sync",
        "executable": "sync",
        "modules": ["some_sync.sync", "some_msgs.srv"],
        "programs": ["sh", "no_such_program"],
        "environment": {"SOME_VERSION": "1"},
    }
]


def package(folder, modules=("some_sync/sync.py", "some_msgs/srv.py")):
    """A ROS package with its Python modules beside it."""
    for name in modules:
        path = folder / "python" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        (path.parent / "__init__.py").touch()
        path.write_text("")
    (folder / "some_sync/nodes").mkdir(parents=True)
    (folder / "some_sync/package.xml").touch()
    (folder / "some_sync/nodes/sync").touch()
    return folder / "some_sync/nodes/sync"


def nodes(opt, **environment):
    environment = {"PYTHONPATH": f"{opt}/src/python", **environment}
    (found,) = fkie.nodes(WANTED, ros.PYTHON, ros.full(environment))
    assert (found["package"], found["executable"]) == ("some_sync", "sync")
    assert found["lacks"] == (["no_such_program"] if found["path"] else [])
    return found["path"], found["problem"]


def test_a_node_below_the_package_path(opt):
    path = package(opt / "src")
    assert nodes(opt, ROS_PACKAGE_PATH=f"/nowhere:{opt}") == (str(path), "")
    assert nodes(opt, ROS_PACKAGE_PATH=f"{opt}/src/some_sync") == (str(path), "")


def test_an_installed_node_comes_first(opt):
    package(opt / "src")
    (opt / "lib/some_sync").mkdir(parents=True)
    (opt / "lib/some_sync/sync").touch()
    found = nodes(opt, ROS_PACKAGE_PATH=str(opt), CMAKE_PREFIX_PATH=f"/nowhere:{opt}")
    assert found == (f"{opt}/lib/some_sync/sync", "")


def test_ignored_folders_are_no_packages(opt):
    package(opt / "src/.hidden")
    package(opt / "src/left_out")
    (opt / "src/left_out/CATKIN_IGNORE").touch()
    package(opt / "src/outer")
    (opt / "src/outer/package.xml").touch()
    assert nodes(opt, ROS_PACKAGE_PATH=str(opt)) == ("", "")


def test_a_node_that_cannot_be_imported_says_why(opt):
    path = package(opt / "src", modules=("some_sync/sync.py", "some_msgs/msg.py"))
    (opt / "src/python/some_msgs/msg.py").write_text("")
    found = nodes(opt, ROS_PACKAGE_PATH=str(opt))
    assert found[0] == str(path)
    assert mentions(found[1], "some_msgs.srv", "ModuleNotFoundError")
    (opt / "src/python/some_sync/sync.py").write_text("print('hello')\nraise SystemExit(3)\n")
    assert nodes(opt, ROS_PACKAGE_PATH=str(opt))[1] == "some_sync.sync cannot be imported: SystemExit: 3"


@pytest.mark.skipif(os.geteuid() != 0, reason="root only can be stopped by nobody's rights")
def test_a_node_that_is_closed_to_others(opt):
    path = package(opt / "src")
    path.chmod(0o700)
    assert nodes(opt, ROS_PACKAGE_PATH=str(opt)) == (str(path), f"{path} is closed to other users")


def test_nodes_are_looked_for_in_the_chosen_installation(opt):
    here = prefix(opt)
    (here / "lib/some_sync").mkdir(parents=True)
    (here / "lib/some_sync/sync").touch()
    found = ros.find("auto", WANTED, root=str(opt), debian="/nowhere")
    (node,) = found["chosen"]["nodes"]
    assert node["path"] == f"{here}/lib/some_sync/sync"
    assert node["problem"].startswith("some_sync.sync cannot be imported: ")


def test_an_interpreter_that_does_not_answer():
    (found,) = fkie.nodes(WANTED, "/nowhere/python2.7", {})
    assert found["path"] == "" and "/nowhere/python2.7 could not be started" in found["problem"]


# Debian packages


POLICY = """\
ros-noetic-fkie-master-sync:
  Installed: (none)
  Candidate: 1.3.2-2focal.20240101.000000
  Version table:
     1.3.2-2focal.20240101.000000 500
        500 http://packages.example.org/ros/ubuntu focal/main amd64 Packages
dpkg:
  Installed: 1.21.22
  Candidate: 1.21.22
  Version table:
 *** 1.21.22 500
purely-virtual:
  Installed: (none)
  Candidate: (none)
"""


def test_versions_of_packages():
    assert fkie.policy(POLICY) == {
        "ros-noetic-fkie-master-sync": {"installed": "", "candidate": "1.3.2-2focal.20240101.000000"},
        "dpkg": {"installed": "1.21.22", "candidate": "1.21.22"},
        "purely-virtual": {"installed": "", "candidate": ""},
    }


@pytest.mark.skipif(not shutil.which("apt-cache"), reason="there is no apt")
def test_packages_of_this_machine(tmp_path):
    record = tmp_path / "packages"
    record.write_text("# ours\nros-noetic-nothing\n")
    dpkg, unknown, ours = fkie.packages(["dpkg", "ros-noetic-unknown"], str(record))
    assert (dpkg["name"], bool(dpkg["installed"]), dpkg["ours"]) == ("dpkg", True, False)
    assert unknown == {"name": "ros-noetic-unknown", "installed": "", "candidate": "", "ours": False}
    assert ours == {"name": "ros-noetic-nothing", "installed": "", "candidate": "", "ours": True}


def test_no_wanted_packages_are_no_question(tmp_path):
    assert fkie.packages([], str(tmp_path / "nothing")) == []


# A trial import by a user without rights, whose answer is that of a stranger


@pytest.fixture(name="package")
def fixture_package():
    """A module that others may read; its code says what is tried."""
    folder = pathlib.Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    package = folder / "rospy"
    package.mkdir()
    (package / "__init__.py").write_text("")
    yield package
    shutil.rmtree(folder)


def tried(package, *modules):
    environment = {"PYTHONPATH": str(package.parent), "PATH": "/usr/bin:/bin", "PYTHONDONTWRITEBYTECODE": "1"}
    return ros.try_import(ros.PYTHON, modules or ("rospy",), environment)


def test_modules_that_are_there(package):
    version, missing, error = tried(package, "rospy", "json")
    assert (missing, error) == ([], "") and version.startswith("3.")


def test_a_module_that_fails_is_missing(package):
    (package / "__init__.py").write_text("import nothing\n")
    assert tried(package, "rospy", "json", "not_there")[1] == ["rospy", "not_there"]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can lose its rights")
def test_no_code_of_it_runs_as_root(package):
    (package / "__init__.py").write_text("import os\nassert os.getuid() != 0 and os.geteuid() != 0\n")
    assert tried(package)[1] == []


def test_what_it_prints_is_not_the_answer(package):
    (package / "__init__.py").write_text('print(\'{"version": "3.1.1", "missing": []}\')\nimport nothing\n')
    assert tried(package)[1] == ["rospy"]


@pytest.mark.parametrize(
    "answer", [b"", b"[]", b'{"version": 3, "missing": []}', b'{"version": "3.9\\n", "missing": []}']
)
def test_no_answer_is_said(package, monkeypatch, answer):
    monkeypatch.setattr(ros, "foreign", lambda *words: Answer(1, answer, "what\nit said \x1b[0m"))
    assert tried(package) == ("", [], "it said \\x1b[0m")
