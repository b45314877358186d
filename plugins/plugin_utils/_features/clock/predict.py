# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The packets of the clock, for a prediction."""

from __future__ import annotations

from ..._network.model import Packet
from ..._plan.model import FleetPlan, Member
from ..._predict.prediction import Traffic
from .model import Clock

NTP = 123


def ask_time(fleet: FleetPlan, one: Member, other: Member) -> Packet | None:
    """Make a packet to the source of the time that a computer follows."""
    clock = Clock.find(fleet.computers[one.name])
    return Packet("udp", clock.server, port=NTP) if clock and clock.server and clock.source == other.name else None


HOOKS = Traffic("the time", ask_time)
