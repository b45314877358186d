# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The back end for netplan, over files as netplan generates them; the real one is in the Molecule scenario `routes`."""

import os

import pytest
import yaml
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.boot import Boot
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.kernel import RouteSpec
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.managers import contract, netplan
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.managers import networkmanager as nm
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.record import read_record
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import commands
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.network import NetworkInterface

ROUTES = [
    RouteSpec("192.168.11.0/24", "192.168.1.201", "eth0"),
    RouteSpec("0.0.0.0/0", "192.168.1.201", "eth0", metric=50),
    RouteSpec("10.5.0.0/16", "192.168.1.9", "eth0", 30, 100, "192.168.1.14", True),
    RouteSpec("226.0.0.0/8", "", "eth0"),
    RouteSpec("10.6.0.0/16", type="blackhole"),
    RouteSpec("::/0", "fd00:1::201", "eth0", 1024),
]


def write(root, path, text):
    place = os.path.join(str(root), path.lstrip("/"))
    os.makedirs(os.path.dirname(place), exist_ok=True)
    with open(place, "w") as stream:
        stream.write(text)


def machine(root, files):
    """A machine on which networkd has chosen these files: interface -> file."""
    for index, (_interface, file) in enumerate(sorted(files.items()), 2):
        text = "ADMIN_STATE=configured\n" + ("NETWORK_FILE=%s\n" % file if file else "")
        write(root, "/run/systemd/netif/links/%d" % index, text)
    interfaces = {name: NetworkInterface(name, index) for index, name in enumerate(sorted(files), 2)}
    return contract.MachineContext(interfaces, booted=False, root=str(root))


def back_end(root, files, recorded=None):
    return netplan.BackEnd(machine(root, files), recorded or {})


def generated(name):
    return "/run/systemd/network/10-netplan-%s.network" % name


def test_netplans_generated_files_are_owned(tmp_path):
    end = back_end(tmp_path, {"eth0": generated("eth0"), "eth1": "/etc/systemd/network/10-eth1.network", "lo": ""})
    assert end.list_interfaces() == {"eth0"}
    assert end.find_place("eth0") == netplan.FILE
    with pytest.raises(Problem, match="eth1 .*nothing that netplan has generated"):
        end.find_place("eth1")


@pytest.mark.parametrize(
    ("path", "text", "section"),
    [
        (None, "", "ethernets"),
        ("/run/systemd/network/10-netplan-x.netdev", "[NetDev]\nName=x\nKind=bridge\n", "bridges"),
        ("/run/systemd/network/10-netplan-x.netdev", "[NetDev]\nName=x\nKind=bond\n", "bonds"),
        ("/run/systemd/network/10-netplan-x.netdev", "[NetDev]\nName=x\nKind=vlan\n", "vlans"),
        ("/run/systemd/network/10-netplan-x.netdev", "[NetDev]\nName=x\nKind=wireguard\n", "tunnels"),
        ("/run/netplan/wpa-x.conf", "network={\n}\n", "wifis"),
    ],
)
def test_the_section_is_that_of_the_definition(tmp_path, path, text, section):
    if path:
        write(tmp_path, path, text)
    wanted = back_end(tmp_path, {"eth0": generated("x")}).render(netplan.FILE, {"eth0": ROUTES})
    assert list(yaml.safe_load(wanted)["network"]) == ["version", section]
    assert list(yaml.safe_load(wanted)["network"][section]) == ["x"]


