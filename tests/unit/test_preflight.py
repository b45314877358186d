# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The plan of a computer compared with its machine."""

import copy
import re

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils import _preflight

PLAN = {
    "computer": "kobuki1computer",
    "address": "192.168.1.229",
    "common_address": "192.168.1.229",
    "networks": [{"network": "192.168.1.0/24", "address": "192.168.1.229"}],
    "is_master": True,
    "is_router": False,
    "sysctl": [],
    "routes_expected": [],
    "multicast_routing": {},
    "roscore": "managed",
    "roscore_port": 11311,
    "ros_setup": "auto",
    "environment": {"ROS_MASTER_URI": "http://kobuki1computer:11311", "ROS_HOSTNAME": "kobuki1computer"},
    "ports": [
        {"protocol": "tcp", "port": 11311},
        {"protocol": "udp", "port": 11511},
        {"protocol": "tcp", "port": 11611},
    ],
    "discovery": {"send_mcast": True, "interface": "192.168.1.229"},
}
INFO = {
    "hostname": "kobuki1computer",
    "systemd": {"running": True},
    "interfaces": [
        {
            "name": "lo",
            "up": True,
            "multicast": False,
            "loopback": True,
            "addresses": [{"address": "127.0.0.1", "prefix": 8}],
        },
        {
            "name": "eth0",
            "up": True,
            "multicast": True,
            "loopback": False,
            "addresses": [{"address": "192.168.1.229", "prefix": 24}],
        },
    ],
    "ros": {
        "problem": "",
        "chosen": {
            "kind": "debian",
            "setup": "",
            "distro": "",
            "missing": [],
            "python_version": "3.11.2",
            "commands": {"roscore": "/usr/bin/roscore"},
        },
    },
    "ports": [],
    "exports": [],
    "sshd": {"installed": True, "includes_drop_ins": True, "other_setenv": []},
}


def holder(port, protocol="tcp", unit=""):
    return {"protocol": protocol, "port": port, "pid": 812, "command": "rosmaster", "user": "robot", "unit": unit}


def compare(change=None, **plan):
    info = copy.deepcopy(INFO)
    if change:
        change(info)
    return _preflight.compare({**PLAN, **plan}, info)


def test_a_machine_like_its_plan():
    assert compare() == _preflight.Comparison((), (), PLAN)


PROBLEMS = {
    "address elsewhere": (
        lambda info: info["interfaces"][1]["addresses"][0].update(address="10.0.0.5"),
        "multimaster_address is 192.168.1.229, but the machine has 10.0.0.5 on eth0",
    ),
    "another prefix length": (
        lambda info: info["interfaces"][1]["addresses"][0].update(prefix=16),
        "multimaster_address is 192.168.1.229, on eth0 with the prefix length 16; expected 24",
    ),
    "interface down": (lambda info: info["interfaces"][1].update(up=False), "interface eth0 .* is down"),
    "no multicast": (lambda info: info["interfaces"][1].update(multicast=False), "does not do multicast"),
    "no systemd": (lambda info: info["systemd"].update(running=False), "systemd does not run"),
    "no ROS": (lambda info: info["ros"].update(chosen=None), "no ROS was found .* multimaster_ros_setup"),
    "ROS problem": (lambda info: info["ros"].update(problem="there are two"), "kobuki1computer: there are two"),
    "missing module": (
        lambda info: info["ros"]["chosen"].update(missing=["std_srvs"]),
        "lacks the Python modules std_srvs; .*apt-get install python3-std-srvs",
    ),
    "no roscore": (lambda info: info["ros"]["chosen"].update(commands={"roscore": ""}), "has no roscore"),
    "old Python": (lambda info: info["ros"]["chosen"].update(python_version="3.6.9"), "has Python 3.6.9; expected 3.8"),
    "foreign roscore": (
        lambda info: info["ports"].append(holder(11311, unit="roscore.service")),
        r"TCP port 11311 is held by rosmaster \(pid 812, user robot, roscore.service\).*multimaster_roscore to 'existing'",
    ),
    "another discovery": (
        lambda info: info["ports"].append(holder(11511, "udp")),
        "UDP port 11511 is held by rosmaster .*only one discovery node",
    ),
}


@pytest.mark.parametrize("case", PROBLEMS)
def test_what_stands_against_the_plan(case):
    change, expected = PROBLEMS[case]
    found = compare(change)
    assert len(found.problems) == 1
    assert re.search(expected, found.problems[0]), found.problems


def test_what_our_services_hold_is_no_strangers():
    own = [holder(11311, unit="multimaster-roscore.service"), holder(11511, "udp", "multimaster-discovery.service")]
    assert compare(lambda info: info.update(ports=own)).problems == ()


def test_an_existing_roscore_may_hold_its_port():
    assert compare(lambda info: info.update(ports=[holder(11311)]), roscore="existing").problems == ()


def test_an_existing_roscore_that_is_not_there_is_named():
    found = compare(roscore="existing")
    assert found.problems == ()
    assert "nothing listens on TCP port 11311" in found.warnings[0]


def test_a_computer_without_services_only_warns_of_a_missing_ros():
    found = compare(lambda info: info["ros"].update(chosen=None), is_master=False, ports=[], discovery={})
    assert found.problems == ()
    assert "no ROS was found" in found.warnings[0]


def test_an_older_export_is_named_with_file_and_line():
    export = {
        "file": "/home/a/.bashrc",
        "line": 7,
        "variable": "ROS_IP",
        "text": "export ROS_IP=10.0.0.5",
        "value": "10.0.0.5",
    }
    found = compare(lambda info: info["exports"].append(export))
    assert found.problems == ()
    assert "/home/a/.bashrc, line 7 sets ROS_IP (export ROS_IP=10.0.0.5)" in found.warnings[0]


