# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The containers and networks that an inventory asks for. Pure, but for the one question to ansible-inventory.

Only addresses and networks are read: a computer gets one interface in each network that contains one of its addresses,
the common network first. The computers of the robots and the router have no route but that to the router of the common
network: the collection makes the routes between the robots.
"""

from __future__ import annotations

import ipaddress
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from machines import image, managers
from machines.managers import Interface
from machines.podman import LabError

Network = ipaddress.IPv4Network | ipaddress.IPv6Network
Port = ipaddress.IPv4Interface | ipaddress.IPv6Interface


@dataclass(frozen=True)
class Extra:
    """Additions of a lab to its inventory, for one host: addresses (with a prefix length: in a network of its own) and mounts."""

    addresses: tuple[str, ...] = ()
    mounts: tuple[str, ...] = ()  # SOURCE:TARGET, read-only


@dataclass(frozen=True)
class Host:
    """One computer."""

    name: str
    interfaces: tuple[Interface, ...]
    manager: str = managers.DEFAULT
    mounts: tuple[str, ...] = ()
    suite: str = image.SUITE  # Debian's release
    disk: str = "disk"  # of a virtual machine: a kind of `disk.KINDS`

    def files(self) -> dict[str, str]:
        """Return the files that differ from one computer to the next: path -> content."""
        return {"etc/hosts": self.hosts_file(), **managers.files(self.manager, self.interfaces)}

    def hosts_file(self) -> str:
        """/etc/hosts, as Debian's installer leaves it."""
        return (
            f"127.0.0.1\tlocalhost\n127.0.1.1\t{self.name}\n\n"
            "# The following lines are desirable for IPv6 capable hosts\n"
            "::1     localhost ip6-localhost ip6-loopback\nff02::1 ip6-allnodes\nff02::2 ip6-allrouters\n"
        )


def read_inventory(inventory: Path) -> dict[str, Any]:
    """Read an inventory as Ansible does."""
    if not inventory.exists():
        raise LabError(f"The inventory {inventory} does not exist.")
    neighbour = Path(sys.executable).with_name("ansible-inventory")
    program = str(neighbour) if neighbour.exists() else shutil.which("ansible-inventory")
    if not program:
        raise LabError("ansible-inventory was not found: run 'make lab' and use .work/venv/bin/python.")
    done = subprocess.run(
        [program, "-i", str(inventory), "--list"], capture_output=True, text=True, check=False, env=plain_environment()
    )
    if done.returncode:
        raise LabError(f"ansible-inventory cannot read {inventory}: {done.stderr.strip()}")
    return json.loads(done.stdout)


def plain_environment() -> dict[str, str]:
    """Without an ANSIBLE_INVENTORY of the caller, whose hosts would come on top, and without passwords that no lab needs."""
    passwords = ("ANSIBLE_VAULT_", "ANSIBLE_BECOME", "ANSIBLE_ASK_")
    return {
        name: value
        for name, value in os.environ.items()
        if name != "ANSIBLE_INVENTORY" and not name.startswith(passwords)
    }


def _hosts_below(listing: Mapping[str, Any], group: str) -> Iterator[str]:
    entry = listing.get(group, {})
    yield from entry.get("hosts", [])
    for child in entry.get("children", []):
        yield from _hosts_below(listing, child)


def robots_of(listing: Mapping[str, Any]) -> dict[str, list[str]]:
    """The robots and their computers."""
    return {robot: list(_hosts_below(listing, robot)) for robot in listing.get("robots", {}).get("children", [])}


@dataclass
class _Addresses:
    """The networks of a lab, the common one first, and who has which address in them."""

    networks: list[Network]
    of: dict[str, list[Port]] = field(default_factory=dict)

    def add(self, name: str, address: str) -> None:
        """An address; one with a prefix length may bring its network along."""
        if "/" in address:
            port = ipaddress.ip_interface(address)
            if port.network not in self.networks:
                self.networks.append(port.network)
        else:
            network = next((known for known in self.networks if ipaddress.ip_address(address) in known), None)
            if network is None:
                known = ", ".join(map(str, self.networks))
                raise LabError(
                    f"{name}: the address {address} is in none of the networks {known}; "
                    "give it a prefix length (ADDRESS/PREFIX) to make a network for it."
                )
            port = ipaddress.ip_interface(f"{address}/{network.prefixlen}")
        self.of.setdefault(name, []).append(port)

    def ports(self, name: str) -> list[Port]:
        """The addresses of a host in the order of the networks."""
        return sorted(self.of.get(name, []), key=lambda port: self.networks.index(port.network))


