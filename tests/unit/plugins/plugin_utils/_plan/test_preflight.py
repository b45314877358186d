# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The plan of a computer compared with its machine."""

import copy
import dataclasses
import json
import os
import pathlib
import re
import subprocess
import sys

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.features import FEATURES
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import from_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import preflight, providers, units
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import (
    ComputerPlan,
    RobotNetwork,
    Setting,
)
from mentioned import mentions

PLAN = {
    "computer": "kobuki1computer",
    "address": "192.168.1.229",
    "common_address": "192.168.1.229",
    "network": "192.168.1.0/24",
    "networks": [{"network": "192.168.1.0/24", "address": "192.168.1.229"}],
    "is_master": True,
    "is_router": False,
    "sysctl": [],
    "routes_expected": [],
    "roscore": "managed",
    "roscore_port": 11311,
    "ros_setup": "auto",
    "environment": {"ROS_MASTER_URI": "http://kobuki1computer:11311", "ROS_HOSTNAME": "kobuki1computer"},
    "ports": [
        {"protocol": "tcp", "port": 11311},
        {"protocol": "udp", "port": 11511},
        {"protocol": "tcp", "port": 11611},
    ],
    "provider": "bundled",
    "discovery": {"send_mcast": True, "interface": "192.168.1.229"},
    "limits": [],
}
INFO = {
    "hostname": "kobuki1computer",
    "owned": ["services-multimaster"],
    "python": "3.11.2",
    "systemd": {"running": True, "net_admin": True},
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
            "python": "/usr/bin/python3",
            "python_version": "3.11.2",
            "nodes": [],
            "commands": {"roscore": "/usr/bin/roscore"},
            "environment": {"PATH": "/opt/ros/noetic/bin", "ROS_DISTRO": "noetic"},
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
    return preflight.compare(from_plain(ComputerPlan, {**PLAN, **plan}), info)


def test_a_robot_with_ros_in_a_container_alone():
    def change(info):
        info["ros"].update(problem="There is no ROS 1.", chosen=None, found=[])

    _first, second = compare(change, roscore="existing").problems
    assert "may be in a container; expected rospy" in second and "apt-get install python3-rospy " in second
    assert len(compare(change).problems) == 1


def test_a_machine_like_its_plan():
    programs = units.render_programs("bundled", "/usr/bin/python3", {}, 11311)
    plan = dataclasses.replace(
        from_plain(ComputerPlan, PLAN),
        programs=programs,
        packages=(),
        firewall_due=False,
        nft_missing=False,
        features_due={f"{feature.name}_due": False for feature in FEATURES if "plan" in feature.hooks},
    )
    assert compare() == preflight.Comparison((), (), plan, preflight.MachineState())


def test_an_interface_in_the_network_of_another_robot_is_refused_and_told_apart():
    def change(info):
        info["interfaces"].append({**info["interfaces"][1], "name": "docker0"})
        info["interfaces"][2]["addresses"] = [{"address": "172.17.0.1", "prefix": 16}]
        info["interfaces"][2]["port_of"] = ""

    info = copy.deepcopy(INFO)
    change(info)
    own = {"gateway": "172.17.4.1", "common_address": "192.168.1.7"}
    networks = [from_plain(RobotNetwork, {"robot": "dabo", "network": "172.17.4.0/24", **own})]
    told = preflight.compare(from_plain(ComputerPlan, PLAN), info, networks)
    what = "docker0 has 172.17.0.1/16, in the network of dabo (172.17.4.0/24)"
    assert what in told.problems[0] and len(told.problems) == 1
    assert told.state.overlaps == (what,) and told.state.noted == ()


def _make_vpn(interface):
    """Give an interface the shape of Tailscale's."""
    interface.update(point_to_point=True)
    interface["addresses"][0].update(prefix=32)


def test_a_vpn_with_single_addresses_may_be_the_common_network():
    def change(info):
        _make_vpn(info["interfaces"][1])

    quiet = {"send_mcast": False, "interface": "192.168.1.229"}
    assert not compare(change, discovery=quiet).problems
    routes = [{"destination": "192.168.11.0/24", "gateway": "192.168.1.201"}]
    (problem,) = compare(change, discovery=quiet, routes=routes).problems
    assert "on which no route has a gateway" in problem


PROBLEMS = {
    "address elsewhere": (
        lambda info: info["interfaces"][1]["addresses"][0].update(address="10.0.0.5"),
        "multimaster_address is 192.168.1.229, but the machine has 10.0.0.5 on eth0",
    ),
    "another prefix length": (
        lambda info: info["interfaces"][1]["addresses"][0].update(prefix=16),
        "multimaster_address is 192.168.1.229, on eth0 with the prefix length 16; expected 24",
    ),
    "a single address, and multicast": (
        lambda info: _make_vpn(info["interfaces"][1]),
        "eth0 .* is a point-to-point link with a single address, which carries no multicast; .* 'unicast'",
    ),
    "IPv6 alone": (
        lambda info: info["interfaces"][1].update(addresses=[{"address": "fc94::1", "prefix": 128}]),
        "is 192.168.1.229, but the machine has only addresses of IPv6; expected an IPv4 address",
    ),
    "interface down": (lambda info: info["interfaces"][1].update(up=False), "interface eth0 .* is down"),
    "port of a bridge": (
        lambda info: info["interfaces"][1].update(port_of="br0"),
        "interface eth0 .* 192.168.1.229 is a port of br0; expected the address on br0 itself",
    ),
    "on the loopback": (
        lambda info: info["interfaces"][1].update(name="lo0", loopback=True, multicast=False),
        "interface lo0 .* is the loopback, .* expected the address on an interface that is in 192.168.1.0/24",
    ),
    "no multicast": (lambda info: info["interfaces"][1].update(multicast=False), "does not do multicast"),
    "no systemd": (lambda info: info["systemd"].update(running=False), "systemd does not run"),
    "no ROS": (lambda info: info["ros"].update(chosen=None), "no ROS was found .* multimaster_ros_setup"),
    "ROS problem": (lambda info: info["ros"].update(problem="there are two"), 'kobuki1computer: "there are two"'),
    "missing module": (
        lambda info: info["ros"]["chosen"].update(missing=["std_srvs"]),
        "lacks the Python modules std_srvs; .*apt-get install python3-std-srvs",
    ),
    "missing module of conda": (
        lambda info: info["ros"]["chosen"].update(
            kind="workspace", distro="noetic", missing=["std_srvs"], environment={"CONDA_PREFIX": "/opt/conda"}
        ),
        "lacks the Python modules std_srvs; .*conda install ros-noetic-std-srvs",
    ),
    "odd interpreter": (
        lambda info: info["ros"]["chosen"].update(python="+/bin/python3"),
        r"The program '\+/bin/python3' is to be run by a unit of systemd; expected an absolute path",
    ),
    "odd roscore": (
        lambda info: info["ros"]["chosen"].update(commands={"roscore": "+/bin/sh"}),
        r"The program '\+/bin/sh' is to be run by a unit of systemd; expected an absolute path",
    ),
    "no roscore": (lambda info: info["ros"]["chosen"].update(commands={"roscore": ""}), "has no roscore"),
    "old Python": (lambda info: info["ros"]["chosen"].update(python_version="3.6.9"), "has Python 3.6.9; expected 3.8"),
    "foreign roscore": (
        lambda info: info["ports"].append(holder(11311, unit="roscore.service")),
        r"""TCP port 11311 is held by "rosmaster" \(pid 812, user "robot", roscore.service\).*multimaster_roscore to 'existing'""",
    ),
    "another discovery": (
        lambda info: info["ports"].append(holder(11511, "udp")),
        'UDP port 11511 is held by "rosmaster" .*only one discovery node',
    ),
}


@pytest.mark.parametrize("case", PROBLEMS)
def test_what_stands_against_the_plan(case):
    change, expected = PROBLEMS[case]
    found = compare(change)
    assert len(found.problems) == 1
    assert re.search(expected, found.problems[0]), found.problems


def test_the_ports_owner_is_named_in_check_mode_too():
    twice = [
        holder(11311, unit="session-3.scope"),
        holder(11311, unit="session-3.scope"),
        holder(11611),
        holder(11511, "udp"),
    ]
    found = compare(lambda info: (info.update(ports=twice), info["systemd"].update(running=False)))
    assert len(found.problems) == 4
    assert found.state.runs == (
        'kobuki1computer: TCP port 11311: "rosmaster" (pid 812, user "robot", session-3.scope), but the plan has '
        "multimaster-roscore.service.",
        'kobuki1computer: UDP port 11511 and TCP port 11611: "rosmaster" (pid 812, user "robot"), but the plan has '
        "multimaster-discovery.service.",
    )
    assert found.state.noted == found.problems[:1] and "systemd does not run" in found.problems[0]


def test_a_computer_without_our_files_has_their_environment():
    assert compare().state == preflight.MachineState()
    found = compare(lambda info: info.update(owned=[])).state
    assert not found.set_up
    assert found.environment["ROS_MASTER_URI"] == "http://kobuki1computer:11311"
    assert found.environment["ROS_HOSTNAME"] == "kobuki1computer"
    assert found.environment["PATH"].startswith("/opt/ros/noetic/bin:") and found.environment["PATH"].endswith(":/bin")
    bare = compare(lambda info: (info.update(owned=[]), info["ros"].update(chosen=None))).state
    assert (bare.set_up, bare.environment) == (False, {})


@pytest.mark.parametrize("is_master", [True, False])
def test_modules_that_are_gone_are_told_of_every_computer(is_master):
    more = {} if is_master else {"is_master": False, "ports": [], "discovery": {}}
    assert not compare(**more).state.broken_ros
    found = compare(lambda info: info["ros"]["chosen"].update(missing=["rospy"]), **more).state
    assert 'lacks the Python modules "rospy"' in found.broken_ros

    def refuse(info):  # a set-up file that is not sourced: nothing was imported
        info["ros"]["chosen"].update(kind="prefix", missing=["rospy"], environment={}, python_version="")

    assert not compare(refuse, **more).state.broken_ros

    def lose(info, found=()):
        info["ros"].update(chosen=None, problem="There is no ROS 1", found=list(found))

    assert bool(compare(lose, **more).state.broken_ros) == is_master  # a second computer needs none
    assert not compare(lambda info: (lose(info), info.update(owned=[])), **more).state.broken_ros
    assert not compare(lambda info: lose(info, [{"version": "1"}, {"version": "1"}]), **more).state.broken_ros

    def miss(info):  # the part could not be read, as on a computer without a free processor
        info["ros"].update(chosen=None, problem="", found=[])

    assert not compare(miss, **more).state.broken_ros

    def fail(info):  # the program that imports them could not run at all, as where systemd starts no unit
        sentence = "The modules of Debian's packages cannot be imported: 'Failed to run event loop'."
        info["ros"].update(problem=sentence)
        info["ros"]["chosen"].update(missing=["rospy"], python_version="", problem=sentence)

    assert not compare(fail, **more).state.broken_ros


def test_what_our_services_hold_is_no_strangers():
    own = [holder(11311, unit="multimaster-roscore.service"), holder(11511, "udp", "multimaster-discovery.service")]
    assert compare(lambda info: info.update(ports=own)).problems == ()


def test_the_relay_may_have_its_former_name():
    ports = [{"protocol": "tcp", "port": 11911}]
    for unit, count in (("multimaster-border.service", 0), ("multimaster-relay.service", 0), ("other.service", 1)):
        found = compare(lambda info, unit=unit: info.update(ports=[holder(11911, unit=unit)]), ports=ports)
        assert len(found.problems) == count


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
    assert mentions(found.warnings[0], "/home/a/.bashrc", "line 7", "ROS_IP=10.0.0.5")


def test_what_a_shell_has_is_told_with_its_person_also_without_a_line():
    export = {
        "file": "/home/a/robot_env.sh",
        "line": 2,
        "variable": "ROS_IP",
        "text": "export ROS_IP=$IP",
        "value": "10.0.0.5",
    }
    asked = {**export, "person": "ann", "shell": "login"}
    (found,) = compare(lambda info: info["exports"].append(asked)).warnings
    assert mentions(found, "/home/a/robot_env.sh, line 2", "login", "ann", "ROS_IP=10.0.0.5")
    (found,) = compare(lambda info: info["exports"].append({**asked, "file": "", "line": 0})).warnings
    assert mentions(found, "login", "ann", "ROS_IP=10.0.0.5") and "line 0" not in found
    told = compare(lambda info: info["exports"].append(asked)).state
    assert told.set_by == {"ROS_IP": "/home/a/robot_env.sh, line 2"}


def test_an_export_of_the_planned_value_is_no_matter():
    value = "http://kobuki1computer:11311/"
    export = {"file": "/home/a/.bashrc", "line": 7, "variable": "ROS_MASTER_URI", "text": "", "value": value}
    assert compare(lambda info: info["exports"].append(export)).warnings == ()


def test_shells_that_get_nothing_are_not_judged():
    export = {"file": "/home/a/.bashrc", "line": 7, "variable": "ROS_IP", "text": "", "value": "10.0.0.5"}

    def change(info):
        info["exports"].append(export)
        info["sshd"]["includes_drop_ins"] = False

    assert [len(compare(change, shells=reach).warnings) for reach in ("all", "names", "none")] == [2, 2, 0]


def test_another_name_of_the_machine_is_named():
    assert 'calls itself "debian"' in compare(lambda info: info.update(hostname="debian")).warnings[0]


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
    assert mentions(problem, "multimaster_common_address", "192.168.1.201", "192.168.11.101", "eth1.5")


def test_multicast_counts_on_the_common_interface_alone():
    assert compare(lambda info: two_interfaces(info, (True, False)), **GATEWAY).problems == ()
    (problem,) = compare(lambda info: two_interfaces(info, (False, True)), **GATEWAY).problems
    assert mentions(problem, "eth0", "multimaster_common_address", "192.168.1.201", "multicast")


@pytest.mark.parametrize(
    ("addresses", "muted"),
    [
        ([], True),
        ([{"address": "fe80::1", "prefix": 64, "family": "inet6"}], True),
        ([{"address": "10.0.0.1", "prefix": 24, "family": "inet"}], False),  # the kernel takes what comes in there
    ],
)
def test_what_is_below_a_macvlan_without_an_address_is_muted(addresses, muted):
    def change(info):
        own = info["interfaces"][1]
        info["interfaces"].append(dict(own, name="eth0.5", addresses=addresses))
        own.update(name="upper", macvlan_of="eth0.5")

    found = compare(change, sysctl=[])
    assert found.problems == ()
    assert found.plan.sysctl == ((Setting("net.ipv4.conf.eth0/5.arp_ignore", "8"),) if muted else ())


def test_the_plan_gets_the_names_of_the_interfaces():
    sysctl = [{"name": "net.ipv4.conf.{common}.send_redirects", "value": "0"}]
    found = compare(two_interfaces, **GATEWAY, sysctl=sysctl)
    assert found.problems == ()
    assert found.plan.sysctl == (Setting("net.ipv4.conf.eth0.send_redirects", "0"),)


@pytest.mark.parametrize(
    ("way", "problem"),
    [
        ({"gateway": "192.168.11.101", "error": ""}, ""),
        ({"gateway": "192.168.11.7", "error": ""}, "found: one by 192.168.11.7"),
        ({"gateway": None, "error": ""}, "found: a way without a gateway"),
        ({"gateway": None, "error": "Network is unreachable"}, 'found: "Network is unreachable"'),
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
    assert not problem or (mentions(found[0], "192.168.10.0/24", "192.168.11.101") and problem in found[0])


def test_a_router_needs_no_ros():
    found = compare(
        lambda info: [info.pop(part) for part in ("ros", "ports", "exports", "sshd")],
        is_router=True,
        is_master=False,
        discovery={},
    )
    assert found.problems == found.warnings == ()


# A machine that runs no module


@pytest.mark.slow
def test_a_python_that_is_too_old_is_one_sentence(tmp_path):
    root = pathlib.Path(__file__).resolve().parents[5]
    old = tmp_path / "python2.7"
    old.write_text("#!/bin/sh\ncat > /dev/null\necho 'ImportError: No module named typing' >&2\nexit 1\n")
    old.chmod(0o755)
    host = {"multimaster_address": "192.168.1.5", "multimaster_common_network": "192.168.1.0/24"}
    host.update(ansible_connection="local", ansible_become=False, ansible_python_interpreter=str(old))
    inventory = tmp_path / "hosts.json"
    inventory.write_text(json.dumps({"robots": {"children": {"kobuki": {"hosts": {"kobuki-pc": host}}}}}))
    done = subprocess.run(
        [pathlib.Path(sys.executable).with_name("ansible-playbook"), "-i", inventory, "site.yml"],
        cwd=root,
        env={**os.environ, "ANSIBLE_COLLECTIONS_PATH": str(root / ".work/collections"), "ANSIBLE_NOCOLOR": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 2
    assert mentions(done.stdout, "kobuki-pc", "ImportError")
    assert mentions(done.stdout, "ansible_python_interpreter")


# Upstream as provider


PACKAGES = providers.debian_packages("noetic", is_master=True)


def noetic(info, installed=(), candidates=PACKAGES, python="3.8.10"):
    """A robot with a ROS distribution of its package sources."""
    setup = "/opt/ros/noetic/setup.bash"
    info["ros"]["chosen"].update(kind="prefix", setup=setup, distro="noetic", python_version=python)
    info["packages"] = [
        {
            "name": name,
            "installed": "1.3.2" if name in installed else "",
            "candidate": "1.3.2" if name in candidates else "",
            "ours": False,
        }
        for name in PACKAGES
    ]


@pytest.mark.parametrize("installed", [(), PACKAGES])
def test_packages_of_upstream_that_are_there_or_to_be_had(installed):
    found = compare(lambda info: noetic(info, installed), provider="fkie_apt")
    assert found.problems == found.warnings == ()
    assert found.plan.packages == tuple(PACKAGES)
    start = "ExecStart=/usr/bin/python3 /opt/ros/noetic/lib/fkie_master_discovery/master_discovery "
    assert start in found.plan.programs["discovery"].service


def test_packages_that_no_source_has_are_named():
    (problem,) = compare(lambda info: noetic(info, candidates=PACKAGES[:1]), provider="fkie_apt").problems
    assert "have no ros-noetic-fkie-master-sync, ros-noetic-fkie-multimaster-msgs; expected them" in problem
    assert mentions(problem, "ROS", "noetic")


def test_an_installed_package_needs_no_source():
    assert compare(lambda info: noetic(info, PACKAGES, candidates=()), provider="fkie_apt").problems == ()


def test_debians_ros_has_no_packages_of_upstream():
    (problem,) = compare(provider="fkie_apt").problems
    assert mentions(problem, "Debian", "multimaster_fkie")
    assert mentions(problem, "indigo", "melodic", "noetic", "multimaster_provider")


def test_a_further_computer_needs_the_messages_alone():
    found = compare(noetic, provider="fkie_apt", is_master=False, ports=[], discovery={})
    assert (found.problems, found.plan.packages) == ((), ("ros-noetic-fkie-multimaster-msgs",))
    assert found.plan.programs == units.NO_PROGRAMS
    found = compare(
        lambda info: noetic(info, candidates=()), provider="fkie_apt", is_master=False, ports=[], discovery={}
    )
    assert found.problems == () and "have no ros-noetic-fkie-multimaster-msgs" in found.warnings[0]
    assert found.plan.packages == ()  # apt would fail half way


def test_upstream_runs_on_an_older_python():
    assert compare(lambda info: noetic(info, python="2.7.18"), provider="fkie_apt").problems == ()
    (problem,) = compare(lambda info: noetic(info, python="2.7.18")).problems
    assert mentions(problem, "Python", "2.7.18", "3.8")
    assert "set multimaster_provider to 'fkie_apt' or 'fkie_existing'" in problem


def workspace(info, **changes):
    """A robot with an installation of upstream: {package: what differs}."""
    info["ros"]["chosen"].update(
        kind="workspace",
        setup="/home/robot/ws/devel/setup.bash",
        nodes=[
            {
                "package": node.package,
                "executable": node.executable,
                "path": f"/home/robot/ws/src/{node.package}/nodes/{node.executable}",
                "problem": "",
                **changes.get(node.package, {}),
            }
            for node in providers.nodes_to_look_for("fkie_existing")
        ],
    )


def test_a_node_at_a_path_that_a_unit_cannot_have_is_refused():
    def odd(info):
        workspace(info)
        for node in info["ros"]["chosen"]["nodes"]:
            node.update(path="/ws/a\nExecStartPre=+/bin/sh -c id", problem="")

    found = compare(odd, provider="fkie_existing")
    assert len(found.problems) == 2 and found.plan.programs == units.NO_PROGRAMS
    assert all("expected an absolute path" in problem and "\n" not in problem for problem in found.problems)


GONE = {"path": "", "problem": ""}
NO_NEW = {"fkie_master_discovery": GONE, "fkie_master_sync": GONE}
NO_OLD = {"master_discovery_fkie": GONE, "master_sync_fkie": GONE}
NO_MAS = {"fkie_mas_discovery": GONE, "fkie_mas_sync": GONE}
BROKEN = {"problem": "x.msg cannot be imported: ImportError: no"}


@pytest.mark.parametrize(
    ("there", "package"),
    [
        ({}, "fkie_master_sync"),
        (NO_OLD, "fkie_master_sync"),
        (NO_NEW, "master_sync_fkie"),
        ({"fkie_master_sync": BROKEN}, "master_sync_fkie"),
    ],
)
def test_an_installation_of_either_name(there, package):
    found = compare(lambda info: workspace(info, **there), provider="fkie_existing")
    assert found.problems == () and found.plan.packages == ()
    start = f"ExecStart=/usr/bin/python3 /home/robot/ws/src/{package}/nodes/master_sync "
    assert start in found.plan.programs["sync"].service


@pytest.mark.parametrize(
    ("there", "expected"),
    [
        (
            {**NO_OLD, **NO_NEW, **NO_MAS},
            "fkie_master_discovery/master_discovery is not there and fkie_master_sync/master_sync is",
        ),
        (
            {**NO_OLD, **NO_MAS, "fkie_master_sync": GONE},
            "/setup.bash fkie_master_sync/master_sync is not there; expected both",
        ),
        (
            {"fkie_master_sync": BROKEN, **NO_OLD, **NO_MAS},
            r'fkie_master_sync/master_sync does not run \("x.msg cannot be imported: ImportError: no"\); expected both',
        ),
    ],
)
def test_an_installation_that_is_not_whole(there, expected):
    found = compare(lambda info: workspace(info, **there), provider="fkie_existing")
    assert len(found.problems) == 1 and re.search(expected, found.problems[0]), found.problems
    assert found.plan.programs == units.NO_PROGRAMS


def test_what_upstream_cannot_do_is_a_warning():
    said = ["kobuki1computer: multimaster_exports is declared, but ..."]
    assert compare(workspace, provider="fkie_existing", limits=said).warnings == tuple(said)


def test_old_releases_hide_nothing():
    hiding = {**PLAN["discovery"], "hide_topics": ["*"]}
    assert compare(workspace, provider="fkie_existing", discovery=hiding).warnings == ()
    found = compare(lambda info: workspace(info, **NO_NEW), provider="fkie_existing", discovery=hiding)
    assert "is one from before 1.0, which cannot hide anything" in found.warnings[0]


def test_a_packet_filter_is_due_when_planned_or_left_over():
    assert compare(firewall={"networks": []}).plan.firewall_due
    assert compare(lambda info: info.update(owned=["files-firewall", "routes"])).plan.firewall_due


def guarded(readable=True, address="192.168.1.229"):
    def change(info):
        info["filters"] = {"readable": readable, "chains": [], "arp": []}
        info["interfaces"][1]["addresses"][0]["address"] = address

    return compare(change, firewall={"guards": [{"networks": ["10.77.0.0/24"], "interface": "{own}"}]}).plan


def test_a_guard_has_the_name_of_its_interface():
    assert [guard.interface for guard in guarded().firewall.guards] == ["eth0"]
    assert guarded().firewall_due and guarded().packages == ("nftables",)
    assert not guarded(address="192.168.1.9").firewall_due  # it has no name now, so there is nothing to compare


def second(guards, first=None, **changes):
    """A second interface with the planned address; `first` changes the first one."""

    def change(info):
        info["filters"] = {"readable": True, "chains": [], "arp": []}
        eth0 = info["interfaces"][1]
        info["interfaces"].append({**eth0, "name": "eth1", **changes})
        eth0.update(first or {})

    planned = [{"networks": ["10.77.0.0/24"], "interface": "{own}"}] if guards else []
    return compare(change, firewall={"guards": planned})


@pytest.mark.parametrize("wrong", [{"up": False}, {"port_of": "eth1"}, {"loopback": True}])
def test_of_two_interfaces_with_the_address_the_one_that_can_be_used_has_the_guard(wrong):
    for found, name in ((second(True, wrong), "eth1"), (second(True, **wrong), "eth0")):
        assert not found.problems and [guard.interface for guard in found.plan.firewall.guards] == [name]


def test_two_interfaces_with_the_address_are_refused_where_a_guard_needs_one():
    found = second(True)
    (problem,) = found.problems
    assert mentions(problem, "kobuki1computer", "multimaster_address", "192.168.1.229", "eth0", "eth1")
    assert not found.plan.firewall_due
    assert not second(False).problems


def test_where_no_interface_can_be_used_its_problem_is_named():
    (problem,) = second(True, {"up": False}, up=False).problems
    assert mentions(problem, "eth0", "multimaster_address", "192.168.1.229", "down")


def test_nft_is_installed_before_a_guard_where_it_is_missing():
    assert guarded(readable=False).nft_missing and not guarded().nft_missing


def test_a_folder_of_metrics_that_is_not_there_is_one_sentence():
    def there(info):
        info.update(folders=["/srv/metrics"])

    assert compare(there, metrics_folder="/srv/metrics").problems == compare().problems == ()
    (problem,) = compare(metrics_folder="/srv/metrics").problems
    assert mentions(problem, "kobuki1computer", "multimaster_metrics", "textfile", "/srv/metrics")


def test_services_that_cannot_run_here_are_left_out_and_named():
    services = ["address", "watchdog", "roscore", "discovery", "connections", "sync"]
    assert compare(services=services).plan.services == tuple(services)
    found = compare(lambda info: info["systemd"].update(net_admin=False), services=services)
    assert found.plan.services == ("watchdog", "roscore", "discovery", "sync") and not found.problems
    assert len(found.warnings) == 2
    assert all(mentions(warning, "systemd", "CAP_NET_ADMIN") for warning in found.warnings)
    found = compare(lambda info: info.update(python="3.6.9"), services=services)
    assert found.plan.services == ("address", "roscore", "discovery", "sync")
    found_too = compare(lambda info: info.update(python="3.6.9"), services=[*services, "metrics"])
    assert found_too.plan.services == found.plan.services and "node_exporter has no metrics" in found_too.warnings[2]
    assert [warning.partition(";")[0] for warning in found.warnings] == ["kobuki1computer: its Python is 3.6.9"] * 2


def test_a_question_without_an_answer_is_told():
    def change(info):
        info["problems"] = ['The part exports of the machine could not be read: "no source".']
        info["silent_shells"] = [
            {"person": "robot", "shell": "interactive"},
            {"person": "robot", "shell": "login"},
            {"person": "guest", "shell": "files"},
        ]

    unread, of_robot, of_guest = compare(change).state.warned
    assert mentions(unread, "kobuki1computer", "exports", "no source", "unknown", "run it again")
    assert mentions(of_robot, '"interactive" shell and the "login" shell of "robot" gave no answer', "unknown")
    assert mentions(of_guest, 'the files of "guest" gave no answer')
    assert compare(change, shells="none").state.warned == (unread,)
