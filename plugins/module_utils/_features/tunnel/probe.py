# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The tunnel of this computer in a verification."""

from ..._probe.part import Part, Settling
from . import wireguard

PROBE = Part(
    "tunnel",
    wireguard.look,
    {"up": None, "public_key": "", "port": 0, "time_s": None, "mtu": 0, "peers": []},
)
SETTLING = Settling(wireguard.count_received, wireguard.wait_for_sessions)
