# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Names and addresses, replaced everywhere by the same new ones: robot1, robot1-computer2, host3, user1. Pure.

The names of the plan are known. Texts teach the hosts of URIs and the owners of home folders.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Iterator, Mapping
from ipaddress import AddressValueError, IPv4Address, IPv4Network, IPv6Address
from typing import Any

from .._plan.environment import LISTS, MASTER, NAMES
from .._plan.model import FleetPlan
from .._plan.units import NODES, OTHERS
from .._verify.observe.task_results import FORMS
from .addresses import Addresses
from .secrets import list_words

# Names of the collection and of ROS stay, also if a robot has one of them.
_OURS = (
    rf"master_(?:{'|'.join(NODES)})|mas[_-](?:discovery|sync|daemon)|rosfleet(?:[_.-]multimaster)?|rosout|roscore|rosmaster|ros_comm"
    r"|multimaster_verify(?:_talker|_listener)?"
    rf"|multimaster[_-](?:{'|'.join((*OTHERS, *NODES))}|multicast-routing|verify)"
)
_PUBLIC = {"localhost", "wiki.ros.org", "www.ros.org", "docs.ros.org", "answers.ros.org", "github.com", "www.w3.org"}
# Variables of an environment that a robot's name is not looked for in, as in PATH or ROS_IP of a robot that is called `path` or `ros`.
_VARIABLES = {*LISTS, *NAMES, MASTER, "ROS_DISTRO", "ROS_VERSION", "CONDA_PREFIX"}
#: Words by which checks decide: a host that calls itself so is no reason to replace them in the answers of all.
_DECIDERS = "active_state load_state name_sources state direction step hook policy verdict protocol outcome"
_DECIDING = [FORMS[key] for key in _DECIDERS.split()]
_URI = re.compile(r"(?:https?|rosrpc)://(?:[^/@\s]{1,200}@)?([A-Za-z0-9][A-Za-z0-9.-]{0,200})(?=[:/\s\"'\])]|$)")
_HOME = re.compile(r"/home/([A-Za-z0-9._-]{1,64})")
_IPV4 = re.compile(r"(?<![\d.])(\d{1,3})([._-])(\d{1,3})\2(\d{1,3})\2(\d{1,3})(?!\d|\.\d)(?:/(\d{1,2})(?!\d))?")
_MAC = re.compile(r"(?<![0-9A-Fa-f:])(?:[0-9A-Fa-f]{2}:){5}[0-9A-Fa-f]{2}(?![0-9A-Fa-f:])")
_IPV6 = re.compile(r"(?<![0-9A-Za-z:.])[0-9A-Fa-f]{0,4}(?::[0-9A-Fa-f]{0,4}){2,7}(?![0-9A-Za-z:.])")


