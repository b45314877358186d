# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The parts of an inventory that are rehearsed, those that are left aside, and those that clash with this machine. Pure: data in, data and sentences out."""

from __future__ import annotations

import hashlib
import ipaddress
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

OURS, LAB = "multimaster_", "lab_"
#: Variables besides those of the fleet that count: options of the roles, and of the lab.
OPTIONS = (
    *("sysctl_on_conflict", "routes_on_conflict", "hosts_on_conflict"),
    *("sysctl_confirm_within", "routes_confirm_within", "firewall_confirm_within", "tunnel_confirm_within"),
    *("sysctl_drop_in", "services_timeout"),
    *("verify_pairs", "verify_patience", "verify_rounds", "verify_interval", "verify_lifetime"),
    *("lab_suite", "lab_network_manager"),
)
NOT_OF_USERS = {"ansible_facts", "ansible_local"}  # ansible-inventory lists them for every host
LONGEST_NAME = 64  # characters of a system's name, by the kernel
MEMORY = 110  # MiB for a computer, an estimate on the safe side: one takes some 85 while it is configured and verified

Network = ipaddress.IPv4Network


def name_of(inventory: Path) -> str:
    """Name a rehearsal after its inventory. Without a hyphen: after the first one, the name of a container is that of its computer."""
    plain = re.sub(r"[^a-z0-9]+", "_", inventory.name.lower()).strip("_")[:20] or "fleet"
    return f"{plain}_{hashlib.sha256(str(inventory).encode()).hexdigest()[:4]}"


def lab_of(name: str) -> str:
    """Name the lab of a rehearsal. No other lab has a dot in its name."""
    return f"rehearse.{name}"


# The rehearsed fleet


@dataclass(frozen=True)
class Stand_in:
    """A value of a variable that containers cannot have, and the value that they have instead."""

    variable: str
    impossible: Callable[[Any], bool]
    instead: Any
    because: str


STAND_INS = (
    Stand_in(
        "multimaster_provider",
        lambda value: value != "bundled",
        "bundled",
        "the containers have neither a package source nor an installation of multimaster_fkie",
    ),
    Stand_in(
        "multimaster_ros_setup",
        lambda value: value not in ("auto", "debian"),
        "auto",
        "the containers have ROS of Debian's packages",
    ),
    Stand_in(
        "multimaster_routes",
        lambda value: value == "existing",
        "networks",
        "nothing else makes routes in the containers",
    ),
)


@dataclass(frozen=True)
class Device:
    """A gateway or router that is no computer of the inventory; a container with Linux stands in for it."""

    addresses: tuple[str, ...]
    folder: str  # of its files, as playbooks/router_config.yml names it


@dataclass(frozen=True)
class SealedComputer:
    """A computer without a login for people: its address, and the gateway of its network. Empty: it is in the common network."""

    address: str
    gateway: str = ""


@dataclass(frozen=True)
class Rehearsable:
    """The inventory of a rehearsal, and the changes in it."""

    inventory: dict[str, Any]
    notes: tuple[str, ...]
    devices: dict[str, Device]  # by the name of the container's computer
    roscores: dict[str, int]  # masters whose roscore something else starts -> its port
    sealed: Mapping[str, SealedComputer] = field(default_factory=dict)  # by name


def make_rehearsable(values: Mapping[str, Any]) -> Rehearsable:
    """Make the inventory of a rehearsal out of the values of the robots."""
    notes: list[str] = []
    variables = {host: _replace_impossible(host, given, notes) for host, given in values["variables"].items()}

    def group(hosts: Iterable[str]) -> dict[str, Any]:
        return {"hosts": {host: variables[host] for host in hosts}}

    inventory: dict[str, Any] = {
        "robots": {"children": {robot: group(hosts) for robot, hosts in values["robots"].items()}}
    }
    if values["routers"]:
        inventory["routers"] = group(values["routers"])
    devices, sealed = _devices(values), dict(_list_sealed(values))
    notes += _name_forgotten(values)
    notes += [
        f"{name}: a container with Linux stands in for the device at {', '.join(of.addresses)}"
        for name, of in devices.items()
    ]
    notes += [f"{name}: a container with Debian's ROS stands in for this sealed computer" for name in sealed]
    return Rehearsable(inventory, tuple(notes), devices, dict(_roscores(values)), sealed)


def _replace_impossible(host: str, given: Mapping[str, Any], notes: list[str]) -> dict[str, Any]:
    variables = dict(given)
    for row in STAND_INS:
        if row.variable in variables and row.impossible(variables[row.variable]):
            notes.append(
                f"{host}: {row.variable} is '{variables[row.variable]}'; {row.because}, so it is rehearsed with '{row.instead}'"
            )
            variables[row.variable] = row.instead
    return variables


def _name_forgotten(values: Mapping[str, Any]) -> Iterator[str]:
    """Name the robots that a declaration of data flow leaves out: only the person who wrote it knows if one was forgotten."""
    for robot, hosts in values["robots"].items():
        exports = values["variables"][hosts[0]].get("multimaster_exports") if hosts else None
        named = [entry.get("to") or list(values["robots"]) for entry in exports or ()]
        for other in values["robots"]:
            if named and other != robot and not any(other in to for to in named):
                yield (
                    f"{robot} gives nothing to {other}: no entry of its multimaster_exports is for it; if {other} was forgotten, add it "
                    f"to a 'to' in group_vars/{robot}.yml"
                )


def _devices(values: Mapping[str, Any]) -> dict[str, Device]:
    found = [
        Device((entry["common_address"], entry["gateway"]), f"gateway-{entry['robot']}")
        for entry in values["networks"]
        if entry["device"]
    ]
    router = values.get("router")
    if router and not values["routers"]:
        found.append(Device((router["address"],), "router"))
    return {f"device-{re.sub('[^a-z0-9]+', '-', device.folder.lower()).strip('-')}": device for device in found}


