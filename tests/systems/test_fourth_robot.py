# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""One more robot for a running fleet: one group and one group_vars file. Then it leaves, and nothing of it stays.

The inventory is the shipped one of robots of several computers, cut down to two robots of two computers and the router.
"""

import json
import re
import shutil
import time
from pathlib import Path

import pytest
import yaml

SHIPPED = Path(__file__).resolve().parents[2] / "inventory" / "multi_computer"
KEPT = {"tibi": {"tibi-nav", "tibi-visio"}, "dabo": {"dabo-nav", "dabo-visio"}}
OTHERS = sorted(set().union(*KEPT.values()))
MASTERS = ["dabo-nav", "tibi-visio"]  # one on an inner computer, one on the gateway
ON_COMMON = ["dabo-visio", "router", "tibi-visio"]

# What a person adds.
GROUP = {
    "hosts": {
        "kinton-nav": {"multimaster_address": "192.168.13.100"},
        "kinton-visio": {"multimaster_address": "192.168.13.101"},
    }
}
GROUP_VARS = """\
multimaster_network: 192.168.13.0/24
multimaster_gateway: kinton-visio
multimaster_common_address: 192.168.1.204
multimaster_master: kinton-visio
"""
GATEWAY = "192.168.1.204"
# Where the collection keeps things, and where it may leave them. Not logs; what the roscore remembers is one, until it is
# written anew: a line for each change.
TRACES = (
    "grep -rlE 'kinton|192\\.168\\.13\\.|192\\.168\\.1\\.204' /etc /var/lib /run /usr/local"
    " --exclude-dir=journal --exclude=*.log --exclude=registrations"
)


def change(inventory, edit):
    """Edit hosts.yml as a person would."""
    path = inventory / "hosts.yml"
    content = yaml.safe_load(path.read_text())
    edit(content["robots"]["children"])
    path.write_text(yaml.safe_dump(content))


def cut_down(robots):
    for name in set(robots) - set(KEPT):
        del robots[name]
    for name, computers in KEPT.items():
        robots[name]["hosts"] = {host: own for host, own in robots[name]["hosts"].items() if host in computers}


def masters(lab, host):
    """The names that list_masters returns; none while nobody offers it."""
    listed = lab.run(host, "rosservice call /master_discovery/list_masters", check=False)
    return sorted(re.findall(r"name: \"?([\w-]+)", listed))


def eventually(look, wanted, seconds=60):
    """Look until it is as wanted, for some seconds at most; returns what was last seen."""
    deadline = time.monotonic() + seconds
    while (seen := look()) != wanted and time.monotonic() < deadline:
        time.sleep(0.3)
    return seen


def way(lab, host, address):
    """Over which neighbour a computer sends to an address."""
    return json.loads(lab.run(host, f"ip -json route get {address}"))[0].get("gateway", "")


def lives(lab):
    """Since when each of the others, and its roscore, has been running."""
    started = "stat -c %Y /proc/1; systemctl show --property MainPID multimaster-roscore.service"
    return {host: lab.run(host, started) for host in OTHERS}


@pytest.fixture(scope="module")
def fleet(new_lab, tmp_path_factory):
    """Two robots that talk; the lab has the folder of the inventory."""
    inventory = tmp_path_factory.mktemp("fleet") / "inventory"
    shutil.copytree(SHIPPED, inventory)
    change(inventory, cut_down)
    with new_lab("systems-fourth-robot", inventory) as lab:
        status, output = lab.play("site.yml")
        assert status == 0, output
        yield lab


@pytest.fixture(scope="module")
def grown(fleet):
    """The fleet with kinton; beside it, what ran before."""
    before = lives(fleet)
    change(fleet.inventory, lambda robots: robots.update(kinton=GROUP))
    (fleet.inventory / "group_vars" / "kinton.yml").write_text(GROUP_VARS)
    fleet.become(fleet.inventory)
    status, output = fleet.play("site.yml")
    assert status == 0, output
    return fleet, before


def test_the_others_learn_about_it(grown):
    lab, before = grown
    for host in [*MASTERS, "kinton-visio"]:
        everybody = sorted([*MASTERS, "kinton-visio"])
        assert eventually(lambda host=host: masters(lab, host), everybody) == everybody, host
    for host in OTHERS:
        assert lab.run(host, "getent hosts kinton-nav").split() == ["192.168.13.100", "kinton-nav"]
        assert "1 received" in lab.run(host, "ping -c 1 -W 2 kinton-nav"), host
    for host in ON_COMMON:
        assert way(lab, host, "192.168.13.100") == GATEWAY, host
    assert lives(lab) == before, "no roscore restarts because a robot has come"


def test_inner_computers_hear_each_other(grown):
    lab = grown[0]
    for here, there in (("kinton-nav", "dabo-visio"), ("tibi-nav", "kinton-nav")):
        topic = f"/{here.replace('-', '_')}/said"
        lab.run(here, f"systemd-run --quiet --unit said bash -lc 'rostopic pub -r 5 {topic} std_msgs/String {here}'")
        listed = eventually(lambda there=there, topic=topic: topic in lab.run(there, "rostopic list").split(), True)
        heard = lab.run(there, f"timeout -k 5 20 rostopic echo -n 1 {topic}", check=False)
        lab.run(here, "systemctl stop said")
        assert listed, f"{there} does not list {topic}"
        assert here in heard, f"{here} -> {there}"


def test_it_leaves_and_nothing_of_it_stays(grown):
    lab, before = grown
    status, output = lab.play("playbooks/teardown.yml", "--limit", "kinton")
    assert status == 0, output
    for host in GROUP["hosts"]:
        assert lab.run(host, "ls -d /etc/rosfleet* /var/lib/rosfleet* /run/rosfleet* 2>/dev/null", check=False) == ""

    change(lab.inventory, lambda robots: robots.pop("kinton"))
    (lab.inventory / "group_vars" / "kinton.yml").unlink()
    status, output = lab.play("site.yml")
    assert status == 0, output
    for host in MASTERS:
        assert eventually(lambda host=host: masters(lab, host), MASTERS) == MASTERS, host
        assert "kinton" not in lab.run(host, "rostopic list; rosnode list; rosservice list")
    for host in [*OTHERS, "router"]:
        assert lab.run(host, TRACES, check=False) == "", host
        assert "192.168.13." not in lab.run(host, "ip route show table all"), host

    lab.become(lab.inventory)
    assert lives(lab) == before
    status, output = lab.play("site.yml")
    assert status == 0 and not re.search(r"changed=[1-9]", output), output