class Anonymous:
    """Replaces names and addresses. `aliases` are more names of computers, `users` names of persons, `texts` have more of both."""

    def __init__(
        self,
        fleet: FleetPlan,
        aliases: Mapping[str, Iterable[str]] | None = None,
        users: Iterable[str] = (),
        texts: Iterable[str] = (),
    ) -> None:
        self._addresses = Addresses(_networks(fleet))
        self._names = _names(fleet, aliases or {})
        hosts, people = set[str](), set(users) - {"root", "nobody", ""}
        for text in texts:
            hosts |= {host for host in _URI.findall(text) if not _stays(host.lower())}
            people |= set(_HOME.findall(text))
        for host in sorted(host for host in hosts if host.lower() not in self._names):
            new = f"host{1 + sum(other.startswith('host') for other in self._names.values())}"
            self._names.setdefault(host.lower(), new)
            self._names.setdefault(_label(host).lower(), new)
        self._people = {name: f"user{number}" for number, name in enumerate(sorted(people), 1)}
        self._seen: dict[tuple[str, str], str] = {}  # hardware addresses, and addresses of IPv6
        self._pattern = _pattern(self._names)
        self._persons = _persons(self._people)

    def text(self, text: str) -> str:
        """Return a text with new names and addresses."""
        text = _MAC.sub(lambda match: self._number("mac", match[0], "02:00:00:00:{0:02x}:{1:02x}"), text)
        text = _IPV6.sub(self._ipv6, text)
        text = _IPV4.sub(self._ipv4, text)
        text = self._persons.sub(lambda match: match[1] + self._people[match[2]], text)
        return self._pattern.sub(lambda match: match[1] or self._names[match[0].lower()], text)

    def data(self, value: Any) -> Any:
        """Return plain data or dataclasses with new names and addresses; fields keep their names."""
        if isinstance(value, str):
            return self.text(value)
        if isinstance(value, IPv4Address):
            return self._addresses.address(value)
        if isinstance(value, IPv4Network):
            return self._addresses.network(value)
        if isinstance(value, Mapping):
            return {self._key(key): self.data(part) for key, part in value.items()}
        if isinstance(value, (list, tuple)):
            return type(value)(self.data(part) for part in value)
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return dataclasses.replace(
                value, **{field.name: self.data(getattr(value, field.name)) for field in dataclasses.fields(value)}
            )
        return value

    def _key(self, key: str) -> str:
        """Return the new key of a mapping, such as a computer or a variable of an environment."""
        return key if key in _VARIABLES and key.lower() not in self._names else self.text(key)

    def _ipv4(self, match: re.Match[str]) -> str:
        *parts, length = match.group(1, 3, 4, 5, 6)
        try:
            old = IPv4Address(".".join(parts))
            if length and match[2] == "." and IPv4Network((old, int(length)), strict=False).network_address == old:
                return str(self._addresses.network(IPv4Network((old, int(length)))))
        except ValueError:
            return match[0]
        return str(self._addresses.address(old)).replace(".", match[2]) + (f"/{length}" if length else "")

    def _ipv6(self, match: re.Match[str]) -> str:
        try:
            old = IPv6Address(match[0])
        except AddressValueError:  # a time of day
            return match[0]
        if old.is_loopback or old.is_unspecified or old.is_multicast:
            return match[0]
        kind, new = ("link", "fe80::{2:x}") if old.is_link_local else ("ipv6", "2001:db8::{2:x}")
        return self._number(kind, str(old), new)

    def _number(self, kind: str, old: str, new: str) -> str:
        key = kind, old.lower()
        if key not in self._seen:
            number = 1 + sum(1 for entry in self._seen if entry[0] == kind)
            self._seen[key] = new.format(number // 256 % 256, number % 256, number)
        return self._seen[key]


def _stays(host: str) -> bool:
    """Return True for the host of a URI that is no name of anyone's computer."""
    return host in _PUBLIC or bool(_IPV4.fullmatch(host)) or any(form.fullmatch(host) for form in _DECIDING)


def _networks(fleet: FleetPlan) -> list[IPv4Network]:
    own = [network for entry in fleet.networks for network in (entry.network, IPv4Network(entry.common_address))]
    of_computers = [interface.network for plan in fleet.computers.values() for interface in plan.networks]
    return [fleet.common_network, *own, *of_computers, *fleet.belonging.allow, *fleet.let_in]


def _names(fleet: FleetPlan, aliases: Mapping[str, Iterable[str]]) -> dict[str, str]:
    """Return the new names of robots and computers, by their old ones in small letters."""
    robots = {robot: f"robot{number}" for number, robot in enumerate(fleet.master_of, 1)}
    computers = _computers(fleet, robots)
    names = {name.lower(): new for name, new in {**robots, **computers}.items()}
    for name, new in _list_aliases(fleet, robots, computers, aliases):
        if name and name.lower() not in names and not _IPV4.fullmatch(name):
            names[name.lower()] = f"{new}-name{1 + sum(other.startswith(f'{new}-name') for other in names.values())}"
    return {**{_label(old): _label(new) for old, new in names.items()}, **names}


def _computers(fleet: FleetPlan, robots: Mapping[str, str]) -> dict[str, str]:
    names = dict.fromkeys(fleet.computers, "router")
    for robot, new in robots.items():
        own = [name for name, plan in fleet.computers.items() if plan.robot == robot]
        names.update({name: f"{new}-computer{number}" for number, name in enumerate(own, 1)})
    return names


def _list_aliases(
    fleet: FleetPlan, robots: Mapping[str, str], computers: Mapping[str, str], aliases: Mapping[str, Iterable[str]]
) -> Iterator[tuple[str, str]]:
    """Yield more names, each with the new name of its owner."""
    at = {
        str(address): computers[name]
        for name, plan in fleet.computers.items()
        for address in (plan.address, plan.common_address)
    }
    for entry in fleet.hosts_entries:
        yield from ((name, at.get(str(entry.address), "host")) for name in entry.names)
    for computer, names in aliases.items():
        yield from ((name, computers.get(computer, "host")) for name in names)
    for robot in fleet.belonging.robots:
        yield from ((name, robots.get(robot.robot, "router")) for name in robot.hosts)


def _label(name: str) -> str:
    """Return a name as a part of a ROS name."""
    return re.sub(r"\W", "_", name)


def _pattern(names: Mapping[str, str]) -> re.Pattern[str]:
    return re.compile(rf"(?<![A-Za-z0-9])(?:({_OURS})|{list_words(names)})(?![A-Za-z0-9])", re.IGNORECASE)


def _persons(people: Mapping[str, str]) -> re.Pattern[str]:
    """Return the pattern of persons: a home folder, `user anna`, `anna@`."""
    before = r"(/home/|\b[Uu]ser(?:name)?[ =:]+[\"']?|(?<![\w.-])(?=[\w.-]+@))"
    return re.compile(rf"{before}({list_words(people)})(?![\w-])")
