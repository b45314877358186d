# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Which containers and networks an inventory asks for. Pure, but for the one question to ansible-inventory.

Only addresses and networks are read: a computer gets one interface in each network that contains one of its addresses.
"""

from __future__ import annotations

import ipaddress
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from podman import LabError

Network = ipaddress.IPv4Network | ipaddress.IPv6Network


@dataclass(frozen=True)
class Interface:
    """One interface of a computer."""

    name: str
    network: str  # CIDR
    address: str  # with prefix length
    gateway: str | None


@dataclass(frozen=True)
class Host:
    """One computer."""

    name: str
    interfaces: tuple[Interface, ...]

    def network_file(self) -> str:
        """/etc/network/interfaces, as a person would write it."""
        stanzas = ["auto lo\niface lo inet loopback"]
        for port in self.interfaces:
            family = "inet6" if ":" in port.address else "inet"
            stanza = f"auto {port.name}\niface {port.name} {family} static\n    address {port.address}"
            stanzas.append(stanza + (f"\n    gateway {port.gateway}" if port.gateway else ""))
        return "\n\n".join(stanzas) + "\n"

    def hosts_file(self) -> str:
        """/etc/hosts, as Debian's installer leaves it."""
        return (
            f"127.0.0.1\tlocalhost\n127.0.1.1\t{self.name}\n\n"
            "# The following lines are desirable for IPv6 capable hosts\n"
            "::1     localhost ip6-localhost ip6-loopback\nff02::1 ip6-allnodes\nff02::2 ip6-allrouters\n"
        )


def read_inventory(inventory: Path) -> dict[str, Any]:
    """What Ansible makes of an inventory."""
    if not inventory.exists():
        raise LabError(f"The inventory {inventory} does not exist.")
    beside = Path(sys.executable).with_name("ansible-inventory")
    program = str(beside) if beside.exists() else shutil.which("ansible-inventory")
    if not program:
        raise LabError("ansible-inventory was not found: run 'make setup' and use .work/venv/bin/python.")
    done = subprocess.run(
        [program, "-i", str(inventory), "--list"], capture_output=True, text=True, check=False, env=_plain_environment()
    )
    if done.returncode:
        raise LabError(f"ansible-inventory cannot read {inventory}: {done.stderr.strip()}")
    return json.loads(done.stdout)


def _plain_environment() -> dict[str, str]:
    """Without an ANSIBLE_INVENTORY of the caller, whose hosts would come on top."""
    return {name: value for name, value in os.environ.items() if name != "ANSIBLE_INVENTORY"}


def _hosts_below(listing: Mapping[str, Any], group: str) -> Iterator[str]:
    entry = listing.get(group, {})
    yield from entry.get("hosts", [])
    for child in entry.get("children", []):
        yield from _hosts_below(listing, child)


def _interfaces(name: str, addresses: list[str], networks: list[Network], common: Network) -> Iterator[Interface]:
    """The interfaces of a computer, the one in the common network first."""
    found = {}
    for address in map(ipaddress.ip_address, addresses):
        network = next((network for network in networks if address in network), None)
        if network is None:
            raise LabError(f"{name}: the address {address} is in none of the networks {', '.join(map(str, networks))}.")
        found[network] = address
    for index, network in enumerate(sorted(found, key=networks.index)):
        address = found[network]
        # A common network has a router at its first address, as the report's. The lab's common network may have nobody
        # there; what counts is the default route, without which no multicast leaves a computer.
        router = network[1] if network == common and address != network[1] else None
        yield Interface(
            f"eth{index}", str(network), f"{address}/{network.prefixlen}", str(router) if router is not None else None
        )


def hosts_of(listing: Mapping[str, Any], extra: Mapping[str, list[str]] | None = None) -> list[Host]:
    """The computers of the group `robots`, and extra ones: name -> addresses."""
    variables = listing["_meta"]["hostvars"]
    names = list(dict.fromkeys(_hosts_below(listing, "robots")))
    if not names:
        raise LabError("The inventory has no host below the group 'robots'.")
    common = ipaddress.ip_network(variables[names[0]]["multimaster_common_network"])
    others = {variables[name].get("multimaster_network") for name in names} - {None, str(common)}
    networks = [common, *sorted(map(ipaddress.ip_network, others))]

    addresses = {
        name: [
            variables[name][key]
            for key in ("multimaster_address", "multimaster_common_address")
            if key in variables[name]
        ]
        for name in names
    }
    addresses.update(extra or {})
    return [Host(name, tuple(_interfaces(name, list(own), networks, common))) for name, own in addresses.items()]