NM = "NM-0b1c0000-1111-2222-3333-444455556666"
PROFILES = [
    ("lan", "[connection]\nid=netplan-lan\ntype=ethernet\n", "ethernets", "lan"),
    # NetworkManager's own profiles, with names of people: Ubuntu keeps them in netplan since 23.10
    (NM, "[connection]\nid=Wired connection 1\ntype=ethernet\n", "ethernets", NM),
    (NM, "[connection]\nid=robot-lab-wired\ntype=ethernet\n", "ethernets", NM),
    (NM, "[connection]\nid=netplan-other\ntype=bridge\n", "bridges", NM),
    ("eth0%3A1", "[connection]\nid=netplan-eth0:1\ntype=vlan\n", "vlans", "eth0:1"),
    (
        "wlan0-Robot%20lab%2F5",
        "[connection]\nid=lab wifi\ntype=wifi\n\n[wifi]\nssid=Robot lab/5\n",
        "wifis",
        "wlan0",
    ),
    (NM + "-a-b", "[connection]\nid=netplan-x\ntype=wifi\n\n[wifi]\nssid=a-b\n", "wifis", NM),
    ("w-%20lead%5Cx", "[connection]\nid=x\ntype=wifi\n\n[wifi]\nssid=\\slead\\\\x\n", "wifis", "w"),
]


@pytest.mark.parametrize(("file", "text", "section", "name"), PROFILES)
def test_the_definition_behind_a_profile_of_networkmanager(tmp_path, monkeypatch, file, text, section, name):
    start = str(tmp_path / "netplan-")
    place = f"{start}{file}.nmconnection"
    write("/", place, text)
    monkeypatch.setattr(nm, "NETPLANS", start)
    monkeypatch.setattr(nm, "active_profiles", lambda: {"eth0": nm.Active("1-2", False, place)})
    end = netplan.BackEnd(contract.MachineContext({"eth0": NetworkInterface("eth0", 99999)}, True, str(tmp_path)), {})
    assert end._definitions == {"eth0": netplan.Definition(section, name, place)}


def test_a_profile_of_another_form_has_no_definition():
    assert netplan.read_name("/run/NetworkManager/system-connections/netplan-w-Lab.nmconnection", "Other") == ""
    assert netplan.read_name("/run/NetworkManager/system-connections/lan.nmconnection", None) == ""


def test_the_file_says_what_netplan_reads(tmp_path):
    end = back_end(tmp_path, {"eth0": generated("eth0"), "eth1": generated("id1")})
    text = end.render(netplan.FILE, {"eth0": ROUTES})
    assert text.startswith(contract.HEADER)
    assert yaml.safe_load(text) == {
        "network": {
            "version": 2,
            "ethernets": {
                "eth0": {
                    "routes": [
                        {"to": "192.168.11.0/24", "via": "192.168.1.201", "metric": 0},
                        {"to": "0.0.0.0/0", "via": "192.168.1.201", "metric": 50},
                        {
                            "to": "10.5.0.0/16",
                            "via": "192.168.1.9",
                            "from": "192.168.1.14",
                            "metric": 30,
                            "table": 100,
                            "on-link": True,
                        },
                        {"to": "226.0.0.0/8", "metric": 0, "scope": "link"},
                        {"to": "10.6.0.0/16", "metric": 0, "type": "blackhole"},
                        {"to": "::/0", "via": "fd00:1::201", "metric": 1024},
                    ]
                }
            },
        }
    }


def test_no_routes_no_file(tmp_path):
    write(tmp_path, netplan.FILE, contract.HEADER)
    plan = Boot(machine(tmp_path, {"eth0": generated("eth0")}), read_record({}))
    plan.backends["netplan"].check = lambda wanted: None
    plan.plan({})
    assert plan.wanted == {netplan.FILE: None}
    os.remove(tmp_path / netplan.FILE.lstrip("/"))
    without_file = Boot(plan.machine, read_record({}))
    without_file.plan({})
    assert without_file.wanted == {}


EARLIER = "/etc/netplan/90-rosfleet-multimaster.yaml"


