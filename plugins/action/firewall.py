# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action firewall: runs the module firewall, and confirms its changes. A change that cuts the controller off is not confirmed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..plugin_utils._robot_io.confirmation import GuardedAction, Result
from ..plugin_utils._robot_io.ssh import list_ssh_ports


class ActionModule(GuardedAction):
    """Runs the module with the ports by which the controller reaches the other hosts, and confirms over a new connection.

    The plan of the fleet has these ports, so a task with ssh_ports needs no look at the variables of all hosts.
    """

    what = "packet filter rules"

    def answer(self, args: Mapping[str, Any], task_vars: dict[str, Any]) -> Result:
        """Return the answer of the module to the options with these ports."""
        if args.get("ssh_ports") is None:
            args = {**args, "ssh_ports": list_ssh_ports(task_vars.get("hostvars") or {})}
        return super().answer(args, task_vars)
