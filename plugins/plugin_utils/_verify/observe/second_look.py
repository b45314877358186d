# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Observations of the second look: what fleet_follow chose, and what multimaster_follow returns, as types.

A field here is a key of the result there, with the same meaning; the documentation of the two modules describes each.
"""

from __future__ import annotations

from dataclasses import dataclass

from .outcomes import Outcome


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
class SentProbe:
    """The end of a probe, as its sender knows it."""

    number: int
    outcome: Outcome = Outcome.NOT_TRIED
    errno: int | None = None
    source_port: int = 0
    data: Outcome = Outcome.NOT_TRIED
    unconfirmed: int = 0  # packets of a question that the other computer has not confirmed


@dataclass(frozen=True)
class SentProbes:
    """The result of multimaster_follow with `action: send`."""

    sent: tuple[SentProbe, ...] = ()


@dataclass(frozen=True)
class Capture:
    """A packet at an interface of a computer."""

    interface: str
    outgoing: bool
    kind: str
    protocol: str
    source: str
    destination: str
    source_port: int = 0
    port: int = 0
    number: int = -1
    sequence: int = 0
    ttl: int = 0
    length: int = 0
    intact: bool = True
    source_mac: str = ""
    target_mac: str = ""
    icmp_type: int = -1
    icmp_code: int = -1
    reporter: str = ""


@dataclass(frozen=True)
class Counter:
    """A counter of the kernel, or a rule of the packet filter, and by how much it has grown."""

    counter: str
    more: int = 0


@dataclass(frozen=True)
class SeenPackets:
    """The result of multimaster_follow with `action: collect`."""

    seen: tuple[Capture, ...] = ()
    missed: int = 0
    full: tuple[str, ...] = ()  # addresses that have sent too much; a stranger among them hides nobody else
    counters: tuple[Counter, ...] = ()
    fixed: tuple[str, ...] = ()  # hardware addresses that were set by hand


@dataclass(frozen=True)
class SecondLook:
    """All that one computer knows of the second look."""

    probes: tuple[FollowedProbe, ...] = ()
    sent: tuple[SentProbe, ...] = ()
    packets: SeenPackets | None = None  # None where it did not listen