def test_a_file_of_an_earlier_version_is_moved_behind_those_of_others(tmp_path, tool):
    where = machine(tmp_path, {"eth0": generated("eth0")})
    write(tmp_path, generated("eth0"), "[Match]\nName=eth0\n")
    text = netplan.BackEnd(where, {}).render(netplan.FILE, {"eth0": ROUTES[:1]})
    write(tmp_path, EARLIER, text)
    write(tmp_path, "/etc/netplan/99_config.yaml", "site")
    plan = Boot(where, read_record({}))
    tool["generated"] = {generated("eth0"): "Destination=192.168.11.0/24\n"}
    plan.plan({"netplan": {"eth0": ROUTES[:1]}})
    assert plan.wanted == {netplan.FILE: text, EARLIER: None}
    assert sorted(tool["files"]) == ["etc/netplan/99_config.yaml", netplan.FILE.lstrip("/")]
    plan.apply()
    assert sorted(os.listdir(tmp_path / "etc/netplan")) == ["99_config.yaml", os.path.basename(netplan.FILE)]
    assert plan.undo() == [] and commands.text(str(tmp_path / EARLIER.lstrip("/"))) == text


def test_a_definition_of_two_interfaces_is_refused(tmp_path):
    end = back_end(tmp_path, {"eth0": generated("all"), "eth1": generated("all")})
    with pytest.raises(Problem, match='definition "all" is that of eth1 too'):
        end.find_place("eth0")


def test_written_for_root_alone_and_read_back(tmp_path):
    end = back_end(tmp_path, {"eth0": generated("eth0")})
    os.makedirs(str(tmp_path / "etc/netplan"))
    text = end.render(netplan.FILE, {"eth0": ROUTES})
    end.write(netplan.FILE, text)
    assert os.stat(end.machine.path(netplan.FILE)).st_mode & 0o777 == 0o600
    assert end.read() == {netplan.FILE: text}
    end.write(netplan.FILE, None)
    assert end.read() == {}


def test_a_file_of_somebody_else_is_not_touched(tmp_path):
    write(tmp_path, netplan.FILE, "network: {version: 2}\n")
    with pytest.raises(Problem, match="is there and not ours"):
        back_end(tmp_path, {}).read()


@pytest.fixture
def tool(monkeypatch):
    """The command netplan, as a function over the copy of its folders."""
    seen = {}

    def run(argv, limit):
        seen["argv"] = argv[:-1]
        seen["files"] = {
            os.path.relpath(os.path.join(folder, name), argv[-1]): commands.text(os.path.join(folder, name))
            for folder, _folders, names in os.walk(argv[-1])
            for name in names
        }
        seen["copy"] = argv[-1]
        for path, text in seen.get("generated", {}).items():
            write(argv[-1], path, text)
        return seen.get("answer", commands.Answer(0, b"", ""))

    monkeypatch.setattr(netplan.commands, "run", run)
    return seen


def test_netplan_is_asked_on_a_copy_that_goes_away(tmp_path, tool):
    write(tmp_path, "/etc/netplan/01-site.yaml", "site")
    write(tmp_path, netplan.FILE, "old")
    os.symlink("/nowhere", str(tmp_path / "etc/netplan/dangling.yaml"))
    end = netplan.BackEnd(machine(tmp_path, {}), {})
    end.check({netplan.FILE: "new"})
    assert tool["argv"] == ["netplan", "generate", "--root-dir"]
    assert tool["files"] == {"etc/netplan/01-site.yaml": "site", netplan.FILE.lstrip("/"): "new"}
    end.check({netplan.FILE: None})
    assert tool["files"] == {"etc/netplan/01-site.yaml": "site"}
    assert not os.path.exists(tool["copy"])
    assert commands.text(str(tmp_path / netplan.FILE.lstrip("/"))) == "old"


def test_its_refusal_is_one_sentence(tmp_path, tool):
    tool["answer"] = commands.Answer(
        1, b"", "** WARNING **: open\nERROR: eth0: NetworkManager only supports unicast routes\n\n"
    )
    with pytest.raises(
        Problem, match=r'refuses %s .* \("ERROR: eth0: NetworkManager only supports unicast routes"\)' % netplan.FILE
    ):
        back_end(tmp_path, {}).check({netplan.FILE: "new"})
    assert not os.path.exists(tool["copy"])
