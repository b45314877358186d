# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The environment of ROS: merged, rendered, and read back by the programs that read the files."""

import os
import pathlib
import re
import subprocess

import pytest
from ansible_collections.rosfleet.multimaster.plugins.filter.environment_files import environment_files
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import ros, shells
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import environment as environment_module
from hypothesis import given, settings
from hypothesis import strategies as st

GENERATOR = "/usr/lib/systemd/user-environment-generators/30-systemd-environment-d-generator"
OURS = {"ROS_MASTER_URI": "http://kobuki1computer:11311", "ROS_HOSTNAME": "kobuki1computer"}
NOETIC = {
    "ROS_DISTRO": "noetic",
    "ROS_MASTER_URI": "http://localhost:11311",
    "ROS_IP": "127.0.0.1",
    "PATH": "/opt/ros/noetic/bin",
    "PYTHONPATH": "/opt/ros/noetic/lib/python3/dist-packages",
    "ROS_PACKAGE_PATH": "/home/robot/ws/src:/opt/ros/noetic/share",
}
PYTHON = "/usr/local/lib/rosfleet-multimaster/python"
SHARE = "/usr/local/lib/rosfleet-multimaster/share"
INFO = {
    "hostname": "kobuki1computer",
    "ros": {"chosen": {"hooks": ""}},
    "sshd": {"installed": True, "includes_drop_ins": True, "other_setenv": [], "path": ""},
}
# Everything that a quoting can stumble over, and no control characters.
VALUES = st.text(
    st.one_of(st.sampled_from("$`\"'\\ #;&|*?[]{}()<>~!%=:é"), st.characters(codec="ascii", categories=("L", "N"))),
    min_size=1,
)


def rendered(environment, info=None):
    made = environment_module.render_files(environment, INFO if info is None else info)
    return {file["path"]: file["content"] for file in made}


def sourced(content, before=None, shell="sh", options="-eu"):
    """The environment of a shell after reading a profile; it must print nothing."""
    script = '. "$FILE"; unset FILE; printf "\\0\\0"; exec env -0'
    path = pathlib.Path(os.environ["SCRATCH"]) / "profile.sh"
    path.write_text(content)
    environment = {"PATH": "/usr/bin:/bin", "FILE": str(path), **(before or {})}
    done = subprocess.run(
        [shell, options, "-c", script], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, check=True
    )
    printed, _mark, variables = done.stdout.decode().partition("\0\0")
    assert (printed, done.stderr) == ("", b"")
    return dict(entry.split("=", 1) for entry in variables.split("\0") if entry)


def generated(content, before=None):
    """The environment that systemd's own generator makes of a file of environment.d."""
    folder = pathlib.Path(os.environ["SCRATCH"]) / "environment.d"
    folder.mkdir(exist_ok=True)
    (folder / "90-test.conf").write_text(content)
    environment = {
        "PATH": "/usr/bin:/bin",
        "HOME": "/nonexistent",
        "XDG_CONFIG_HOME": str(folder.parent),
        **(before or {}),
    }
    done = subprocess.run([GENERATOR], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, check=True)
    assert done.stderr == b""
    return shells.read_generated(done.stdout.decode())


@pytest.fixture(autouse=True)
def scratch(tmp_path, monkeypatch):
    monkeypatch.setenv("SCRATCH", str(tmp_path))


def test_merge_ours_win_and_come_first():
    merged = environment_module.merge(NOETIC, OURS)
    assert merged.texts == {**OURS, "ROS_DISTRO": "noetic"}
    assert merged.lists["ROS_PACKAGE_PATH"] == (SHARE, "/home/robot/ws/src", "/opt/ros/noetic/share")
    assert merged.lists["PYTHONPATH"] == (PYTHON, "/opt/ros/noetic/lib/python3/dist-packages")
    assert merged.unset == ("ROS_IP",)


def test_merge_by_address_unsets_the_name():
    merged = environment_module.merge(
        {"ROS_HOSTNAME": "old"}, {"ROS_MASTER_URI": "http://192.168.1.229:11311", "ROS_IP": "192.168.1.229"}
    )
    assert "ROS_HOSTNAME" not in merged.texts
    assert merged.unset == ("ROS_HOSTNAME",)


def test_merge_without_ros_needs_no_path():
    assert set(environment_module.merge({}, OURS).lists) == {"PYTHONPATH", "ROS_PACKAGE_PATH"}


