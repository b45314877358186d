# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The tunnel in the plan of a computer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from ipaddress import IPv4Address, IPv4Network

from ..._base.plain import notation
from ..._plan.model import PlannedInterface, PlannedRoute, PlanPart

INTERFACE = "multimaster0"
MTU = 1420  # bytes; the value of wg-quick over a network of 1500


@dataclass(frozen=True)
class PlannedPeer:
    """Another computer in the tunnel."""

    computer: str
    networks: tuple[IPv4Network, ...]  # the addresses that are its own in the tunnel, and the network behind it
    endpoint: IPv4Address | None = None  # None: it speaks first


@dataclass(frozen=True)
class Tunnel(PlanPart):
    """The place of a computer in the tunnel that is the common network."""

    feature, carries = "tunnel", "tunnel"

    computer: str
    address: IPv4Address
    network: IPv4Network
    port: int
    peers: tuple[PlannedPeer, ...] = ()
    routes: tuple[PlannedRoute, ...] = ()  # to the networks behind other computers
    hub: bool | None = field(default=None, metadata=notation(left_out=True))  # it passes packets on between its peers

    def find_carrier(self, address: IPv4Address) -> str:
        """Return the peer to which packets for an address go: the computer itself, or the hub. Empty if no peer takes them."""
        near = (peer.computer for peer in self.peers if any(address in network for network in peer.networks))
        return next(near, "")

    @property
    def duty(self) -> str:
        """The words of a picture for a hub."""
        return "hub" if self.hub else ""

    @property
    def forwards(self) -> bool:
        """True if it passes packets of other computers on."""
        return bool(self.hub)

    @property
    def services(self) -> tuple[str, ...]:
        """Its service."""
        return ("tunnel",)

    @property
    def open_ports(self) -> tuple[str, ...]:
        """Its port. Who comes by the tunnel has a key; to others the port does not answer."""
        return (f"{self.port}/udp",)

    @property
    def interface(self) -> PlannedInterface:
        """Its interface, which is not there before the first run."""
        return PlannedInterface(INTERFACE, self.address, self.network, MTU)

    def list_ways(self) -> Mapping[IPv4Network, IPv4Address]:
        """Return the peer that has each network: the computer itself, a gateway, or the hub."""
        return {network: peer.networks[0].network_address for peer in self.peers for network in peer.networks[1:]}


HOOKS = Tunnel
