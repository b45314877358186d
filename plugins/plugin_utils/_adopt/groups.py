# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Machines to robots: the networks that connect them, the one that all robots share, and who belongs to which roscore.

The common network is the one without which the machines with a roscore are connected least. Machines that stay connected are a robot.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from ipaddress import IPv4Address, IPv4Network

from .._base.sentences import shorten_list
from .facts import CARRIER_GRADE, FoundMachine, Uri

NO_URI = "no ROS_MASTER_URI with the place of one was found in its files and shells"
EVERYWHERE = IPv4Network("0.0.0.0/0")
# Prefix lengths of a network for single addresses: an inventory has no network longer than /30, and networks of persons begin at 10.0.0.0/8.
_SMALLEST, _LARGEST = 30, 8
THIS = ("localhost", "127.0.0.1", "127.0.1.1")  # how a computer names itself


@dataclass(frozen=True)
class Machines:
    """All machines that were read, by their names in the list, and their connections."""

    by_name: Mapping[str, FoundMachine]

    @cached_property
    def _seen(self) -> frozenset[IPv4Network]:
        """The networks of interfaces."""
        return frozenset(entry.network for machine in self.by_name.values() for entry in machine.addresses)

    @cached_property
    def made_networks(self) -> Mapping[IPv4Network, str]:
        """Networks that no machine has told: for single addresses of several machines, as those of Tailscale -> their interfaces."""
        groups: dict[str, dict[IPv4Address, str]] = defaultdict(dict)
        for name, machine in self.by_name.items():
            for address, device in machine.singles.items():
                if not any(address in network for network in self._seen):
                    groups["" if address in CARRIER_GRADE else device][address] = name
        devices = {one: device for machine in self.by_name.values() for one, device in machine.singles.items()}
        found: dict[IPv4Network, str] = {}
        for members in groups.values():
            network = CARRIER_GRADE if min(members) in CARRIER_GRADE else _find_smallest(members)
            if len(set(members.values())) > 1 and network and not any(map(network.overlaps, [*self._seen, *found])):
                found[network] = shorten_list(sorted({devices[address] for address in members}))
        return found

    @cached_property
    def networks(self) -> Mapping[IPv4Network, Mapping[str, IPv4Address]]:
        """Network -> machine -> its address there. One that is in a wider one becomes the wider one."""
        seen = sorted([*self._seen, *self.made_networks])
        wide = [one for one in seen if not any(one != other and one.subnet_of(other) for other in seen)]
        found: dict[IPv4Network, dict[str, IPv4Address]] = {network: {} for network in wide}
        for name, machine in self.by_name.items():
            for network, address in _choose_addresses(machine, wide):
                found[network][name] = address
        return found

    @cached_property
    def duplicate_networks(self) -> frozenset[IPv4Network]:
        """The networks in which two machines have one address: several networks that look like one, inside each robot."""
        return frozenset(
            network for network, members in self.networks.items() if len(set(members.values())) < len(members)
        )

    @cached_property
    def _names(self) -> Mapping[str, str]:
        """Name or address -> machine; names that mean two machines are left out."""
        claims: dict[str, set[str]] = defaultdict(set)
        for name, machine in self.by_name.items():
            for text in (name, machine.hostname, machine.hostname.partition(".")[0]):
                claims[text.lower()].add(name)
            for address in (*(entry.ip for entry in machine.addresses), *machine.singles):
                claims[str(address)].add(name)
        return {text: next(iter(of)) for text, of in claims.items() if text and len(of) == 1}

    def resolve(self, machine: str, uri: Uri) -> str | None:
        """Return the machine that a URI means on one of them."""
        if uri.host in THIS or uri.host == self.by_name[machine].hostname.lower():
            return machine
        return self._names.get(uri.host) or (None if uri.is_address else self._names.get(uri.host.partition(".")[0]))

    def machine_at(self, address: IPv4Address) -> str | None:
        """Return the machine that has an address."""
        return self._names.get(str(address))

    @cached_property
    def master_of(self) -> Mapping[str, str]:
        """Machine -> the one that its ROS_MASTER_URI means; the first that is known counts."""
        meant = {
            name: next(filter(None, (self.resolve(name, uri) for uri in machine.masters)), None)
            for name, machine in self.by_name.items()
        }
        return {name: master for name, master in meant.items() if master}

    @cached_property
    def masters(self) -> frozenset[str]:
        """The machines with a roscore, and those that a ROS_MASTER_URI means; `localhost` is only the default of ROS."""
        running = {name for name, machine in self.by_name.items() if machine.roscores}
        meant = {
            self.resolve(name, uri)
            for name, machine in self.by_name.items()
            for uri in machine.masters[:1]
            if uri.host not in THIS
        }
        return frozenset(name for name in running | meant if name)

    def connect(self, without: Collection[IPv4Network]) -> list[frozenset[str]]:
        """Return the sets of machines that are connected by the other networks."""
        group = {name: {name} for name in self.by_name}
        for network, members in self.networks.items():
            if network in without or network in self.duplicate_networks:
                continue
            first, *others = members
            for name in others:
                joined = group[first] | group[name]
                group.update(dict.fromkeys(joined, joined))
        return list(dict.fromkeys(frozenset(members) for members in group.values()))

    def count_robots(self, common: IPv4Network, without: Collection[IPv4Network]) -> int:
        """Count the sets that these networks separate and that could be robots: sets with a roscore, and an address in the common network."""
        reached = set(self.networks[common])
        return sum(1 for group in self.connect(without) if group & self.masters and group & reached)