def test_units_file():
    content = rendered(environment_module.merge(NOETIC, OURS))["/etc/rosfleet-multimaster/environment"]
    assert content.splitlines()[1:] == [
        "PATH=/opt/ros/noetic/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
        f"PYTHONPATH={PYTHON}:/opt/ros/noetic/lib/python3/dist-packages",
        "ROS_DISTRO=noetic",
        "ROS_HOSTNAME=kobuki1computer",
        "ROS_MASTER_URI=http://kobuki1computer:11311",
        f"ROS_PACKAGE_PATH={SHARE}:/home/robot/ws/src:/opt/ros/noetic/share",
    ]


def test_a_namespace_and_folders_of_a_person_reach_persons_and_no_service():
    moving = dict.fromkeys(environment_module.OF_PERSONS, "/home/robot")
    files = rendered(environment_module.merge({**NOETIC, **moving}, OURS))
    seen = sourced(files[environment_module.PROFILE])
    assert set(moving) <= set(seen)
    assert files["/etc/rosfleet-multimaster/environment"] == environment_module.render_units(
        environment_module.merge(NOETIC, OURS)
    )


@pytest.mark.parametrize("shell", ["sh", "bash"])
def test_profile_adds_in_front_and_only_once(shell):
    profile = rendered(environment_module.merge(NOETIC, OURS))[environment_module.PROFILE]
    first = sourced(profile, {"PYTHONPATH": "/home/robot/python", "ROS_IP": "10.0.0.9"}, shell)
    assert first["PYTHONPATH"] == f"{PYTHON}:/opt/ros/noetic/lib/python3/dist-packages:/home/robot/python"
    assert first["PATH"] == "/opt/ros/noetic/bin:/usr/bin:/bin"
    assert first["ROS_MASTER_URI"] == "http://kobuki1computer:11311"
    assert "ROS_IP" not in first
    assert sourced(profile, first, shell) == first


def test_profile_keeps_the_order_of_a_person():
    profile = rendered(environment_module.merge(NOETIC, OURS))[environment_module.PROFILE]
    mine = f"/mine:{PYTHON}:/opt/ros/noetic/lib/python3/dist-packages"
    assert sourced(profile, {"PYTHONPATH": mine})["PYTHONPATH"] == mine


@given(text=VALUES, entry=VALUES.filter(lambda value: ":" not in value))
@settings(max_examples=60, deadline=None)
def test_profile_quotes_everything(text, entry):
    environment = environment_module.merge({"ROS_NOTE": text, "PYTHONPATH": entry}, OURS)
    seen = sourced(rendered(environment)[environment_module.PROFILE])
    assert seen["ROS_NOTE"] == text
    assert seen["PYTHONPATH"] == f"{PYTHON}:{entry}"


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists(GENERATOR), reason="systemd's environment generator is not installed")
@given(text=VALUES, entry=VALUES.filter(lambda value: ":" not in value))
@settings(max_examples=60, deadline=None)
def test_desktop_quotes_everything(text, entry):
    environment = environment_module.merge({"ROS_NOTE": text, "PYTHONPATH": entry}, OURS)
    content = rendered(environment)[environment_module.DESKTOP]
    seen = generated(content)
    assert seen["ROS_NOTE"] == text
    assert seen["PYTHONPATH"] == f"{PYTHON}:{entry}"
    assert generated(content, {"PYTHONPATH": "/mine"})["PYTHONPATH"] == f"{PYTHON}:{entry}:/mine"


def test_ssh_is_one_line_with_the_system_path():
    content = rendered(environment_module.merge({**NOETIC, "ROS_NOTE": 'two "words" and \\'}, OURS))[
        environment_module.SSHD
    ]
    lines = [line for line in content.splitlines() if not line.startswith("#")]
    assert len(lines) == 1
    assert lines[0].startswith(f"SetEnv PATH=/opt/ros/noetic/bin:{environment_module.SSH_PATH} PYTHONPATH=")
    assert '"ROS_NOTE=two \\"words\\" and \\\\"' in lines[0]


def test_ssh_keeps_the_path_of_the_machine():
    info = {**INFO, "sshd": {**INFO["sshd"], "path": "/usr/bin:/snap/bin"}}
    content = rendered(environment_module.merge(NOETIC, OURS), info)[environment_module.SSHD]
    assert "PATH=/opt/ros/noetic/bin:/usr/bin:/snap/bin " in content


