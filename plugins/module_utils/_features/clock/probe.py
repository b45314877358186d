# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The clock of this computer in a verification: whether something keeps it right, and whom it follows."""

from ..._probe.measure import resources
from ..._probe.part import Part
from .sources import time_sources

PATIENCE = 8.0  # seconds for a time service that was just started

PROBE = Part(
    "clock",
    lambda: dict(resources.clock(), **time_sources(PATIENCE)),
)