@dataclass(frozen=True)
class Group:
    """A robot: the machine with its roscore, and its machines."""

    master: str
    members: frozenset[str]
    notes: Sequence[str]


@dataclass(frozen=True)
class FleetGroups:
    """The parts that machines have in a fleet."""

    common: IPv4Network
    why: str  # it is the common network, if that is a guess
    shared: frozenset[IPv4Network]  # networks that several robots have, the common one among them
    groups: tuple[Group, ...]
    rest: Mapping[str, str]  # machine of no robot -> why


def _choose_addresses(
    machine: FoundMachine, networks: Iterable[IPv4Network]
) -> Iterator[tuple[IPv4Network, IPv4Address]]:
    """Yield the networks of a machine, with its address there.

    Of several it is the one that the kernel sends from, by which others know the machine; else the lowest.
    """
    addresses = sorted([*(entry.ip for entry in machine.addresses), *machine.singles])
    for network in networks:
        inside = [address for address in addresses if address in network]
        if inside:
            source = machine.sources.get(network)
            yield network, source if source in inside else inside[0]


def _find_smallest(addresses: Iterable[IPv4Address]) -> IPv4Network | None:
    """Return the smallest network that has these as addresses of computers; None where it would be wider than any of a person."""
    first, last = min(addresses), max(addresses)
    for length in range(_SMALLEST, _LARGEST - 1, -1):
        network = IPv4Network((first, length), strict=False)
        if network.network_address != first and last < network.broadcast_address:
            return network
    return None


def find_groups(machines: Machines) -> FleetGroups | None:
    """Return the robots; None if no machine has a network."""
    ranked = sorted(machines.networks.keys() - machines.duplicate_networks, key=lambda one: _rank(machines, one))
    if not ranked:
        return None
    common, *others = ranked
    reasons = []
    if others and _rank(machines, others[0])[:3] == _rank(machines, common)[:3]:
        more = len(machines.networks[common]) > len(machines.networks[others[0]])
        since = ", since more machines have an address in it" if more else ""
        reasons.append(f"guessed{since}; it may also be {others[0]}")
    if len(machines.masters) > 1 and machines.count_robots(common, [common]) < 2:
        reasons.append("guessed, since no two of the machines with a roscore share a network")
    if common in machines.made_networks:
        devices = machines.made_networks[common]
        reasons.append(f"guessed, since no interface has a network: that of the single addresses (/32) of {devices}")
    why = "; ".join(reasons)
    shared = _find_shared_networks(machines, common)
    groups: dict[str, Group] = {}
    rest: dict[str, str] = {}
    lone: list[str] = []
    for members in machines.connect(shared):
        masters = _rank_masters(machines, members)
        if masters:
            groups[masters[0]] = Group(masters[0], members, _notes(machines, members, masters))
        else:
            lone += sorted(members)
    for name in lone:
        group = groups.get(machines.master_of.get(name, ""))
        if group:
            groups[group.master] = replace(group, members=group.members | {name})
        else:
            rest[name] = _explain_rest(machines, name)
    return FleetGroups(common, why, shared, tuple(groups[master] for master in sorted(groups)), rest)


