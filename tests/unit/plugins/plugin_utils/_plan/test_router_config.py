# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Configuration for routers and gateways of other makes: golden files, and what a shell, the kernel and uci make of them.

The files in golden/router_config are written anew by UPDATE_GOLDEN=1 pytest tests/unit/plugins/plugin_utils/_plan/test_router_config.py
"""

import copy
import ipaddress
import json
import os
import pathlib
import re
import shutil
import subprocess

import pytest
from ansible.errors import AnsibleFilterError
from ansible_collections.rosfleet.multimaster.plugins.filter.router_config import router_config
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import router_config as router_config_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.dialects import DIALECTS
from hypothesis import given
from hypothesis import strategies as st
from mentioned import mentions

GOLDEN = pathlib.Path(__file__).parents[3] / "golden" / "router_config"
PAGE = pathlib.Path(__file__).parents[5] / "docs/start/router.md"

# The report's fleet, but for two things: the gateway of dabo is a device of another make, and car has a wider network.
PLAN = {
    "common_network": "192.168.1.0/24",
    "router": {"name": "", "address": "192.168.1.1"},
    "networks": [
        {
            "robot": "tibi",
            "network": "192.168.11.0/24",
            "gateway": "192.168.11.101",
            "common_address": "192.168.1.201",
            "device": False,
        },
        {
            "robot": "dabo",
            "network": "192.168.10.0/24",
            "gateway": "192.168.10.1",
            "common_address": "192.168.1.202",
            "device": True,
        },
        {
            "robot": "car",
            "network": "192.168.12.0/23",
            "gateway": "192.168.12.101",
            "common_address": "192.168.1.203",
            "device": False,
        },
    ],
}
ROUTES = {entry["network"]: entry["common_address"] for entry in PLAN["networks"]}
OWN = {"router": "192.168.1.0/24", "gateway-dabo": "192.168.10.0/24"}
FILES = {file["path"]: file["content"] for file in router_config(PLAN)}


def routes_of(device):
    """destination -> gateway, as the device needs them."""
    return {network: gateway for network, gateway in ROUTES.items() if network != OWN[device]}


DEVICES = pytest.mark.parametrize("device", OWN)


def test_golden_files():
    if os.environ.get("UPDATE_GOLDEN"):
        for path, content in FILES.items():
            (GOLDEN / path).parent.mkdir(parents=True, exist_ok=True)
            (GOLDEN / path).write_text(content)
    golden = {str(path.relative_to(GOLDEN)): path.read_text() for path in GOLDEN.rglob("*") if path.is_file()}
    assert set(FILES) == set(golden)
    for path, content in FILES.items():
        assert content == golden[path], path


# The shell: OpenWrt and Linux.


@pytest.mark.parametrize("path", [path for path in FILES if path.endswith(".sh")])
def test_scripts_are_posix_shell(path):
    for command in (["sh", "-n"], *([["shellcheck", "--shell=sh", "-"]] if shutil.which("shellcheck") else [])):
        done = subprocess.run(command, input=FILES[path], capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"


@pytest.fixture
def namespace():
    """A network namespace with the address of the router."""
    name = f"router-{os.getpid()}"
    run = ["ip", "netns", "exec", name]
    subprocess.run(["ip", "netns", "add", name], check=True)
    try:
        for command in (
            "ip link set lo up",
            "ip link add eth0 type veth peer name peer",
            "ip address add 192.168.1.1/24 dev eth0",
            "ip link set peer up",
            "ip link set eth0 up",
        ):
            subprocess.run([*run, *command.split()], check=True)
        yield run
    finally:
        subprocess.run(["ip", "netns", "delete", name], check=True)


@pytest.mark.root
@DEVICES
def test_linux_script_makes_the_routes_and_takes_them_back(device, namespace):
    def shell(script):
        done = subprocess.run([*namespace, "sh"], input=script, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def kernel():
        routes = json.loads(shell("ip -json -4 route"))
        return {route["dst"]: route["gateway"] for route in routes if "gateway" in route}

    def redirects():
        return set(shell("cat /proc/sys/net/ipv4/conf/*/send_redirects").split())

    shell("for file in /proc/sys/net/ipv4/conf/*/send_redirects; do echo 1 > $file; done")
    add, remove = (FILES[f"{device}/{file}"] for file in ("linux.sh", "linux.remove.sh"))
    for time in "first", "second":
        shell(add)
        assert kernel() == routes_of(device), time
        assert redirects() == ({"0"} if device == "router" else {"1"})
    for time in "first", "second":
        shell(remove)
        assert (kernel(), redirects()) == ({}, {"1"}), time


# OpenWrt: the sections as uci reads them.

UCI = re.compile(
    r"(?P<verb>set|add_list) (?P<config>[a-z]+)\.(?P<section>[a-z0-9_]+)(\.(?P<option>[a-z_]+))?=('(?P<value>[^']*)'|(?P<type>[a-z]+))"
)


def sections(path):
    """Configuration -> section -> option -> value; the type of a section is its option "" and a list is a list."""
    lines = FILES[path].split("uci batch <<'END'\n")[1].split("\nEND\n")[0].splitlines()
    found = {"network": {}, "firewall": {}}
    for line in lines:
        match = UCI.fullmatch(line)
        assert match, line
        options = found[match["config"]].setdefault(match["section"], {})
        if match["verb"] == "add_list":
            options.setdefault(match["option"], []).append(match["value"])
        else:
            assert (match["option"] or "") not in options, line
            options[match["option"] or ""] = match["value"] if match["option"] else match["type"]
    return found


@DEVICES
@pytest.mark.parametrize("file", ["openwrt.sh", "openwrt.remove.sh"])
def test_openwrt_first_forgets_its_own_sections_and_no_other(device, file, tmp_path):
    """Run with a stand-in for uci that shows the sections there and notes what is deleted."""
    made = sections(f"{device}/openwrt.sh")
    names = [f"{config}.{section}" for config in made for section in made[config]]
    shown = [f"{name}={'route' if name.startswith('network') else 'nat'}\n{name}.target='x'" for name in names]
    (tmp_path / "shown").write_text("\n".join([*shown, "network.lan=interface", "firewall.@zone[0]=zone", ""]))
    (tmp_path / "uci").write_text(
        "#!/bin/sh\n"
        f'case $1 in -q) grep "^$3\\." {tmp_path}/shown ;; delete) echo "$2" >> {tmp_path}/deleted ;; *) exit 9 ;; esac\n'
    )
    (tmp_path / "uci").chmod(0o755)
    loop = FILES[f"{device}/{file}"].split("done\n")[0] + "done\n"
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    subprocess.run(["sh", "-eu"], input=loop, text=True, env=environment, check=True)
    assert (tmp_path / "deleted").read_text().splitlines() == names


# What is asked for.


def test_the_page_has_each_dialect():
    """A row of the table, and a word of the variable that chooses."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    (chosen,) = (line for line in lines if line.startswith("| `router_config_dialects` |"))
    assert set(DIALECTS) <= set(re.findall(r"`(\w+)`", chosen))
    begun = [line.split("`")[1] for line in lines if line.startswith("| `")]
    assert [name for name in begun if name in DIALECTS] == list(DIALECTS)


