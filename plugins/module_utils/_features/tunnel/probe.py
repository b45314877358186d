# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The tunnel of this computer in a verification."""

from ..._probe.part import Part, Settling
from . import wireguard

PROBE = Part(
    "tunnel",
    wireguard.look,
)
SETTLING = Settling(wireguard.count_received, wireguard.wait_for_sessions)
