# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The probes of the optional features in a verification, a row for each. The module multimaster_verify has all of them."""

import typing

from .._probe.part import Part, Settling
from .clock.probe import PROBE as CLOCK
from .tunnel.probe import PROBE as TUNNEL
from .tunnel.probe import SETTLING as TUNNEL_SETTLING

PROBES: typing.List[Part] = [
    CLOCK,
    TUNNEL,
]
#: the function that waits until others can measure through it
SETTLINGS: typing.List[Settling] = [
    TUNNEL_SETTLING,
]
