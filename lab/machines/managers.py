# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The network managers that a computer of the lab may have: a table of the files and units that belong to each.

The addresses are always static and the same; only who configures them differs. The files are as a person would write them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Interface:
    """One interface of a computer."""

    name: str
    network: str  # CIDR
    address: str  # with prefix length
    gateway: str | None

    @property
    def version(self) -> int:
        """The version of the internet protocol."""
        return 6 if ":" in self.address else 4


Files = dict[str, str]  # path -> content


def _ifupdown(ports: Sequence[Interface]) -> Files:
    stanzas = ["auto lo\niface lo inet loopback"]
    for port in ports:
        family = "inet6" if port.version == 6 else "inet"
        stanza = f"auto {port.name}\niface {port.name} {family} static\n    address {port.address}"
        stanzas.append(stanza + (f"\n    gateway {port.gateway}" if port.gateway else ""))
    return {"etc/network/interfaces": "\n\n".join(stanzas) + "\n"}


def _networkd(ports: Sequence[Interface]) -> Files:
    return {
        f"etc/systemd/network/10-{port.name}.network": (
            f"[Match]\nName={port.name}\n\n[Network]\nAddress={port.address}\n"
            + (f"Gateway={port.gateway}\n" if port.gateway else "")
            + "IPv6AcceptRA=no\n"
        )
        for port in ports
    }


def _networkmanager(ports: Sequence[Interface]) -> Files:
    return {
        f"etc/NetworkManager/system-connections/{port.name}.nmconnection": (
            f"[connection]\nid={port.name}\ntype=ethernet\ninterface-name={port.name}\n"
            f"\n[ipv{port.version}]\nmethod=manual\naddress1={port.address}"
            + (f",{port.gateway}\n" if port.gateway else "\n")
            + f"\n[ipv{10 - port.version}]\nmethod=disabled\n"
        )
        for port in ports
    }


def _netplan(ports: Sequence[Interface]) -> Files:
    lines = ["network:", "  version: 2", "  renderer: networkd", "  ethernets:"]
    for port in ports:
        lines += [f"    {port.name}:", "      accept-ra: false", f'      addresses: ["{port.address}"]']
        if port.gateway:
            lines += ["      routes:", "        - to: default", f'          via: "{port.gateway}"']
    return {"etc/netplan/01-lab.yaml": "\n".join(lines) + "\n"}


@dataclass(frozen=True)
class Manager:
    """A network manager: its files, and the units that run only with it."""

    files: Callable[[Sequence[Interface]], Files]
    units: tuple[str, ...] = ()
    full: bool = False  # it is only in the full image


_NETWORKD_UNITS = ("systemd-networkd.service", "systemd-networkd.socket", "systemd-networkd-wait-online.service")
_NETWORKMANAGER_UNITS = (
    "NetworkManager.service",
    "NetworkManager-wait-online.service",
    "NetworkManager-dispatcher.service",
)

MANAGERS: Mapping[str, Manager] = {
    "ifupdown": Manager(_ifupdown),  # its service runs everywhere, as on any Debian, for the loopback interface
    "networkd": Manager(_networkd, _NETWORKD_UNITS),
    "networkmanager": Manager(_networkmanager, _NETWORKMANAGER_UNITS, full=True),
    "netplan": Manager(_netplan, _NETWORKD_UNITS, full=True),
}
DEFAULT = "ifupdown"


def files(manager: str, ports: Sequence[Interface]) -> Files:
    """The files of a computer with this manager."""
    return {**_ifupdown(()), **MANAGERS[manager].files(ports)}


def list_masked_units(manager: str) -> list[str]:
    """The units of all managers that a computer with this one does not have."""
    return sorted({unit for other in MANAGERS.values() for unit in other.units} - set(MANAGERS[manager].units))
