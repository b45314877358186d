# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The variables of the tunnel."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network

from ..._base.features import FeaturePart
from ..._inventory import kinds
from ..._inventory.rows import VariableHooks, row, word


@dataclass(frozen=True)
class TunnelVariables(FeaturePart):
    """The tunnel that is the common network of the fleet."""

    feature = "tunnel"

    tunnel: str = word("none", "wireguard")
    tunnel_network: IPv4Network | None = row(kinds.network)
    tunnel_port: int = row(kinds.number(int, 1024, 65535), 51820)
    tunnel_hub: str | None = row(kinds.text)  # compared with the computers: that sentence names them


@dataclass(frozen=True)
class EndpointVariables(FeaturePart):
    """The end of the tunnel on a computer."""

    feature = "tunnel"

    endpoint: IPv4Address | None = row(kinds.endpoint)


HOOKS = VariableHooks(of_fleet=TunnelVariables, of_computer=EndpointVariables)