def test_an_export_of_the_planned_value_is_no_matter():
    value = "http://kobuki1computer:11311/"
    export = {"file": "/home/a/.bashrc", "line": 7, "variable": "ROS_MASTER_URI", "text": "", "value": value}
    assert compare(lambda info: info["exports"].append(export)).warnings == ()


def test_another_name_of_the_machine_is_named():
    assert "calls itself 'debian'" in compare(lambda info: info.update(hostname="debian")).warnings[0]


GATEWAY = {
    "address": "192.168.11.101",
    "common_address": "192.168.1.201",
    "networks": [
        {"network": "192.168.11.0/24", "address": "192.168.11.101"},
        {"network": "192.168.1.0/24", "address": "192.168.1.201"},
    ],
    "discovery": {"send_mcast": True, "interface": "192.168.1.201"},
}


def two_interfaces(info, multicast=(True, True)):
    info["interfaces"][1]["addresses"] = [{"address": "192.168.1.201", "prefix": 24}]
    info["interfaces"].append(dict(info["interfaces"][1], name="eth1.5"))
    info["interfaces"][2]["addresses"] = [{"address": "192.168.11.101", "prefix": 24}]
    for interface, does in zip(info["interfaces"][1:], multicast):
        interface["multicast"] = does


def test_a_gateway_is_in_both_networks():
    assert compare(two_interfaces, **GATEWAY).problems == ()
    (problem,) = compare(lambda info: (two_interfaces(info), info["interfaces"].pop(1)), **GATEWAY).problems
    assert "multimaster_common_address is 192.168.1.201, but the machine has 192.168.11.101 on eth1.5" in problem


def test_multicast_counts_on_the_common_interface_alone():
    assert compare(lambda info: two_interfaces(info, (True, False)), **GATEWAY).problems == ()
    (problem,) = compare(lambda info: two_interfaces(info, (False, True)), **GATEWAY).problems
    assert "the interface eth0 with multimaster_common_address 192.168.1.201 does not do multicast" in problem


def test_the_plan_gets_the_names_of_the_interfaces():
    routing = {"group": "239.255.0.1", "addresses": ["192.168.11.101", "192.168.1.201"]}
    sysctl = [{"name": "net.ipv4.conf.{common}.send_redirects", "value": "0"}]

    def change(info):
        two_interfaces(info)
        info["multicast_routing"] = {"smcrouted": "/usr/sbin/smcrouted", "others": []}

    found = compare(change, **GATEWAY, multicast_routing=routing, sysctl=sysctl)
    assert found.problems == ()
    assert found.plan["multicast_routing"]["interfaces"] == ["eth1.5", "eth0"]
    assert found.plan["sysctl"] == [{"name": "net.ipv4.conf.eth0.send_redirects", "value": "0"}]


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        ({"smcrouted": "", "others": []}, "there is no smcrouted; .*apt-get install smcroute"),
        ({"smcrouted": "/usr/sbin/smcrouted", "others": ["pimd.service"]}, "pimd.service passes multicast on already"),
    ],
)
def test_what_stands_against_multicast_routing(found, expected):
    def change(info):
        two_interfaces(info)
        info["multicast_routing"] = found

    routing = {"group": "239.255.0.1", "addresses": ["192.168.11.101", "192.168.1.201"]}
    (problem,) = compare(change, **GATEWAY, multicast_routing=routing).problems
    assert re.search(expected, problem)


def test_multicast_routing_needs_two_interfaces():
    def change(info):
        info["interfaces"][1]["addresses"] = [
            {"address": entry["address"], "prefix": 24} for entry in GATEWAY["networks"]
        ]
        info["multicast_routing"] = {"smcrouted": "/usr/sbin/smcrouted", "others": []}

    routing = {"group": "239.255.0.1", "addresses": ["192.168.11.101", "192.168.1.201"]}
    (problem,) = compare(change, **GATEWAY, multicast_routing=routing).problems
    assert "both its addresses are on eth0" in problem


@pytest.mark.parametrize(
    ("way", "problem"),
    [
        ({"gateway": "192.168.11.101", "error": ""}, ""),
        ({"gateway": "192.168.11.7", "error": ""}, "found: one by 192.168.11.7"),
        ({"gateway": None, "error": ""}, "found: a way without a gateway"),
        ({"gateway": None, "error": "Network is unreachable"}, "found: Network is unreachable"),
    ],
)
def test_a_missing_route_back_is_named(way, problem):
    plan = {
        "address": "192.168.11.100",
        "common_address": "",
        "networks": [{"network": "192.168.11.0/24", "address": "192.168.11.100"}],
        "routes_expected": [{"destination": "192.168.10.0/24", "gateways": ["192.168.11.101"]}],
        "is_master": False,
        "discovery": {},
    }

    def change(info):
        info["interfaces"][1]["addresses"][0]["address"] = "192.168.11.100"
        info["ways"] = [{"destination": "192.168.10.1", **way}]

    found = compare(change, **plan).problems
    assert len(found) == bool(problem)
    assert not problem or (
        "towards 192.168.10.0/24 there is no route by 192.168.11.101" in found[0] and problem in found[0]
    )


def test_a_router_needs_no_ros():
    found = compare(
        lambda info: [info.pop(part) for part in ("ros", "ports", "exports", "sshd")],
        is_router=True,
        is_master=False,
        discovery={},
    )
    assert found.problems == found.warnings == ()
