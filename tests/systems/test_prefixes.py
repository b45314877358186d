# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Robots with ROS in other places than Debian's: ROS One beside a ROS 2, an environment of conda, and a container.

make-opt-ros makes the first two out of Debian's ROS, and ros-box the container. The container's roscore and nodes are there
before the collection comes.
"""

import json
import re

import pytest
from machines.podman import ROOT
from setups.adoption import adopt
from setups.links import wait_until

INVENTORY = ROOT / "tests" / "systems" / "prefixes"
ANA, BOB, CID = "ana-pc", "bob-pc", "cid-pc"
ONE = "/opt/ros/one"
CONDA = "/home/operator/miniforge3/envs/ros"
MAKE = "bash /usr/local/share/lab/make-opt-ros"
# Of a ROS 2 for people, as it stands beside ROS One on a robot of Ubuntu 22.04.
HUMBLE = "mkdir -p /opt/ros/humble; echo 'export ROS_DISTRO=humble ROS_VERSION=2' > /opt/ros/humble/setup.sh"
NODES = ("discovery", "sync")
MEMBERS = [
    {"name": f"{robot}-pc", "robot": robot, "address": f"192.168.26.{number}"}
    for number, robot in enumerate(("ana", "bob", "cid"), 21)
]
BOX = "bash /usr/local/share/lab/ros-box"
# What is in the container: a roscore, a node that speaks, and one that prints what it hears of ana.
INSIDE = """
roscore > /dev/null 2>&1 &
until rostopic list > /dev/null 2>&1; do sleep 0.5; done
rostopic pub -r 5 /from_cid std_msgs/String hello > /dev/null &
exec rostopic echo /from_ana 2> /dev/null
"""


def start_container(lab):
    """Start the container, or start it again, as its user does: it has the names of the moment of its start."""
    lab.start(CID, "ros-box", f"{BOX} /run/inside")


@pytest.fixture(scope="module")
def fleet(new_lab):
    """The robots after site.yml, and what it said."""
    with new_lab("systems-prefixes", INVENTORY) as lab:
        lab.run(ANA, f"{MAKE} one && {HUMBLE}")
        lab.run(BOB, f"{MAKE} --conda {CONDA} && chown -R operator: /home/operator && chmod o+x /home/operator")
        lab.run(CID, f"{BOX} make && cat > /run/inside", stdin=INSIDE)
        start_container(lab)
        status, output = lab.play("site.yml")
        assert status == 0, output
        yield lab, output


def lacking_names(lab):
    """The verification's view of containers with old names."""
    arguments = {"name": CID, "is_master": True, "members": MEMBERS, "masters": [], "patience": 1}
    status, output = lab.module(CID, "multimaster_verify", arguments)
    assert status == 0, output
    return json.JSONDecoder().raw_decode(output, output.index("{"))[0]["container_names"]


def environ(lab, host, unit):
    """The program and the variables of a service."""
    process = f"/proc/$(systemctl show -P MainPID multimaster-{unit})"
    program, *variables = lab.run(
        host, f"tr '\\0' '\\n' < {process}/cmdline | head -1; tr '\\0' '\\n' < {process}/environ"
    ).splitlines()
    return program, dict(line.partition("=")[::2] for line in variables)


def test_the_services_run_on_the_ros_of_the_prefix(fleet):
    lab, _output = fleet
    for unit in ("roscore", *NODES):
        program, variables = environ(lab, ANA, unit)
        assert program.startswith("/usr/bin/python3") and variables["ROS_DISTRO"] == "one"
        assert f"{ONE}/lib/python3/dist-packages" in variables["PYTHONPATH"].split(":")
        program, variables = environ(lab, BOB, unit)
        assert program.startswith(f"{CONDA}/bin/python") and variables["CONDA_PREFIX"] == CONDA
        assert variables["PATH"].startswith(f"{CONDA}/bin:")
        assert variables["PYTHONPATH"] == "/usr/local/lib/rosfleet-multimaster/python"


ASKED = 'echo $ROS_DISTRO $(command -v python3); python3 -c "import rospy; print(rospy.__file__)"; rostopic list'


def test_shells_have_the_ros_of_the_prefix(fleet):
    lab, _output = fleet
    for host, start, place in ((ANA, "one /usr/bin/python3", ONE), (BOB, f"noetic {CONDA}/bin/python3", CONDA)):
        for seen in (lab.run(host, f"su - operator -c '{ASKED}'"), lab.ssh(host, ASKED, user="operator")):
            assert start in seen and f"{place}/lib/" in seen and "/master_discovery/changes" in seen


def test_what_a_person_has_is_no_code_for_root(fleet):
    lab, output = fleet
    assert f"{BOB}: root gets no variables of the set-up file {CONDA}/setup.bash, since" in output
    assert CONDA not in lab.run(BOB, "env")
    assert "humble" not in lab.run(ANA, "env")


def test_a_container_gets_the_names_when_it_is_started(fleet):
    lab, _output = fleet
    (seen,) = lacking_names(lab)
    assert (seen["unit"], seen["missing"]) == ("ros-box.service", [ANA, BOB])
    start_container(lab)
    wait_until(lambda: "rosmaster" in lab.run(CID, "pgrep -fl rosmaster", check=False), 30, "the roscore is back")
    assert lacking_names(lab) == []


def say(lab, host):
    """Let a person's node speak; the container does so by itself."""
    words = f'su - operator -c "rostopic pub -r 5 /from_{host[:3]} std_msgs/String hello"'
    lab.run(host, f"systemd-run --quiet --collect --unit talker {words}")


def test_a_topic_crosses_all_ways(fleet):
    lab, _output = fleet
    say(lab, ANA)
    say(lab, BOB)
    for giver, taker in ((ANA, BOB), (BOB, ANA), (CID, ANA), (CID, BOB)):
        heard = f"su - operator -c 'timeout -k 5 30 rostopic echo -n 1 /from_{giver[:3]}'"
        wait_until(lambda: "hello" in lab.run(taker, heard, check=False), 60, f"{taker} hears {giver}")  # noqa: B023
    wait_until(lambda: "hello" in lab.run(CID, "cat /run/ros-box.out"), 60, f"{CID} hears {ANA} in its container")


def test_a_roscore_in_a_container_is_adopted(fleet, tmp_path):
    lab, _output = fleet
    status, output = adopt(lab, tmp_path / "fleet")
    assert status == 0, output
    written = {path.stem: path.read_text() for path in (tmp_path / "fleet" / "group_vars").iterdir()}
    assert {name for name, text in written.items() if "multimaster_roscore: existing" in text} == {"cid"}, written


def test_the_fleet_is_verified_and_not_changed_again(fleet):
    lab, _output = fleet
    status, output = lab.play("playbooks/verify.yml")
    assert status == 0, output
    status, output = lab.play("site.yml", "--check")
    assert status == 0, output
    assert re.findall(r"changed=(\d+)", output) == ["0"] * 4, output


def test_nothing_stays_after_the_teardown(fleet):
    lab, _output = fleet
    status, output = lab.play("playbooks/teardown.yml")
    assert status == 0, output
    assert lab.run(CID, "systemctl is-active ros-box; pgrep -f rosmaster").startswith("active")
    for host, prefix in ((ANA, ONE), (BOB, CONDA), (CID, "")):
        left = lab.run(host, f"grep -rl rosfleet /etc {prefix}/etc || true; ls -d /usr/local/lib/rosfleet* || true")
        assert not left, left
