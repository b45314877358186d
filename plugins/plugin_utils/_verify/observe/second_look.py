# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Observations of the second look: what fleet_follow chose, and what multimaster_follow answers by the contract, as types."""

from __future__ import annotations

from dataclasses import dataclass

from ....module_utils._contract.trace import CapturedPacket, Counter, SeenPackets, SentProbe, SentProbes
from .contract import make_dataclasses

__all__ = [
    "CapturedPacket",
    "Counter",
    "FollowPlan",
    "FollowedProbe",
    "SecondLook",
    "SeenPackets",
    "SentProbe",
    "SentProbes",
]

make_dataclasses(SentProbes, SeenPackets)


@dataclass(frozen=True)
class FollowedProbe:
    """A packet that is sent once more and followed. The controller has chosen it."""

    number: int
    sender: str
    target: str
    traffic: str  # the kind of packets that failed: a word of packet_filters.TRAFFIC, or `large`
    protocol: str
    address: str
    port: int = 0
    size: int = 0
    interface_address: str = ""


@dataclass(frozen=True)
class FollowPlan:
    """The probes of a run."""

    probes: tuple[FollowedProbe, ...] = ()


@dataclass(frozen=True)
class SecondLook:
    """All that one computer knows of the second look."""

    probes: tuple[FollowedProbe, ...] = ()
    sent: tuple[SentProbe, ...] = ()
    packets: SeenPackets | None = None  # None where it did not listen
