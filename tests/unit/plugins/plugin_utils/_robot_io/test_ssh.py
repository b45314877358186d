# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The ports of ssh that an inventory names."""

from ansible.errors import AnsibleUndefinedVariable
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io.ssh import list_ssh_ports


class Uncomputable(dict):
    """Variables of a host, of which the port has a template without a value."""

    def get(self, name):
        raise AnsibleUndefinedVariable(f"{name} is undefined")


def test_ports_of_an_inventory():
    hostvars = {
        "gateway": {"ansible_port": 22},
        "inner": {"ansible_port": "2222"},
        "old": {"ansible_ssh_port": 2200},
        "odd": {"ansible_port": "{{ port }}"},
        "large": {"ansible_port": 70000},
        "strange": {"ansible_port": "²"},
        "template": Uncomputable(),
        "plain": {},
    }
    assert list_ssh_ports(hostvars) == [22, 2200, 2222]
