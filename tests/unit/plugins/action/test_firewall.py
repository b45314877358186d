# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action firewall hands the ports on by which the controller reaches the hosts of its inventory."""

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