@pytest.mark.parametrize(
    ("sshd", "note"),
    [
        ({"installed": False}, None),
        ({"includes_drop_ins": False}, "its sshd reads no drop-ins"),
        (
            {"other_setenv": [{"file": "/etc/ssh/sshd_config", "line": 7, "text": "SetEnv A=1", "match": False}]},
            "sshd_config line 7 has",
        ),
    ],
)
def test_ssh_is_left_out_with_a_sentence(sshd, note):
    made = environment_files(OURS, {**INFO, "sshd": {**INFO["sshd"], **sshd}})
    assert environment_module.SSHD not in [file["path"] for file in made["files"]]
    assert len(made["files"]) == 3
    assert made["digest"] == environment_files(OURS, INFO)["digest"]
    assert made["notes"] == [] if note is None else note in made["notes"][0]


def test_ssh_ignores_the_setenv_below_a_match():
    other = {"file": "/etc/ssh/sshd_config", "line": 7, "text": "SetEnv A=1", "match": True}
    made = environment_files(OURS, {**INFO, "sshd": {**INFO["sshd"], "other_setenv": [other]}})
    assert environment_module.SSHD in [file["path"] for file in made["files"]]
    assert made["notes"] == []


def test_hook_brings_back_what_a_set_up_file_drops(tmp_path):
    hooks = tmp_path / "etc/catkin/profile.d"
    content = rendered(environment_module.merge(NOETIC, OURS), {**INFO, "ros": {"chosen": {"hooks": str(hooks)}}})[
        f"{hooks}/1.rosfleet-multimaster.sh"
    ]
    seen = sourced(
        content,
        {"ROS_PACKAGE_PATH": "/opt/ros/noetic/share", "ROS_MASTER_URI": "http://temporary:11311", "ROS_IP": "10.0.0.9"},
    )
    assert seen["ROS_PACKAGE_PATH"] == f"{SHARE}:/opt/ros/noetic/share"
    assert (seen["ROS_MASTER_URI"], seen["ROS_IP"]) == ("http://temporary:11311", "10.0.0.9")
    assert "ROS_HOSTNAME" not in seen
    assert sourced(content, {}).items() >= OURS.items()


def test_hook_runs_between_those_of_ros():
    paths = rendered(environment_module.merge(NOETIC, OURS), {**INFO, "ros": {"chosen": {"hooks": "/hooks"}}})
    (name,) = (path.rpartition("/")[2] for path in paths if path.startswith("/hooks/"))
    assert sorted(["10.roslaunch.sh", name, "1.ros_package_path.sh", "1.ros_version.sh"])[2:] == [
        name,
        "10.roslaunch.sh",
    ]


def test_no_hook_without_a_folder():
    assert not [path for path in rendered(environment_module.merge({}, OURS)) if "/1." in path]


def test_differences_name_variable_found_expected_and_file():
    arrives = {**OURS, "PYTHONPATH": f"{PYTHON}:/x", "ROS_PACKAGE_PATH": SHARE}
    seen = {"login": arrives, "ssh": {**arrives, "ROS_IP": "10.0.0.9"}, "desktop": {}}
    paths = [environment_module.PROFILE, environment_module.SSHD]
    (difference,) = environment_module.find_differences(OURS, seen, paths)
    for fact in (
        "ROS_IP is 10.0.0.9 in a command by ssh",
        "expected it not to be set",
        paths[1],
        "grep -rn ROS_IP /etc/profile.d",
    ):
        assert fact in difference
    assert len(environment_module.find_differences(OURS, seen, [*paths, environment_module.DESKTOP])) == 5
    assert environment_module.find_differences(OURS, seen, [environment_module.PROFILE]) == []


def test_differences_leave_known_exports_to_the_preflight():
    older = {
        **OURS,
        "ROS_MASTER_URI": "http://old:11311",
        "ROS_IP": "10.0.0.9",
        "PYTHONPATH": PYTHON,
        "ROS_PACKAGE_PATH": SHARE,
    }
    seen = {"login": older, "ssh": older, "desktop": None}
    known = ["ROS_MASTER_URI", "ROS_IP"]
    assert environment_module.find_differences(OURS, seen, [environment_module.PROFILE], known) == []
    assert len(environment_module.find_differences(OURS, seen, [environment_module.SSHD], known)) == 2
    assert environment_module.find_differences(OURS, seen, [environment_module.DESKTOP]) == []


WITH_HOOKS = {**INFO, "ros": {"chosen": {"hooks": "/opt/ros/noetic/etc/catkin/profile.d"}}}
HOOK = "/opt/ros/noetic/etc/catkin/profile.d/1.rosfleet-multimaster.sh"


def reaching_shells(reach):
    made = environment_files(
        OURS, WITH_HOOKS, ros=NOETIC, for_root={"ROS_DISTRO": "noetic"}, person="robot", reach=reach
    )
    return {file["path"]: file["content"] for file in made.pop("files")}, made