def _roscores(values: Mapping[str, Any]) -> Iterator[tuple[str, int]]:
    for hosts in values["robots"].values():
        own = values["variables"][hosts[0]] if hosts else {}
        master = own.get("multimaster_master", hosts[0] if hosts else "")
        if own.get("multimaster_roscore") == "existing" or master in (own.get("multimaster_sealed") or ()):
            yield master, int(own.get("multimaster_roscore_port", 11311))


def _list_sealed(values: Mapping[str, Any]) -> Iterator[tuple[str, SealedComputer]]:
    for hosts in values["robots"].values():
        own = values["variables"][hosts[0]] if hosts else {}
        named = str(own.get("multimaster_gateway") or "")
        gateway = values["variables"][named]["multimaster_address"] if named in hosts else named
        for name, entry in (own.get("multimaster_sealed") or {}).items():
            yield name, SealedComputer(str(entry["address"] if isinstance(entry, Mapping) else entry), gateway)


# Things that are left aside


def list_unused(listing: Mapping[str, Any], hosts: Sequence[str], encrypted: Sequence[str]) -> list[str]:
    """Say which variables of which hosts, and which files, the rehearsal does not need."""
    whose: dict[str, list[str]] = defaultdict(list)
    secret = set()
    for host in hosts:
        for name, value in listing["_meta"]["hostvars"].get(host, {}).items():
            if name.startswith((OURS, LAB)) or name in OPTIONS or name in NOT_OF_USERS:
                continue
            whose[name].append(host)
            if isinstance(value, Mapping) and "__ansible_vault" in value:
                secret.add(name)
    lines = [
        f"{name}{' (encrypted)' if name in secret else ''}: of {_hosts(whose[name], hosts)}" for name in sorted(whose)
    ]
    return [*(f"{name}: an encrypted file" for name in encrypted), *lines]


def _hosts(some: Sequence[str], everybody: Sequence[str]) -> str:
    if len(some) == len(everybody) > 2:
        return f"all {len(everybody)} computers"
    return ", ".join(some)


# Conflicts with this machine


@dataclass(frozen=True)
class Machine:
    """The machine that the rehearsal runs on."""

    networks: tuple[tuple[Network, str], ...]  # the network of an interface or a route, and its origin
    available: int  # MiB of memory


def impossible(
    values: Mapping[str, Any], devices: Mapping[str, Device], machine: Machine, suites: Sequence[str]
) -> list[str]:
    """Say why this machine cannot rehearse the inventory, one sentence each."""
    variables = values["variables"]
    hosts = [*variables, *devices]
    return [
        *_long_names(hosts),
        *_unknown_suites(variables, suites),
        *_check_memory(len(hosts), machine.available),
    ]


def _long_names(hosts: Iterable[str]) -> Iterator[str]:
    for host in hosts:
        if len(host) > LONGEST_NAME:
            yield (
                f"{host}: its name in the inventory has {len(host)} characters; expected at most {LONGEST_NAME}, as the name of a system "
                "and its container: shorten it."
            )


def _unknown_suites(variables: Mapping[str, Mapping[str, Any]], suites: Sequence[str]) -> Iterator[str]:
    for host, own in variables.items():
        if own.get("lab_suite", suites[0]) not in suites:
            yield (
                f"{host}: lab_suite is '{own['lab_suite']}'; expected a release of Debian that the lab has an image of, one of "
                f"{', '.join(suites)}: correct it."
            )


def _check_memory(computers: int, available: int) -> Iterator[str]:
    if computers * MEMORY > available:
        yield (
            f"The inventory has {computers} computers, which need about {computers * MEMORY} MiB of memory, and this machine has "
            f"{available} MiB left; expected at most {available // MEMORY} computers here: rehearse on a larger machine, or fewer robots."
        )


def overlaps(values: Mapping[str, Any], machine: Machine) -> list[str]:
    """Say which networks of the fleet are networks of this machine, too."""
    common = (f"multimaster_common_network is {values['common_network']}", values["common_network"])
    own = [
        (f"multimaster_network of the robot {entry['robot']} is {entry['network']}", entry["network"])
        for entry in values["networks"]
    ]
    return [
        f"{what}, which overlaps with {network} of this machine ({whose}); expected networks that it does not have, so that nobody takes "
        "the rehearsed robots for real ones: rehearse on another machine, or give OVERLAP=yes (the containers' networks have no way to "
        "this machine or out of it)."
        for what, text in (common, *own)
        for network, whose in machine.networks
        if ipaddress.ip_network(text).overlaps(network)
    ]


def networks_of(
    routes: Iterable[Mapping[str, Any]], podmans: Iterable[Mapping[str, Any]], ours: str
) -> list[tuple[Network, str]]:
    """Read the networks of a machine: of its routes (`ip -json route`), and of podman (`podman network inspect`) but for our own."""
    found: dict[Network, str] = {}
    for route in routes:
        try:
            network = ipaddress.ip_network(route.get("dst", ""))
        except ValueError:  # default
            continue
        if isinstance(network, Network) and not network.is_multicast and network.prefixlen:
            found.setdefault(network, f"its interface {route.get('dev', '?')}")
    for entry in podmans:
        for subnet in entry.get("subnets") or () if not str(entry.get("name", "")).startswith(ours) else ():
            network = ipaddress.ip_network(subnet["subnet"])
            if isinstance(network, Network):
                found.setdefault(network, f"podman's network {entry['name']}")
    return list(found.items())