def _rank(machines: Machines, network: IPv4Network) -> tuple[int, ...]:
    """Return the sort key of a network, the common one first."""
    return (
        -machines.count_robots(network, [network]),
        _count_divided(machines, network) + _count_ways_out(machines, network),
        -_count_discovery_nodes(machines, network),
        -len(machines.networks[network]),
        int(network in machines.made_networks),
        int(network.network_address),
        network.prefixlen,
    )


def _count_divided(machines: Machines, network: IPv4Network) -> int:
    """Count the machines that are connected with the roscore that they name only by this network."""
    group = {name: members for members in machines.connect([network]) for name in members}
    return sum(1 for name, master in machines.master_of.items() if master not in group[name])


def _count_ways_out(machines: Machines, network: IPv4Network) -> int:
    """Count the machines that get from this network to others by a machine of both, as computers of a robot do."""
    several = {
        name
        for other, members in machines.networks.items()
        if other != network and len(members) > 1
        for name in members
    }
    used = count_hops(machines, machines.networks[network], network)
    return sum(number for hop, number in used.items() if machines.machine_at(hop) in several)


def _count_discovery_nodes(machines: Machines, network: IPv4Network) -> int:
    """Count the addresses in a network at which discovery nodes answer."""
    heard = {
        node.uri.host
        for machine in machines.by_name.values()
        for roscore in machine.roscores
        for node in roscore.discovery
        if node.uri and node.uri.is_address
    }
    return sum(1 for host in heard if IPv4Address(host) in network)


def _find_shared_networks(machines: Machines, common: IPv4Network) -> frozenset[IPv4Network]:
    """Return the networks that connect robots: the common one, and others such as one for administration."""
    shared, apart = frozenset({common}), machines.count_robots(common, [common])
    while True:
        wider = [shared | {network} for network in machines.networks]
        best = max(wider, key=lambda networks: machines.count_robots(common, networks))
        now = machines.count_robots(common, best)
        if now <= apart:
            return shared
        shared, apart = best, now


def _notes(machines: Machines, members: frozenset[str], masters: Sequence[str]) -> list[str]:
    """Return the reasons against these machines being one robot."""
    first, *others = masters
    several = [
        f"On {other} runs a roscore, too; expected one roscore for the computers of a network: that on {first} was taken, which most "
        "of them name"
        for other in others
        if machines.by_name[other].roscores
    ]
    named = {name: machines.master_of[name] for name in sorted(members) if name in machines.master_of}
    return several + [
        f"ROS_MASTER_URI of {name} names {master}, which is not the roscore of its robot"
        for name, master in named.items()
        if master != first and (master != name or machines.by_name[name].masters[0].host not in THIS)
    ]


def _explain_rest(machines: Machines, name: str) -> str:
    """Return why a machine is of no robot."""
    uris = machines.by_name[name].masters
    if not uris:
        return f"no roscore runs on it, and {NO_URI}"
    return f"no roscore runs on it, and its ROS_MASTER_URI names {uris[0].host}, which is no roscore of a robot"


def _rank_masters(machines: Machines, members: frozenset[str]) -> Sequence[str]:
    """Return the machines with a roscore: those where it runs first, then those that most name.

    A single machine that uses the roscore of another one, and whose own roscore is not discovered, has no roscore that counts.
    """
    votes = Counter(machines.master_of.get(name) for name in members)
    found = sorted(
        members & machines.masters, key=lambda name: (not machines.by_name[name].roscores, -votes[name], name)
    )
    if len(members) == 1 and found and _is_client(machines, found[0]):
        return ()
    return found


def _is_client(machines: Machines, name: str) -> bool:
    named = machines.master_of.get(name, name)
    discovers = any(roscore.discovery for roscore in machines.by_name[name].roscores)
    owned = machines.master_of.get(named, named) == named  # two that name each other are two robots
    return named != name and owned and named in machines.masters and not discovers


def count_hops(
    machines: Machines, names: Iterable[str], network: IPv4Network, destination: IPv4Network = EVERYWHERE
) -> Counter[IPv4Address]:
    """Count the next hops in a network on the way to a destination, the first one of each machine."""
    found: Counter[IPv4Address] = Counter()
    for name in names:
        ways = [hop.gateway for hop in machines.by_name[name].hops if hop.destination == destination]
        found.update([way for way in ways if way in network][:1])
    return found
