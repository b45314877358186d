# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The clock of a computer in its plan."""

from __future__ import annotations

from dataclasses import dataclass, field
from ipaddress import IPv4Address, IPv4Network

from ..._base.plain import notation
from ..._plan.model import PlanPart


@dataclass(frozen=True)
class Clock(PlanPart):
    """The time of a computer: of the source, or its own, which others may ask for."""

    feature = "clock"

    source: str  # the computer that gives the time
    server: IPv4Address | None = None  # its address; None: this computer is the source
    networks: tuple[IPv4Network, ...] = ()  # the networks that may ask the source
    # Preflight fills these in: whose time service is there already, and stays; whether the clock can be set there.
    kept: str | None = field(default=None, metadata=notation(left_out=True))
    settable: bool | None = field(default=None, metadata=notation(left_out=True))

    @property
    def duty(self) -> str:
        """The words of a picture for a source."""
        return "clock" if self.server is None else ""


HOOKS = Clock
