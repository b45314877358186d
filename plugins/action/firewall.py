# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action firewall: runs the module firewall, and confirms its changes. A change that cuts the controller off is not confirmed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..plugin_utils._robot_io.confirmation import GuardedAction, Result

# The names by which an inventory has the port of ssh.
PORTS = ("ansible_port", "ansible_ssh_port")


class ActionModule(GuardedAction):
    """Runs the module with the ports by which the controller reaches the other hosts, and confirms over a new connection."""

    what = "packet filter rules"

    def answer(self, args: Mapping[str, Any], task_vars: dict[str, Any]) -> Result:
        """Return the answer of the module to the options with these ports."""
        ports = args.get("ssh_ports") or []
        if isinstance(ports, list):
            args = {**args, "ssh_ports": [*ports, *sorted(ssh_ports(task_vars.get("hostvars") or {}))]}
        return super().answer(args, task_vars)


def ssh_ports(hostvars: Any) -> set[int]:
    """Return the ports of ssh in an inventory: a gateway passes them on to the computers behind it."""
    ports = set()
    for host in hostvars:
        for name in PORTS:
            value = hostvars[host].get(name)
            if str(value).isdigit() and 0 < int(str(value)) < 65536:
                ports.add(int(str(value)))
    return ports
