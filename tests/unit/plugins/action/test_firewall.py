# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action firewall hands the ports on by which the controller reaches the hosts of its inventory."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.action import firewall


def test_ports_of_an_inventory():
    hostvars = {
        "gateway": {"ansible_port": 22},
        "inner": {"ansible_port": "2222"},
        "old": {"ansible_ssh_port": 2200},
        "odd": {"ansible_port": "{{ port }}"},
        "large": {"ansible_port": 70000},
        "plain": {},
    }
    assert firewall.ssh_ports(hostvars) == {22, 2222, 2200}


@pytest.mark.parametrize("ports", [[], [22, "2022"], [22, "a"], [{}, 22]])
def test_ports_of_a_task_stand_before_those_of_the_inventory(monkeypatch, ports):
    """The module judges them: it has a sentence for what is no port."""
    monkeypatch.setattr(firewall.GuardedAction, "answer", lambda _self, args, _task_vars: args)
    action = object.__new__(firewall.ActionModule)
    hostvars = {"inner": {"ansible_port": 2222}, "gateway": {"ansible_port": 2200}}
    assert action.answer({"ssh_ports": ports}, {"hostvars": hostvars}) == {"ssh_ports": [*ports, 2200, 2222]}
