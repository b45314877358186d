# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A sealed robot: its roscore is on a computer where Ansible has no connection, as on Toyota's HSR.

hsrb is a container with the roscore of its maker and nodes of its own. It is no host of any inventory that Ansible gets.
"""

import json
import re
from pathlib import Path

import pytest
from machines.layout import Extra
from setups.links import wait_until

NAME, INVENTORY = "systems-sealed", Path(__file__).with_name("sealed")
SEALED, COMPANION, OTHER = "hsrb", "hsr-pc", "kobuki-pc"
MAKER = "ROS_HOSTNAME=hsrb ROS_MASTER_URI=http://hsrb:11311"
# What the container was when it was made, without what its own programs write.
LOOK = "cat /etc/hosts; find /etc /usr/local /var/lib -newer /run/made -type f ! -path '*/systemd/*' ! -path '*/machine-id'"
LOGINS = "journalctl --boot --output cat | grep -c 'Accepted publickey\\|session opened' || true"


@pytest.fixture(scope="module")
def lab(new_lab):
    with new_lab(NAME, INVENTORY, {SEALED: Extra(("192.168.25.40",))}) as found:
        found.run(SEALED, "touch /run/made; cp /usr/local/share/lab/foreign-roscore.service /etc/systemd/system")
        found.run(SEALED, "systemctl start foreign-roscore.service")
        connections = json.loads(found.connection.read_text())
        del connections["all"]["hosts"][SEALED]
        found.connection.write_text(json.dumps(connections))
        found.run(SEALED, "touch /run/made")
        found.seen = found.run(SEALED, LOOK)
        yield found


def test_robots_talk_with_a_sealed_roscore(lab):
    """Topics and services cross both ways, though nothing is done on the sealed computer."""
    status, output = lab.play("site.yml")
    assert status == 0, output
    assert re.findall(r"(\S+) : ok=", output) == [COMPANION, OTHER, "localhost"]
    lab.start(SEALED, "pose", f"env {MAKER} rostopic pub -r 5 /hsr/pose std_msgs/String ready")
    lab.start(OTHER, "status", "rostopic pub -r 5 /kobuki/status std_msgs/String ready")
    lab.start(SEALED, "grip", f"env {MAKER} python3 {{script}} grip", "programs/service_server.py")
    hear = "timeout -k 5 40 rostopic echo -n 1 {}"
    assert "ready" in lab.run(OTHER, hear.format("/hsr/pose"))
    assert "ready" in lab.run(COMPANION, hear.format("/kobuki/status"))
    assert "ready" in lab.run(SEALED, f"env {MAKER} {hear.format('/kobuki/status')}")
    wait_until(
        lambda: SEALED in lab.run(OTHER, "rosservice call /grip/where", check=False), 20, "its service is called"
    )


def test_a_second_run_changes_nothing(lab):
    status, output = lab.play("site.yml")
    assert status == 0 and re.findall(r"changed=(\d+)", output) == ["0"] * 3, output


def test_verify_judges_what_others_see(lab):
    status, output = lab.play("playbooks/verify.yml")
    assert status == 0 and "PASSED" in output, output
    assert "VERIFICATION of 2 computers" in output and "hsrb is sealed" in output and "not judged" in output, output


def test_a_silent_sealed_roscore_is_named(lab):
    lab.run(SEALED, "systemctl stop foreign-roscore.service pose grip")
    try:
        status, output = lab.play("playbooks/verify.yml", variables={"verify_patience": 3})
    finally:
        lab.run(SEALED, "systemctl start foreign-roscore.service")
    assert status != 0 and "1. the roscore on the sealed computer hsrb does not answer" in output, output


def test_nobody_logs_in_and_teardown_leaves_it_alone(lab):
    status, output = lab.play("playbooks/teardown.yml")
    assert status == 0, output
    assert "hsrb" not in lab.run(COMPANION, "cat /etc/hosts")
    assert lab.run(SEALED, LOOK) == lab.seen
    assert lab.run(SEALED, LOGINS).strip() == "0"
