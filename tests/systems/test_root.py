# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A person's workspace that tries to become root, on a real system: it works for the person and for the services, and for nobody else.

The workspace is made by workspaces/robbing.sh.
"""

import json
import re
from pathlib import Path

import pytest

FIRST, SECOND = "kobuki1computer", "kobuki2computer"
PERSON, UID = "operator", 1000
WORKSPACE = f"/home/{PERSON}/ws"
SETUP = f"{WORKSPACE}/devel/setup.bash"
BELOW = "/opt/ros/noetic"  # root's, and the workspace is built on it
OF_ROOT = f"""
mkdir -p {BELOW}/python/below_msgs
echo MODEL = 1 > {BELOW}/python/below_msgs/__init__.py
cat > {BELOW}/setup.sh <<'END'
export ROS_DISTRO=noetic ROS_VERSION=1 ROS_ETC_DIR={BELOW}/etc CMAKE_PREFIX_PATH={BELOW} PYTHONPATH={BELOW}/python
END
"""
SECRET = "the secret of root"
ROBBING = (Path(__file__).with_name("workspaces") / "robbing.sh").read_text()
MEMBERS = [
    {"name": FIRST, "robot": "kobuki1", "address": "192.168.1.229"},
    {"name": SECOND, "robot": "kobuki2", "address": "192.168.1.239"},
]


@pytest.fixture(scope="module")
def robbed(lab):
    """The lab, whose first robot has the workspace; and what site.yml said about it."""
    lab.run(FIRST, OF_ROOT)
    lab.run(FIRST, f"su {PERSON} -c 'bash -s {WORKSPACE} {BELOW}'", stdin=ROBBING)
    lab.run(FIRST, "umask 077; cat > /root/secret", stdin=SECRET)
    status, output = lab.play("site.yml", "--limit", "kobuki1", variables={"multimaster_ros_setup": SETUP})
    assert status == 0, output
    yield lab, output
    lab.run(FIRST, f"systemctl stop user@{UID} user@0; rm -rf {WORKSPACE} /opt/ros /root/secret /tmp/ran-as-*")
    status, output = lab.play("site.yml", "--limit", "kobuki1")
    assert status == 0, output


def test_it_is_said_what_root_does_not_get(robbed):
    _lab, output = robbed
    assert (
        f'{FIRST}: root gets no variables of the set-up file {SETUP}, since "/home/{PERSON} belongs to {PERSON}"; expected files and '
        f'folders that only root can change: the services and the user "{PERSON}" get them; root and other users get those of {BELOW}/setup.sh.'
    ) in output
    assert f'{FIRST}: no hook of catkin is written "below {WORKSPACE}' in output
    assert 'sets BASH_ENV, LD_PRELOAD, "PATH (./bin)", "PYTHONPATH (lib)", "PYTHONSTARTUP", which nobody gets' in output


SESSION = "echo $MODEL $ROS_MASTER_URI; env; python3 -c 'import ws_msgs.msg; print(ws_msgs.msg.Note._type)'; true"
DESKTOP = "XDG_RUNTIME_DIR=/run/user/$(id -u) systemctl --user show-environment"


def test_nothing_of_it_reaches_root(robbed):
    lab, _output = robbed
    lab.run(FIRST, "systemctl restart user@0")
    for seen in (lab.ssh(FIRST, SESSION), lab.run(FIRST, SESSION, check=False), lab.run(FIRST, DESKTOP)):
        assert f"http://{FIRST}:11311" in seen  # what the collection gives to all
        assert WORKSPACE not in seen and "burger" not in seen and "ws_msgs/Note" not in seen
    lab.ssh(FIRST, "python3 -c 1")
    assert "ran-as-0" not in lab.run(FIRST, "ls /tmp")
    assert "rosfleet-multimaster.sh" not in lab.run(FIRST, f"ls {WORKSPACE}/etc/catkin")
    written = lab.run(FIRST, "cat /etc/profile.d/* /etc/rosfleet-multimaster/environment /etc/ssh/sshd_config.d/*")
    assert not re.search(r"LD_PRELOAD|BASH_ENV|PYTHONSTARTUP|\./bin|[:=]lib\b", written)


BOTH = "echo etc=$ROS_ETC_DIR; python3 -c 'import below_msgs; print(below_msgs.__name__)'; true"


def test_root_and_others_keep_the_ros_of_root_that_is_below(robbed):
    lab, _output = robbed
    lab.run(FIRST, "useradd -m guest")
    seen = [lab.ssh(FIRST, BOTH), lab.run(FIRST, BOTH), lab.run(FIRST, "su - guest", stdin=BOTH)]
    assert all(f"etc={BELOW}/etc" in text and "below_msgs" in text for text in seen), seen
    lab.run(FIRST, "systemctl restart user@0")
    desktop = lab.run(FIRST, DESKTOP)
    assert f"ROS_ETC_DIR={BELOW}/etc" in desktop and "ROS_DISTRO=noetic" in desktop
    for text in (lab.ssh(FIRST, BOTH, user=PERSON), lab.run(FIRST, f"su - {PERSON}", stdin=BOTH)):
        assert f"etc={WORKSPACE}/etc" in text and "below_msgs" in text
    lab.run(FIRST, "userdel -r guest 2>/dev/null")


def test_the_workspace_works_for_its_person_and_the_services(robbed):
    lab, _output = robbed
    lab.run(FIRST, f"systemctl restart user@{UID}")
    for seen in (lab.ssh(FIRST, SESSION, user=PERSON), lab.run(FIRST, f'su - {PERSON} -c "{SESSION}"')):
        assert f"http://{FIRST}:11311" in seen and "burger" in seen and "ws_msgs/Note" in seen
    desktop = lab.run(FIRST, f"su {PERSON} -c '{DESKTOP}'")
    assert "MODEL=burger" in desktop and re.search(
        rf"^PYTHONPATH=\S*:{WORKSPACE}/python:{BELOW}/python$", desktop, re.MULTILINE
    )
    for name in ("roscore", "discovery", "sync"):
        unit = f"multimaster-{name}.service"
        environ = lab.run(FIRST, f"tr '\\0' '\\n' < /proc/$(systemctl show -P MainPID {unit})/environ")
        assert re.search(rf"^PYTHONPATH=\S*:{WORKSPACE}/python:{BELOW}/python$", environ, re.MULTILINE)


def test_the_verification_is_no_way_to_root_either(robbed):
    lab, _output = robbed
    talker = "exec timeout -k 5 60 rostopic pub -r 5 /note ws_msgs/Note hello"
    lab.run(FIRST, f"systemd-run --quiet --unit note --collect su - {PERSON} -c '{talker}'")
    lab.run(FIRST, "until rostopic list | grep -q ^/note; do sleep 0.2; done")
    arguments = {
        "name": FIRST,
        "is_master": True,
        "members": MEMBERS,
        "masters": [],
        "patience": 1,
        "talkers": [SECOND],
    }
    status, output = lab.module(FIRST, "multimaster_verify", arguments)
    lab.run(FIRST, "systemctl stop note")
    assert status == 0 and '"problems": []' in output, output
    # The services' Python, with the workspace, knows its message: so what follows was really tried.
    assert re.search(r'"md5sum": "[0-9a-f]{32}", "name": "/note"', output), output
    assert lab.run(FIRST, "cat /root/secret; stat -c %a:%U:%s /root/secret").split("\n")[:2] == [
        f"{SECRET}600:root:{len(SECRET)}",
        "",
    ]


def test_no_process_outlives_the_unit_that_started_it(robbed):
    lab, _output = robbed
    left = lab.run(
        FIRST,
        "for pid in $(pgrep -x sleep); do cat /proc/$pid/cmdline /proc/$pid/cgroup | tr '\\0\\n' '  '; echo; done",
    )
    strays = [line for line in left.splitlines() if "7341" in line and "multimaster-" not in line]
    assert not strays
    assert "73415" in left  # the services have the workspace, so one is in each of them


@pytest.mark.parametrize("lie", ["setup", "another_user", "other_types", "nesting"])
def test_an_answer_of_the_workspace_is_judged(robbed, lie):
    lab, _output = robbed
    node = {"package": "p", "executable": "e", "modules": ["liar"]}
    arguments = {"ros_setup": f"{WORKSPACE}/devel/{lie}.bash", "parts": ["ros"], "nodes": [node]}
    lab.run(FIRST, f"su {PERSON} -c 'mkdir -p {WORKSPACE}/lib/p; touch {WORKSPACE}/lib/p/e'")
    status, output = lab.module(FIRST, "multimaster_info", arguments)
    assert status == 0, output
    answer, _end = json.JSONDecoder().raw_decode(output, output.index("{"))
    (found,) = answer["ros"]["chosen"]["nodes"]
    assert found["path"] == "" and found["problem"], found
