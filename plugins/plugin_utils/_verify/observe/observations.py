# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Observations: the answers of the modules that measure, as types. Those of multimaster_verify and multicast_verify are in the contract.

`_base.plain.from_plain` reads them, once, in the action fleet_report.

Addresses are texts here, and compared as texts, since a machine may print something else. For example,
`ip route` prints "via inet6 fe80::1" for a route of IPv4 with a next hop of IPv6 (RFC 5549).
"""

from __future__ import annotations

from dataclasses import dataclass

from ....module_utils._contract.clock import ClockState, TimeSource
from ....module_utils._contract.computer import (
    BootDeviation,
    ContainerNames,
    Disk,
    FileLimit,
    FullProcess,
    NodeHost,
    RecentChange,
    RefusedName,
    ServiceState,
    UnregisteredNodes,
)
from ....module_utils._contract.multicast import (
    DatagramCounts,
    GroupMembership,
    Icmp,
    IcmpRound,
    LocalCaller,
    Multicast,
    SendErrors,
    Stranger,
)
from ....module_utils._contract.network import (
    Claim,
    DefaultRoute,
    FilterChain,
    FilterChains,
    FilterRule,
    ForwardingInterface,
    ForwardingSettings,
    Ping,
    PolicyRouting,
    SeenMaster,
    SeenMember,
    TargetRoute,
)
from ....module_utils._contract.ros import (
    AnnouncedHost,
    CrossingParameter,
    CrossingTopic,
    Exchange,
    GivenTopics,
    HeardTopic,
    HostOfNodes,
    IgnoredSender,
    Import,
    ListedMaster,
    MasterList,
    NodeConnection,
    NodeCount,
    NodeParameters,
    NodeTraffic,
    ParameterDifference,
    RegisteredService,
    RegisteredTopic,
    RoscoreAnswer,
    SeenRelay,
    SentTopic,
    SilentNode,
    Stream,
    Talker,
    TopicPublisher,
    UnreachedNode,
)
from ....module_utils._contract.tunnel import SeenTunnel, TunnelPeer
from ....module_utils._contract.verify import Probe, Streams
from ..._plan.preflight import MachineState
from .contract import make_dataclasses
from .packet_trace import TraceObservation

__all__ = [
    "AnnouncedHost",
    "BootDeviation",
    "LocalCaller",
    "RecentChange",
    "Claim",
    "ClockState",
    "NodeConnection",
    "ContainerNames",
    "CrossingParameter",
    "DatagramCounts",
    "CrossingTopic",
    "DefaultRoute",
    "Disk",
    "Exchange",
    "FileLimit",
    "FullProcess",
    "FilterChain",
    "FilterChains",
    "FilterRule",
    "ForwardingInterface",
    "ForwardingSettings",
    "HeardTopic",
    "HostOfNodes",
    "Icmp",
    "IcmpRound",
    "Import",
    "MasterList",
    "ListedMaster",
    "GroupMembership",
    "Multicast",
    "NodeCount",
    "NodeHost",
    "UnregisteredNodes",
    "NodeParameters",
    "Observation",
    "IgnoredSender",
    "FilterState",
    "ParameterDifference",
    "Ping",
    "PolicyRouting",
    "Probe",
    "TopicPublisher",
    "RefusedName",
    "RegisteredService",
    "RegisteredTopic",
    "RoscoreAnswer",
    "TargetRoute",
    "SeenMaster",
    "SeenMember",
    "SeenTunnel",
    "SendErrors",
    "SeenRelay",
    "SentTopic",
    "ServiceState",
    "SilentNode",
    "GivenTopics",
    "Stranger",
    "Stream",
    "Streams",
    "Talker",
    "UnreachedNode",
    "TimeSource",
    "NodeTraffic",
    "TunnelPeer",
]

make_dataclasses(Probe, Streams, Multicast, FilterChains)


# firewall, in check mode


@dataclass(frozen=True)
class FilterState:
    """The packet filter of the computer, compared with its plan."""

    changed: bool = False  # it is not as planned
    failed: bool = False
    msg: str = ""


# All


@dataclass(frozen=True)
class Observation:
    """The results of one computer of the run; None for a module without a result, and `problem` says why."""

    multicast: Multicast | None = None
    probe: Probe | None = None
    unreachable: bool = False
    problem: str = ""
    packet_filter: FilterState | None = None  # None if no packet filter is planned or left over
    found: MachineState | None = None  # None if preflight did not look
    services: tuple[str, ...] | None = None  # the planned services that can run there, by preflight
    streams: Streams | None = None  # None if no throughput was measured
    filters: FilterChains | None = None  # None if the machine was not looked at
    packet_trace: TraceObservation | None = None  # None if nothing was followed