def _robot_networks(variables: Iterable[Mapping[str, Any]], common: Network) -> list[Network]:
    own = {ipaddress.ip_network(host["multimaster_network"]) for host in variables if host.get("multimaster_network")}
    return sorted(own - {common}, key=str)


def _interfaces(ports: Sequence[Port], gateways: Mapping[Network, str]) -> Iterator[Interface]:
    for index, port in enumerate(ports):
        gateway = gateways.get(port.network)
        yield Interface(
            f"eth{index}", str(port.network), port.with_prefixlen, gateway if gateway != str(port.ip) else None
        )


def wants_packages(variables: Iterable[Mapping[str, Any]]) -> bool:
    """Return True if site.yml needs packages that the computers of a demonstration do not have: chrony, or WireGuard."""
    return any(own.get("multimaster_clock") or own.get("multimaster_tunnel", "none") != "none" for own in variables)


def _carry(variables: Mapping[str, Any], robots: Sequence[str]) -> Mapping[str, Any]:
    """The variables as the network below has it, if the common network is the tunnel: who has no endpoint gets a free address there."""
    inside = [name for name in robots if variables[name].get("multimaster_gateway", name) == name]
    ends = {
        name: variables[name]["multimaster_endpoint"] for name in inside if "multimaster_endpoint" in variables[name]
    }
    first = variables[inside[0]]
    if not ends or first.get("multimaster_tunnel") != "wireguard" or "multimaster_tunnel_network" in first:
        return variables
    network = ipaddress.ip_network(f"{next(iter(ends.values()))}/24", strict=False)
    free = (str(address) for address in reversed(list(network.hosts())) if str(address) not in ends.values())
    carried = {}
    for name in robots:
        own = {**variables[name], "multimaster_common_network": str(network)}
        if name in inside:
            place = "multimaster_common_address" if own.get("multimaster_network") else "multimaster_address"
            own[place] = ends.get(name) or next(free)
        carried[name] = own
    return {**variables, **carried}


def hosts_of(listing: Mapping[str, Any], extras: Mapping[str, Extra] | None = None) -> list[Host]:
    """The computers of the groups `robots` and `routers`, and the extra ones: a host of its own, or more for one of these."""
    extras = extras or {}
    robots = list(dict.fromkeys(_hosts_below(listing, "robots")))
    variables = _carry(listing["_meta"]["hostvars"], robots)
    if not robots:
        raise LabError("The inventory has no host below the group 'robots'.")
    routers = list(dict.fromkeys(_hosts_below(listing, "routers")))

    common = ipaddress.ip_network(variables[robots[0]]["multimaster_common_network"])
    addresses = _Addresses([common, *_robot_networks((variables[name] for name in robots), common)])
    for name in [*robots, *routers]:
        addresses.add(name, variables[name]["multimaster_address"])
        if variables[name].get("multimaster_gateway") == name:
            addresses.add(name, variables[name]["multimaster_common_address"])
    for name, extra in extras.items():
        for address in extra.addresses:
            addresses.add(name, address)

    # The report's common network has a router at its first address. In the lab, that address may be free: only the
    # default route counts, without which no multicast leaves a computer.
    gateways = {common: variables[robots[0]].get("multimaster_router") or str(common[1])}
    gateways.update({port.network: str(port.ip) for name in routers for port in addresses.ports(name)})
    return [
        Host(
            name,
            tuple(_interfaces(addresses.ports(name), gateways)),
            _manager(name, variables.get(name, {})),
            extras[name].mounts if name in extras else (),
            variables.get(name, {}).get("lab_suite", image.SUITE),
        )
        for name in dict.fromkeys([*robots, *routers, *extras])
    ]


def choose_suites(hosts: Sequence[Host], wanted: Iterable[str]) -> list[Host]:
    """The same computers with other releases of Debian: SUITE for all of them, HOST=SUITE for one."""
    by_host = {host: suite for host, _equals, suite in (word.rpartition("=") for word in wanted)}
    unknown = set(by_host) - {"", *(host.name for host in hosts)}
    if unknown:
        raise LabError(f"There is no computer {', '.join(sorted(unknown))} that could have a release of its own.")
    return [replace(host, suite=by_host.get(host.name, by_host.get("", host.suite))) for host in hosts]


def _manager(name: str, variables: Mapping[str, Any]) -> str:
    manager = variables.get("lab_network_manager", managers.DEFAULT)
    if manager not in managers.MANAGERS:
        raise LabError(
            f"{name}: lab_network_manager is '{manager}'; expected one of {', '.join(sorted(managers.MANAGERS))}."
        )
    return manager
