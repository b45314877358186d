# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The scene of a proposal: the machines, their groups and their names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network

from . import facts, groups


@dataclass(frozen=True)
class AdoptionScene:
    """The scene that all functions here look at."""

    machines: groups.Machines
    found: groups.FleetGroups
    names: Mapping[str, tuple[str, str]]

    def machine(self, name: str) -> facts.FoundMachine:
        return self.machines.by_name[name]

    def name(self, machine: str) -> str:
        return self.names[machine][0]

    def addresses(self, network: IPv4Network) -> Mapping[str, IPv4Address]:
        return self.machines.networks[network]

    @property
    def common(self) -> Mapping[str, IPv4Address]:
        """Machine -> its address in the common network."""
        return self.addresses(self.found.common)
