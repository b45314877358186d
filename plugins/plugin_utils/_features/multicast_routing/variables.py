# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The variable of multicast routing."""

from __future__ import annotations

from dataclasses import dataclass

from ..._base.features import FeaturePart
from ..._inventory.rows import VariableHooks, word


@dataclass(frozen=True)
class RoutingVariables(FeaturePart):
    """The program that passes the group on at the gateways."""

    feature = "multicast_routing"

    multicast_routing: str = word("none", "smcroute")


HOOKS = VariableHooks(of_fleet=RoutingVariables)
