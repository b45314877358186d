# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Observations of the packet trace: the choice of fleet_packet_trace, and the answers of multimaster_packet_trace by the contract, as types."""

from __future__ import annotations

from dataclasses import dataclass

from ....module_utils._contract.trace import CapturedPacket, Counter, SeenPackets, SentProbe, SentProbes
from .contract import make_dataclasses

__all__ = [
    "CapturedPacket",
    "Counter",
    "TracePlan",
    "TracedProbe",
    "TraceObservation",
    "SeenPackets",
    "SentProbe",
    "SentProbes",
]

make_dataclasses(SentProbes, SeenPackets)


@dataclass(frozen=True)
class TracedProbe:
    """A packet that is sent once more and followed. The controller has chosen it."""

    number: int
    sender: str
    target: str
    traffic: str  # the kind of packets that failed: a word of packet_filters.TRAFFIC
    protocol: str
    address: str
    port: int = 0
    size: int = 0
    interface_address: str = ""


@dataclass(frozen=True)
class TracePlan:
    """The probes of a run."""

    probes: tuple[TracedProbe, ...] = ()


@dataclass(frozen=True)
class TraceObservation:
    """All that one computer knows of the packet trace."""

    probes: tuple[TracedProbe, ...] = ()
    sent: tuple[SentProbe, ...] = ()
    packets: SeenPackets | None = None  # None if it did not listen
