# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The TCP connections that may be ended for master_sync: only those of nodes with computers of the fleet.

The program with the right to end connections (end_connections.py) asks this. It uses only the plan, nothing that robots say.
"""

from typing import Collection, FrozenSet, Tuple

from ...protocol.members import LOWEST, Members

Endpoint = Tuple[str, int]


def find_refusal(members: Members, local: Endpoint, remote: Endpoint, own: Collection[str]) -> str:
    """The reason for keeping this connection; empty if it may be ended. `own`: the addresses of this computer."""
    if remote[0] in own:
        return f"{remote[0]} is this computer"
    if not members.knows(remote[0]):
        return f"{remote[0]} is no computer of the fleet"
    for _address, port in (local, remote):
        if port < LOWEST:
            return f"port {port} is below {LOWEST}"
        if port in ports(members):
            return f"port {port} is that of a roscore or of discovery"
    return ""


def ports(members: Members) -> FrozenSet[int]:
    """The ports of all roscores and of all discovery nodes."""
    return frozenset(port for robot in members.robots for port in robot.ports)
