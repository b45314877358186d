# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Inventories as people write them, read by Ansible itself: INI and YAML are one fleet, and lists of machines become inventories."""

import json
import shlex

import field
import pytest
import yaml
from ansible.inventory.manager import InventoryManager
from ansible.parsing.dataloader import DataLoader
from ansible.vars.manager import VariableManager
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._adopt import facts, write
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._adopt.infer import propose
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import (
    Inventory,
    InventoryProblems,
    read_fleet,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan
from hypothesis import given
from hypothesis import strategies as st
from shown import machine, roscore

pytestmark = pytest.mark.whole


def read(path):
    """Let Ansible read an inventory: (its manager, host -> variables)."""
    loader = DataLoader()
    manager = InventoryManager(loader=loader, sources=[str(path)])
    variables = VariableManager(loader=loader, inventory=manager)
    return manager, {host.name: variables.get_vars(host=host, include_hostvars=False) for host in manager.get_hosts()}


def plan_of(path):
    manager, variables = read(path)
    groups = manager.groups["robots"].child_groups
    robots = {group.name: [host.name for host in group.get_hosts()] for group in groups}
    ours = {
        host: {key: value for key, value in own.items() if key.startswith("multimaster_")}
        for host, own in variables.items()
    }
    return fleet_plan(read_fleet(Inventory(robots=robots, variables=ours)))


def plan_or_problems(path):
    try:
        return plan_of(path)
    except InventoryProblems as problems:
        return problems.problems


def test_a_fleet_in_ini_and_in_yaml_is_one():
    plan, other = (plan_of(field.FOLDER / "inventories" / name) for name in ("fleet.ini", "fleet.yml"))
    assert plan == other
    assert plan.hosts_entries[1].names == ("kobuki2computer", "robot_2", "k2")


def reaches_the_same(given_, place):
    """Adopt a list of machines, and let Ansible read what was written: each is reached as before, and no secret is in it."""
    infos = {
        host: machine(host.partition(".")[0], f"192.168.1.{number}/24", masters=[roscore(host, f"192.168.1.{number}")])
        for number, host in enumerate(given_, 51)
    }
    proposal = propose([facts.read_machine(host, info) for host, info in infos.items()], {})
    files = write.files(proposal, given_)
    assert "hunter2" not in "".join(files.values())
    for path, content in files.items():
        (place / path).parent.mkdir(parents=True, exist_ok=True)
        (place / path).write_text(content)
    _manager, written = read(place)
    names = {host.machine: host.name for host in proposal.hosts}
    assert set(names) == set(given_) and set(names.values()) == set(written)
    for host, own in given_.items():
        for key in ("ansible_user", "ansible_port", "ansible_python_interpreter", "ansible_ssh_common_args"):
            assert "hunter2" in str(own.get(key)) or written[names[host]].get(key) == own.get(key)
        assert written[names[host]].get("ansible_host", names[host]) == own.get("ansible_host", host)


@pytest.mark.parametrize("name", ["machines.ini", "machines.yml"])
def test_a_list_of_machines_becomes_an_inventory_that_reaches_the_same(name, tmp_path):
    _manager, given_ = read(field.FOLDER / "inventories" / name)
    assert len(given_) >= 3
    reaches_the_same(given_, tmp_path)


NAMES = [
    "nuc1",
    "turtle-2",
    "robot_2_nuc",
    "007",
    "12",
    "1e3",
    "on",
    "no",
    "null",
    "y",
    "0x1f",
    "192.168.1.60",
    "a.lab.example",
    "NUC-9",
    "~",
    "1.5",
    "10-1",
]
USERS = ["robot", "yes", "1000", "null", "o'brien", "a b", "ubuntu@lab", "#x", "{user}", "é"]
WORDS = {
    "ansible_user": st.sampled_from(USERS),
    "ansible_port": st.sampled_from([22, 2222]),
    "ansible_python_interpreter": st.sampled_from(["/usr/bin/python3", "auto_silent"]),
    "ansible_ssh_common_args": st.sampled_from(
        ["-o ProxyJump=gate", "-o 'User=a b' -p 22", "-o ServerAliveInterval=5 # not"]
    ),
    "ansible_ssh_pass": st.just("hunter2"),
    "ansible_become_password": st.sampled_from(["hunter2 hunter2", "{{ vault_of_hunter2 }}"]),
    "ansible_host": st.sampled_from(["10.0.0.5", "fd00::7", "gate.lab.example", "0177.0.0.1"]),
}
MACHINES = st.dictionaries(st.sampled_from(NAMES), st.fixed_dictionaries({}, optional=WORDS), min_size=1, max_size=5)


def in_ini(machines):
    """Spell a list of machines in INI, with the variables of every second one in a section of their own."""
    lines, later = ["; machines of the lab", "[old]", ""], []
    for number, (name, values) in enumerate(machines.items()):
        lines += [
            f"[only{number}]",
            " ".join([name, *(f"{key}={shlex.quote(str(value))}" for key, value in values.items() if number % 2)]),
        ]
        if not number % 2 and values:
            later += [f"[only{number}:vars]", *(f"{key} = {value!r}" for key, value in values.items()), "# end"]
    return "\n".join([*lines, "", *later]) + "\n"


def in_yaml(machines):
    """Spell a list of machines in YAML, with an anchor and a merge key for the variables of the first one."""
    first = next(iter(machines))
    hosts = "".join(
        f"    {json.dumps(name)}: {json.dumps(values, ensure_ascii=False)}\n"
        for name, values in machines.items()
        if name != first
    )
    return f"all:\n  vars: {{}}\n  hosts:\n    {json.dumps(first)}:\n      <<: &base {json.dumps(machines[first], ensure_ascii=False)}\n{hosts}"


@pytest.mark.slow
@pytest.mark.parametrize("form", [in_ini, in_yaml])
@given(
    machines=MACHINES,
    slip=st.sampled_from([str, lambda text: text.replace("\n", "\r\n"), lambda text: text.rstrip("\n")]),
)
@field.tries(0.5)
def test_a_mixed_list_becomes_an_inventory_that_reaches_the_same(form, machines, slip, tmp_path_factory):
    folder = tmp_path_factory.mktemp("list")
    (folder / ("list.yml" if form is in_yaml else "list.ini")).write_bytes(slip(form(machines)).encode())
    _manager, given_ = read(folder / ("list.yml" if form is in_yaml else "list.ini"))
    assert set(given_) == set(machines)
    reaches_the_same(given_, folder / "written")


@pytest.mark.slow
@given(
    names=st.lists(st.sampled_from(["ana", "bob", "on", "12", "null"]), min_size=1, max_size=3, unique=True),
    shared=st.fixed_dictionaries(
        {"multimaster_common_network": st.just("192.168.1.0/24")},
        optional={
            "multimaster_rpc_port": st.sampled_from([11611, 12000]),
            "multimaster_answer_broadcast_pings": st.booleans(),
            "multimaster_heartbeat_hz": st.sampled_from([0.5, 1, 2.0]),
            "multimaster_multicast_group": st.just("224.0.0.1"),
        },
    ),
)
@field.tries(0.5)
def test_a_drawn_fleet_in_ini_and_in_yaml_is_one_or_has_the_same_problems(names, shared, tmp_path_factory):
    robots = {
        name: {f"{name}-pc": {"multimaster_address": f"192.168.1.{number}", "multimaster_aliases": [f"r{number}"]}}
        for number, name in enumerate(names, 11)
    }
    lines = []
    for name, hosts in robots.items():
        lines += [
            f"[{name}]",
            *(
                " ".join([host, *(f"{key}={shlex.quote(repr(value))}" for key, value in own.items())])
                for host, own in hosts.items()
            ),
        ]
    lines += ["[robots:children]", *robots, "[robots:vars]", *(f"{key} = {value!r}" for key, value in shared.items())]
    children = {name: {"hosts": hosts} for name, hosts in robots.items()}
    folder = tmp_path_factory.mktemp("fleet")
    (folder / "fleet.ini").write_text("\n".join(lines))
    (folder / "fleet.yml").write_text(
        yaml.safe_dump({"robots": {"children": children, "vars": shared}}, sort_keys=False)
    )
    assert plan_or_problems(folder / "fleet.ini") == plan_or_problems(folder / "fleet.yml")
