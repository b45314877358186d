# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The ports of ssh in an inventory: a gateway passes them on to the computers behind it, so its packet filter leaves them alone."""

from __future__ import annotations

from typing import Any

from ansible.errors import AnsibleError

# The names by which an inventory has the port of ssh.
PORTS = ("ansible_port", "ansible_ssh_port")


def list_ssh_ports(hostvars: Any) -> list[int]:
    """List the ports by which the controller reaches the hosts. Ansible computes all variables of each host for that."""
    ports = {_read_port(hostvars[host], name) for host in hostvars for name in PORTS}
    return sorted(port for port in ports if 0 < port < 65536)


def _read_port(variables: Any, name: str) -> int:
    """Return a port; 0 without one, also if it cannot be computed."""
    try:
        text = str(variables.get(name))
    except AnsibleError:
        return 0
    return int(text) if text.isdecimal() else 0
