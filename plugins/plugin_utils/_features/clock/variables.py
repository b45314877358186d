# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The variable of the clock."""

from __future__ import annotations

from dataclasses import dataclass

from ..._base.features import FeaturePart
from ..._inventory import kinds
from ..._inventory.rows import VariableHooks, row


@dataclass(frozen=True)
class ClockVariables(FeaturePart):
    """The source of the fleet's time."""

    feature = "clock"

    clock: str | None = row(kinds.text)  # compared with the computers and robots: that sentence names them


HOOKS = VariableHooks(of_fleet=ClockVariables)
