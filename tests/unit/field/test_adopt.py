# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Machines as people have them, drawn by chance: adopt says nothing that is false, and its inventory is one."""

import field
import pytest
import yaml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._adopt import facts, write
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._adopt.infer import propose
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import InventoryProblems, read_fleet
from hypothesis import given
from hypothesis import strategies as st
from shown import machine, roscore

NAMES = ["ana", "Bob", "robot_2_nuc", "192.168.1.77", "ubuntu", "cid.lab.example", "_x", "turtle-1", "all"]
HOSTNAMES = ["ana", "ubuntu", "robot_2_nuc", "robot_2", "localhost", "turtle-1", "", "CID"]
LINKS = [
    ("eth0", "192.168.1.{}/24", {}),
    ("eth0", "192.168.2.{}/24", {}),
    ("wlan0", "10.42.0.{}/24", {}),
    ("tailscale0", "100.64.3.{}/32", {"point_to_point": True}),
    ("bat0", "10.7.3.{}/32", {}),
    ("wg0", "10.8.0.{}/24", {"point_to_point": True, "multicast": False}),
    ("wg0", "10.8.0.{}/32", {"point_to_point": True, "multicast": False}),
    ("ppp0", "10.64.64.{}/32", {"point_to_point": True}),
    ("docker0", "172.17.0.1/16", {}),
    ("eth1", "192.168.8.1/24", {}),  # a sensor's network, the same in each robot
    ("eth2", "169.254.9.{}/16", {}),
    ("eth3", "203.0.114.{}/32", {}),
    ("can0", None, {}),
]
URIS = ["", "http://ana:11311", "http://robot_2_nuc:11311", "http://192.168.1.11:11311/", "http://localhost:11311", "http://[fd00::1]:11311",
        "http://10.0.0.5:11311\r", "http://:11311", "http://100.64.3.12:11411", "HTTP://ANA:11311", "http://robot：11311"]  # fmt: skip


@st.composite
def fleets(draw):
    """Draw machines by their names in a list: {name: what multimaster_info answers}."""
    infos = {}
    for number, name in enumerate(draw(st.lists(st.sampled_from(NAMES), min_size=1, max_size=6, unique=True)), 10):
        host, uri = draw(st.sampled_from(HOSTNAMES)), draw(st.sampled_from(URIS))
        info = machine(host, uri=uri, forwards=draw(st.integers(0, 1)))
        for device, address, more in draw(st.lists(st.sampled_from(LINKS), max_size=3, unique_by=str)):
            interfaces = machine("", *([address.format(number)] if address else []))["interfaces"]
            link = {
                "name": device,
                "up": True,
                "loopback": False,
                "addresses": [],
                "multicast": True,
                "point_to_point": False,
            }
            info["interfaces"].append({**link, **(interfaces[0] if interfaces else {}), "name": device, **more})
        addresses = [one["address"] for entry in info["interfaces"] for one in entry["addresses"]]
        if draw(st.booleans()):
            info["masters"] = [roscore(host or "x", draw(st.sampled_from(["", *addresses])))]
        infos[name] = info
    return infos


def all_sentences(proposal):
    return [*proposal.guesses(), *proposal.left_out.values()]


@pytest.mark.slow
@given(infos=fleets())
@field.tries(2)
def test_adopt_tells_no_falsehood(infos):
    read = {name: facts.read_machine(name, info) for name, info in infos.items()}
    proposal = propose(read.values(), {})
    placed = [host.machine for host in proposal.hosts]
    assert sorted([*placed, *proposal.left_out]) == sorted(infos)  # each of them once
    for host in proposal.hosts:
        own = {one["address"] for entry in infos[host.machine]["interfaces"] for one in entry["addresses"]}
        assert host.choices["address"].value in own
        assert set(host.choices["aliases"].value if "aliases" in host.choices else ()) <= {
            infos[host.machine]["hostname"]
        }
    for name, why in proposal.left_out.items():
        assert "no roscore runs on it" not in why or not infos[name]["masters"]
        assert "no roscore runs on any machine" not in why or not any(info["masters"] for info in infos.values())
        assert "no ROS_MASTER_URI" not in why or not read[name].masters
        assert "share" not in why or any(info["masters"] for info in infos.values())
    if not proposal.robots:
        return
    try:
        read_fleet(proposal.inventory())
    except InventoryProblems as problems:
        # What machines do not show is asked for, and the proposal says so itself.
        assert all(
            "multimaster_gateway" in text or "multimaster_common_address" in text for text in problems.problems
        ), problems.problems
        assert any("was not found" in text for text in all_sentences(proposal))
    files = write.files(proposal, {})
    assert set(yaml.safe_load(files["hosts.yml"])["robots"]["children"]) == {robot.name for robot in proposal.robots}


@pytest.mark.slow
@given(infos=fleets())
@field.tries()
def test_single_addresses_of_the_common_network_are_discovered_by_unicast(infos):
    proposal = propose([facts.read_machine(name, info) for name, info in infos.items()], {})
    if not proposal.robots:
        return
    single = {
        one["address"]
        for info in infos.values()
        for entry in info["interfaces"]
        for one in entry["addresses"]
        if one["prefix"] == 32
    }
    robots = [robot for robot in proposal.robots if "network" not in robot.choices]
    used = {computer.choices["address"].value for robot in robots for computer in robot.computers}
    assert not single & used or proposal.choices["transport"].value == "unicast"


SECRET = "hunter2"
CONNECTIONS = {
    "ana": {"ansible_user": "robot", "ansible_ssh_pass": SECRET, "ansible_port": 2222},
    "robot_2_nuc": {
        "ansible_ssh_common_args": f"-o ProxyCommand='sshpass -p {SECRET} ssh -W %h:%p gate'",
        "ansible_host": "10.0.0.5",
    },
    "192.168.1.77": {
        "ansible_become_password": SECRET,
        "ansible_python_interpreter": "/usr/bin/python3",
        "note": SECRET,
    },
    "turtle-1": {"ansible_become_pass": "{{ lookup('env', 'PASS') }}", "ansible_user": "yes"},
}


@pytest.mark.parametrize("seen", [{"ansible_user"}])
@given(infos=fleets())
@field.tries(0.5)
def test_no_secret_of_a_list_is_written(seen, infos):
    proposal = propose([facts.read_machine(name, info) for name, info in infos.items()], {})
    if not proposal.robots:
        return
    files = write.files(proposal, CONNECTIONS)
    assert SECRET not in "".join(files.values()) and "lookup(" not in "".join(files.values())
    texts = [yaml.safe_load(text) for text in files.values()]
    if "ana" in [host.machine for host in proposal.hosts]:
        assert str(texts).count("'robot'") >= len(seen)