def test_shells_with_names_alone_keep_their_own_ros():
    files, rest = reaching_shells("names")
    assert set(files) == {
        "/etc/rosfleet-multimaster/environment",
        environment_module.PROFILE,
        environment_module.DESKTOP,
        environment_module.SSHD,
        HOOK,
    }
    mine = {"PYTHONPATH": "/mine", "ROS_DISTRO": "one", "ROS_PACKAGE_PATH": "/mine/share"}
    for path in (environment_module.PROFILE, HOOK):
        seen = sourced(files[path], mine)
        assert {name: seen[name] for name in (*mine, *OURS)} == {**mine, **OURS}
        assert seen["PATH"] == "/usr/bin:/bin"
    assert "ROS_IP" not in sourced(files[environment_module.PROFILE], {"ROS_IP": "10.0.0.9"})
    for path in (environment_module.DESKTOP, environment_module.SSHD):
        assert "noetic" not in files[path] and "PATH" not in files[path] and OURS["ROS_MASTER_URI"] in files[path]
    assert rest["notes"] == []


def test_services_have_all_whatever_shells_get():
    made = {reach: reaching_shells(reach) for reach in ("all", "names", "none")}
    units = "/etc/rosfleet-multimaster/environment"
    assert len({files[units] for files, _rest in made.values()}) == 1
    assert len({rest["digest"] for _files, rest in made.values()}) == 1
    assert list(made["none"][0]) == [units] and made["none"][1]["notes"] == []
    assert environment_module.GENERATOR in made["all"][0]


def test_nothing_for_shells_has_no_note_about_sshd():
    old = {**INFO, "sshd": {**INFO["sshd"], "includes_drop_ins": False}}
    assert environment_files(OURS, old, reach="none")["notes"] == []
    assert len(environment_files(OURS, old, reach="names")["notes"]) == 1


def test_differences_ask_shells_for_what_they_get():
    seen = {"login": OURS, "ssh": {"ROS_HOSTNAME": "other"}, "desktop": None}
    paths = [environment_module.PROFILE]
    assert environment_module.find_differences(OURS, seen, paths, shells="names") == []
    assert len(environment_module.find_differences(OURS, seen, paths)) == 2
    assert len(environment_module.find_differences(OURS, seen, [environment_module.SSHD], shells="names")) == 2
    assert environment_module.find_differences(OURS, {"login": {}}, paths, shells="none") == []


def test_the_filter_refuses_an_unknown_reach():
    with pytest.raises(Exception, match="some.*shells"):
        environment_files(OURS, INFO, reach="some")


def test_filter_refuses_a_missing_plan_or_machine():
    with pytest.raises(Exception, match="expected a mapping with ROS_MASTER_URI"):
        environment_files({"ROS_HOSTNAME": "kobuki1computer"}, INFO)
    with pytest.raises(Exception, match="expected the return of rosfleet.multimaster.multimaster_info"):
        environment_files(OURS, {})


def test_a_router_has_no_files_and_was_not_looked_at_for_any():
    assert environment_files({}, {"interfaces": []}) == {"files": [], "notes": [], "digest": ""}
    assert environment_module.find_differences({}, {}, []) == []


def test_lists_of_both_sides_agree():
    """The renderers treat as lists the variables that the module strips of the system's entries."""
    assert set(ros._LISTS) <= set(environment_module.LISTS)
    assert re.fullmatch(r"[A-Z_ ]+", " ".join(environment_module.LISTS))


def test_only_sshd_is_asked_about_its_file():
    made = environment_files(OURS, INFO)["files"]
    assert [file["path"] for file in made if "validate" in file] == [environment_module.SSHD]


# Not everybody gets all


WORKSPACE = {"PYTHONPATH": "/home/robot/ws/python", "PATH": "/home/robot/ws/bin", "ROS_DISTRO": "noetic"}


def reaching(person, for_root=None):
    return environment_module.merge_for_users(WORKSPACE, for_root or {}, person, OURS)


def as_user(content, monkeypatch, name, uid):
    """A profile as it is read by a user: `id` is another program."""
    fake = pathlib.Path(os.environ["SCRATCH"]) / "id"
    fake.write_text(f'#!/bin/sh\n[ "$1" = -u ] && echo {uid} || echo {name}\n')
    fake.chmod(0o755)
    return content.replace("/usr/bin/id", str(fake))


USERS = {"root": 0, "robot": 1000, "operator": 1001}


