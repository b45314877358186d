# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The planned port of the packets that a packet filter drops: pure, a component and the rows that it explains in, a text out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from ..._plan.model import FleetPlan
from ..checks.engine import Row
from ..components.component import Component
from ..context.packet_filters import ROSCORE

_RPC, _UDP = "rpc", "udp"


def find_port(component: Component, rows: Iterable[Row], fleet: FleetPlan) -> str:
    """Find the port that a filter names, such as "11511"; empty for a filter of packets of any port.

    Each robot may have ports of its own: that of the master counts which most of the rows have asked for.
    """
    packets = component.mode.partition(" ")[0]
    if component.kind != "filter" or packets not in (_RPC, _UDP, ROSCORE):
        return ""
    if packets == _UDP:
        return str(fleet.multicast_port)
    robots = Counter(plan.robot for row in rows if (plan := fleet.computers.get(row.target)))
    masters = (fleet.master_of[robot] for robot, _rows in robots.most_common() if robot in fleet.master_of)
    asked = next(masters, None)
    if asked is None:
        return ""
    return str(asked.rpc_port if packets == _RPC else fleet.computers[asked.computer].roscore_port)
