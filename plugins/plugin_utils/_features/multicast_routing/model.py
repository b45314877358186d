# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Multicast routing in the plan of a computer."""

from __future__ import annotations

from dataclasses import dataclass, field
from ipaddress import IPv4Address

from ..._base.plain import notation
from ..._plan.model import PlanPart


@dataclass(frozen=True)
class MulticastRouting(PlanPart):
    """The group that a gateway passes on, and between which of its addresses."""

    feature, passes_group = "multicast_routing", True

    group: IPv4Address
    addresses: tuple[IPv4Address, ...]
    interfaces: tuple[str, ...] | None = field(default=None, metadata=notation(left_out=True))  # filled in by preflight

    @property
    def own_services(self) -> tuple[str, ...]:
        """Its service."""
        return ("multicast-routing",)


HOOKS = MulticastRouting