@pytest.mark.parametrize("name", USERS)
@pytest.mark.parametrize(("person", "those"), [("robot", {"robot"}), ("*", {"robot", "operator"}), ("", set())])
@pytest.mark.parametrize("reader", ["profile", "generator"])
def test_what_is_not_roots_reaches_those_it_may(monkeypatch, person, those, name, reader):
    files = rendered(reaching(person))
    if reader == "profile":
        seen = sourced(as_user(files[environment_module.PROFILE], monkeypatch, name, USERS[name]))
    elif not person:
        assert environment_module.GENERATOR not in files
        seen = {"PYTHONPATH": PYTHON, **OURS}
        assert "/home/robot" not in files[environment_module.DESKTOP]
    else:
        assert environment_module.DESKTOP not in files  # every systemd of a user reads it
        program = as_user(files[environment_module.GENERATOR], monkeypatch, name, USERS[name])
        done = subprocess.run(["sh", "-c", program], env={"PATH": "/usr/bin:/bin"}, capture_output=True, check=True)
        assert done.stderr == b""
        seen = shells.read_generated(done.stdout.decode())
    theirs = ["/home/robot/ws/python"] if name in those else []
    assert seen["PYTHONPATH"].split(":") == [PYTHON, *theirs]
    assert ("ROS_DISTRO" in seen) is (name in those)
    assert ("/home/robot/ws/bin" in seen.get("PATH", "")) is (name in those)
    assert seen["ROS_MASTER_URI"] == OURS["ROS_MASTER_URI"]


def test_services_get_all_of_it_and_ssh_by_user():
    files = rendered(reaching("robot"))
    assert f"PYTHONPATH={PYTHON}:/home/robot/ws/python\n" in files["/etc/rosfleet-multimaster/environment"]
    for_all, match, for_robot = files[environment_module.SSHD].splitlines()[1:]
    assert for_all.startswith("SetEnv ") and "/home/robot" not in for_all and "ROS_MASTER_URI=" in for_all
    assert match == "Match User robot" and "/home/robot/ws/python" in for_robot and "ROS_MASTER_URI=" in for_robot
    assert "\nMatch User !root,*\n" in rendered(reaching("*"))[environment_module.SSHD]
    assert "Match" not in rendered(reaching(""))[environment_module.SSHD]


def test_where_all_get_the_same_the_files_are_plain():
    files = rendered(reaching("*", WORKSPACE))
    assert files == rendered(environment_module.merge(WORKSPACE, OURS))
    assert environment_module.GENERATOR not in files and "/usr/bin/id" not in files[environment_module.PROFILE]


def test_a_sshd_without_setenv_below_match_gives_a_person_none():
    """OpenSSH 8.4 and older. Login shells have them."""
    info = {**INFO, "sshd": {**INFO["sshd"], "match_setenv": False}}
    made = environment_files(OURS, info, ros=WORKSPACE, for_root={}, person="robot")
    content = {file["path"]: file["content"] for file in made["files"]}
    assert "Match" not in content[environment_module.SSHD] and "/home/robot" not in content[environment_module.SSHD]
    assert "/home/robot/ws/python" in content[environment_module.PROFILE]
    assert made["notes"]


def test_a_setenv_below_somebody_elses_match_stays_the_first():
    other = {"file": "/etc/ssh/sshd_config", "line": 7, "text": "SetEnv A=1", "match": True}
    info = {**INFO, "sshd": {**INFO["sshd"], "other_setenv": [other]}}
    made = environment_files(OURS, info, ros=WORKSPACE, for_root={}, person="robot")
    content = {file["path"]: file["content"] for file in made["files"]}[environment_module.SSHD]
    assert "Match" not in content and "/home/robot" not in content
    (note,) = made["notes"]
    assert "sshd_config line 7 has a SetEnv below a Match" in note


@settings(deadline=None, max_examples=30)
@given(VALUES, VALUES.filter(lambda text: ":" not in text))
def test_the_generator_quotes_everything(text, entry):
    environment = environment_module.merge_for_users({"ROS_NOTE": text, "PYTHONPATH": entry}, {}, "*", OURS)
    program = rendered(environment)[environment_module.GENERATOR].replace("/usr/bin/id -u", "echo 7")
    done = subprocess.run(["sh", "-c", program], env={"PATH": "/usr/bin:/bin"}, capture_output=True, check=True)
    seen = shells.read_generated(done.stdout.decode())
    assert (seen["ROS_NOTE"], seen["PYTHONPATH"]) == (text, f"{PYTHON}:{entry}")


def test_a_name_that_is_no_account_is_refused():
    with pytest.raises(Exception, match="expected the name of an account"):
        environment_files(OURS, INFO, ros=WORKSPACE, person="robot\nPermitRootLogin yes")
