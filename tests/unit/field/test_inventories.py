# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Inventories as people write them, read by Ansible itself: INI and YAML are one fleet, and lists of machines become inventories."""

import field
import pytest
from ansible.inventory.manager import InventoryManager
from ansible.parsing.dataloader import DataLoader
from ansible.vars.manager import VariableManager
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._adopt import facts, write
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._adopt.infer import propose
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import Inventory, read_fleet
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan
from shown import machine, roscore

pytestmark = pytest.mark.whole


def read(path):
    """Let Ansible read an inventory: (its manager, host -> variables)."""
    loader = DataLoader()
    manager = InventoryManager(loader=loader, sources=[str(path)])
    variables = VariableManager(loader=loader, inventory=manager)
    return manager, {host.name: variables.get_vars(host=host, include_hostvars=False) for host in manager.get_hosts()}


def plan_of(name):
    manager, variables = read(field.FOLDER / "inventories" / name)
    groups = manager.groups["robots"].child_groups
    robots = {group.name: [host.name for host in group.get_hosts()] for group in groups}
    ours = {
        host: {key: value for key, value in own.items() if key.startswith("multimaster_")}
        for host, own in variables.items()
    }
    return fleet_plan(read_fleet(Inventory(robots=robots, variables=ours)))


def test_a_fleet_in_ini_and_in_yaml_is_one():
    plan = plan_of("fleet.ini")
    assert plan == plan_of("fleet.yml")
    assert plan.hosts_entries[1].names == ("kobuki2computer", "robot_2", "k2")


@pytest.mark.parametrize("name", ["machines.ini", "machines.yml"])
def test_a_list_of_machines_becomes_an_inventory_that_reaches_the_same(name, tmp_path):
    _manager, given = read(field.FOLDER / "inventories" / name)
    assert len(given) >= 3
    infos = {
        host: machine(host.partition(".")[0], f"192.168.1.{number}/24", masters=[roscore(host, f"192.168.1.{number}")])
        for number, host in enumerate(given, 51)
    }
    proposal = propose([facts.read_machine(host, info) for host, info in infos.items()], {})
    files = write.files(proposal, given)
    assert "hunter2" not in "".join(files.values())
    for path, content in files.items():
        place = tmp_path / path
        place.parent.mkdir(exist_ok=True)
        place.write_text(content)
    _manager, written = read(tmp_path)
    names = {host.machine: host.name for host in proposal.hosts}
    assert set(names) == set(given) and set(names.values()) == set(written)
    for host, own in given.items():
        for key in ("ansible_user", "ansible_port", "ansible_python_interpreter"):
            assert written[names[host]].get(key) == own.get(key)
        assert written[names[host]].get("ansible_host", names[host]) == own.get("ansible_host", host)
