# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action firewall hands the ports on by which the controller reaches the hosts of its inventory, unless the task has them."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.action import firewall


@pytest.fixture
def answer(monkeypatch):
    """Return the options that the module gets, as they are."""
    monkeypatch.setattr(firewall.GuardedAction, "answer", lambda _self, args, _task_vars: args)
    return object.__new__(firewall.ActionModule).answer


def test_without_the_option_the_ports_are_those_of_the_inventory(answer):
    hostvars = {"inner": {"ansible_port": 2222}, "gateway": {"ansible_port": 2200}}
    assert answer({"members": []}, {"hostvars": hostvars}) == {"members": [], "ssh_ports": [2200, 2222]}
    assert answer({}, {}) == {"ssh_ports": []}


@pytest.mark.parametrize("ports", [[], [22, "2022"], [22, "a"], [{}, 22]])
def test_ports_of_a_task_stay_as_they_are_and_no_other_host_is_looked_at(answer, ports):
    """The module judges them: it has a sentence for what is no port."""

    class Unread(dict):
        def __iter__(self):
            raise AssertionError("400 computers would compute the variables of 400 hosts each")

    assert answer({"ssh_ports": ports}, {"hostvars": Unread(inner={"ansible_port": 2222})}) == {"ssh_ports": ports}