def test_dialects_and_interfaces_are_chosen():
    files = router_config(PLAN, ["ios"], {"router": {"ios": "Vlan10"}})
    assert [file["path"] for file in files] == [
        "router/ios.txt",
        "router/ios.remove.txt",
        "gateway-dabo/ios.txt",
        "gateway-dabo/ios.remove.txt",
    ]
    assert all("interface Vlan10\n" in file["content"] for file in files[:2])


def test_nothing_without_networks_of_robots():
    assert router_config({"common_network": "192.168.1.0/24", "router": {}, "networks": []}) == []


def test_a_router_without_an_address():
    files = router_config({**PLAN, "router": {}}, ["linux"])
    assert "for the router of the common network 192.168.1.0/24.\n" in files[0]["content"]


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        ((["nosuch"],), "router_config_dialects nosuch"),
        (("ios",), "router_config_dialects ios"),
        (
            (["ios"], {"gateway-tibi": {}}),
            "gateway-tibi router gateway-dabo",
        ),
        ((["ios"], {"router": {"linux": "eth0"}}), "router_config_interfaces.router linux"),
        (
            (["ios"], {"router": {"ios": "x\nreload"}}),
            "router_config_interfaces.router.ios x",
        ),
        ((["ios"], {"router": "Vlan1"}), "router_config_interfaces.router Vlan1"),
        ((["ios"], ["Vlan1"]), "router_config_interfaces Vlan1"),
    ],
)
def test_what_is_wrong_is_one_sentence(arguments, sentence):
    with pytest.raises(AnsibleFilterError) as problem:
        router_config(PLAN, *arguments)
    assert mentions(str(problem.value), *sentence.split())


def test_something_else_than_a_plan():
    with pytest.raises(AnsibleFilterError, match="expected the return of rosfleet.multimaster.fleet_plan"):
        router_config({"changed": False})


@given(st.text(min_size=1, max_size=12))
def test_a_name_is_never_a_command(name):
    plan = copy.deepcopy(PLAN)
    plan["networks"][0]["robot"] = name
    shown = router_config_module.describe_network(name, ipaddress.IPv4Network("192.168.11.0/24"))["robot"]
    assert re.fullmatch(r"[A-Za-z0-9_.-]+", shown)
    for file in router_config(plan):
        assert file["content"] == FILES[file["path"]].replace("tibi", shown)
