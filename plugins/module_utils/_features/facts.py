# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The facts that the optional features read of a machine, a row for each. The module multimaster_info has all of them."""

import typing

from .._probe.facts.part import FactPart
from .clock.facts import FACT as CLOCK
from .multicast_routing.facts import FACT as MULTICAST_ROUTING
from .tunnel.facts import FACT as TUNNEL

FACTS: typing.List[FactPart] = [
    CLOCK,
    MULTICAST_ROUTING,
    TUNNEL,
]
