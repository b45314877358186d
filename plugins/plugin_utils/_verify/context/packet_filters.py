# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The packet filters and rules for routing on the planned way of a packet, as they were read on the computers.

A rule that drops the failed packet is the reason. If all rules were understood and no rule drops it, a packet filter is a
poor explanation. It stays possible, since some filters do not show themselves (XDP, the old iptables).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from ipaddress import IPv4Address

from ..._base.plain import to_plain
from ..._faults.filters import LARGE
from ..._network import facts, packets, plan_world, policy
from ..._network.model import FORWARD, IN, NAT, NO_WAY, OUT, Interface, Lookup, Machine, Packet, Rule, World
from ..._plan.model import FleetPlan, Member
from ..._predict.prediction import NODES
from ..components.component import Component
from ..observe.observations import Observation

GROUP, ROSCORE = "group", "roscore"
LARGE_SIZE = 1500  # bytes of the large pings, the usual MTU
ALL = "all"  # of a rule or a policy for packets of any kind
# the word of a filter's mode -> the protocol of such packets
TRAFFIC: Mapping[str, str] = {
    "icmp": "icmp",
    LARGE: "icmp",
    "udp": "udp",
    GROUP: "udp",
    "rpc": "tcp",
    ROSCORE: "tcp",
    "nodes": "tcp",
}

MODES: Mapping[str, str] = {LARGE: "icmp"}  # where the word of a filter's mode is another one


class ReadFilters:
    """The rules of all computers of a run, on the ways of the plan."""

    def __init__(self, fleet: FleetPlan, observations: Mapping[str, Observation]) -> None:
        self._fleet = fleet
        self._observations = observations
        self._members: Mapping[str, Member] = {member.name: member for member in fleet.members}
        self._known: dict[tuple[str, str, str, int], Component | None] = {}
        self.rules: dict[Component, Rule] = {}  # that have shown a filter

    def find_drop(self, sender: str, target: str, traffic: str, port: int = 0) -> Component | None:
        """Return the packet filter that drops a packet of this kind, or its answer; None if no known rule does.

        `port`: that of one node, if it is known.
        """
        key = (sender, target, traffic, port)
        if key not in self._known:
            self._known[key] = self._trace_packet(*key)
        return self._known[key]

    def list_origins(self, component: Component) -> tuple[str, ...]:
        """List the chains, as "family table chain", of the rule that was found for a component; an empty list if no rule showed it."""
        shown = self.rules.get(component) or self.rules.get(component._replace(what=""))
        return shown.origins if shown else ()

    def find_translator(self, sender: str, target: str) -> str:
        """Return the computer whose rules give the datagrams to the target another source; empty if none is known to."""
        member = self._members.get(target)
        if member is None or not {sender, target} <= self.world.machines.keys():
            return ""
        way = packets.trace(self.world, sender, self.make_packet(member, "udp"))
        places = (place for place, _own, _source in way.translations)
        return next((place for place in places if NAT not in self.world.machines[place].unclear), "")

    def _name_filter(self, rule: Rule, place: str, mode: str, what: str = "") -> Component:
        component = Component("filter", place, mode, what)
        self.rules.setdefault(component, rule)
        return component

    def _name_end(self, rule: Rule, place: str, mode: str, direction: str) -> Component:
        """Name the filter of a rule at an end of the way; `direction` is empty for both. A rule for a size has a mode of its own."""
        mode, what = (LARGE, str(rule.above)) if rule.above else (mode, "")
        return self._name_filter(rule, place, f"{mode} {direction}".strip(), what)

    def lets_pass(self, component: Component) -> bool:
        """Return True if all rules at the place of a filter were understood, in the chains that would drop the packet."""
        seen = self._observations.get(component.place)
        if (
            seen is None
            or seen.filters is None
            or not seen.filters.readable
            or component.place not in self.world.machines
        ):
            return False
        chain = component.mode.rpartition(" ")[2]  # without one the filter is that of both ends
        return self.world.machines[component.place].unclear.isdisjoint({chain} & {IN, OUT, FORWARD} or {IN, OUT})

    def _trace_packet(self, sender: str, target: str, traffic: str, port: int) -> Component | None:
        member, machines = self._members.get(target), self.world.machines
        if member is None or sender not in machines or target not in machines:
            return None
        if traffic == GROUP:
            return self._trace_datagram(sender, target)
        packet = self.make_packet(member, traffic)
        way = packets.echo(self.world, sender, replace(packet, port=port) if port else packet)
        failed = way.failure
        if failed is None or failed.rule is None:
            return None
        rule, where = failed.rule, failed.where
        if isinstance(rule, Lookup):
            return Component("route", where, "rule", policy.write_rule(rule))
        if rule.chain in machines[where].unclear:
            return None  # a rule that was not understood may have let it pass
        if _is_for_one_pair(rule):
            return Component.from_pair("filter", "pair", sender, target)
        if rule.chain == FORWARD:
            return self._name_filter(rule, where, "forward", _describe_forwarded(rule, traffic))
        mode = MODES.get(traffic, traffic) if rule.protocol else ALL
        return self._name_end(rule, where, mode, "" if failed is way.back else rule.chain)

    def _trace_datagram(self, sender: str, target: str) -> Component | None:
        """Return the filter at one of the two ends that drops a datagram to the group."""
        speaker, hearer = (self.world.machines[name] for name in (sender, target))
        source, there = (self._address(name) for name in (sender, target))
        packet = Packet("udp", IPv4Address(self._fleet.multicast_group), source=source, port=self._fleet.multicast_port)
        leaving, coming = (_device(one, own) for one, own in ((speaker, source), (hearer, there)))
        ends = (
            (speaker, OUT, speaker.find_blocking_rule(OUT, packet, leaving=leaving)),
            (hearer, IN, hearer.find_blocking_rule(IN, packet, coming)),
        )
        for machine, chain, rule in ends:
            if rule is not None and chain not in machine.unclear:
                mode = GROUP if rule.destinations else "udp" if rule.protocol else ALL
                return self._name_end(rule, machine.name, mode, chain)
        return None

    def make_packet(self, member: Member, traffic: str) -> Packet:
        """Make a packet of a kind to a member of the fleet."""
        protocol = TRAFFIC[traffic]
        if protocol == "icmp":
            return Packet(protocol, member.address, size=LARGE_SIZE if traffic == LARGE else Packet.size)
        if traffic == "udp":
            return Packet(protocol, self._address(member.name), port=self._fleet.multicast_port)
        if traffic == "rpc":
            masters = (master for master in self._fleet.masters if master.computer == member.name)
            places = ((master.address, master.rpc_port) for master in masters)
            address, port = next(places, (member.address, NODES))
            return Packet(protocol, address, port=port)
        port = self._fleet.computers[member.name].roscore_port if traffic == ROSCORE else NODES
        return Packet(protocol, member.address, port=port)

    def _address(self, name: str) -> IPv4Address:
        """Return the address by which a computer is discovered, or else its own."""
        member = self._members.get(name)
        return member.discovery_address if member else self._fleet.computers[name].address

    @cached_property
    def world(self) -> World:
        """The planned world, with the rules that were read."""
        world = plan_world.make_world(self._fleet)
        seen = {name: one for name, one in self._observations.items() if name in world.machines}
        read = {name: _apply_rules(world.machines[name], one) for name, one in seen.items()}
        return facts.merge_links(self._fleet, World({**world.machines, **read}, world.links))


def _apply_rules(machine: Machine, seen: Observation) -> Machine:
    """Return the planned machine with the interface names and the rules that were read. Without sense they make it unclear."""
    if seen.probe and seen.probe.policy.rules:
        closed = (rule for rule in policy.lookups(seen.probe.policy.rules) if rule.kind in NO_WAY)
        machine = replace(machine, lookups=tuple(closed))
    filters = seen.filters
    if filters is None or not filters.readable:
        return machine
    try:
        rules, unclear = facts.read_rules(to_plain(chain) for chain in filters.chains)
    except (LookupError, TypeError, ValueError):
        return replace(machine, unclear=frozenset({IN, OUT, FORWARD}))
    names = _read_names(machine, seen)
    return replace(
        machine,
        interfaces=_join_interfaces(replace(one, name=names[one.name]) for one in machine.interfaces),
        routes=tuple(replace(route, device=names.get(route.device, route.device)) for route in machine.routes),
        rules=(*rules, *machine.rules),
        unclear=unclear,
    )


def _join_interfaces(interfaces: Iterable[Interface]) -> tuple[Interface, ...]:
    """Make one interface of those of one name: it has several planned addresses."""
    joined: dict[str, Interface] = {}
    for one in interfaces:
        before = joined.get(one.name)
        joined[one.name] = replace(before, addresses=(*before.addresses, *one.addresses)) if before else one
    return tuple(joined.values())


def _read_names(machine: Machine, seen: Observation) -> dict[str, str]:
    """Return the real name of each interface of a planned machine, found by its addresses."""
    real = {
        address: entry.interface
        for entry in (seen.probe.forwarding.interfaces if seen.probe else ())
        for address in entry.addresses
    }
    own = {one.name: [str(entry.ip) for entry in one.addresses] for one in machine.interfaces}
    return {
        name: next((real[address] for address in addresses if address in real), name) for name, addresses in own.items()
    }


def _describe_forwarded(rule: Rule, traffic: str) -> str:
    """Name the packets that a rule for forwarded ones drops; empty for all of them."""
    protocol = TRAFFIC[traffic].upper() if rule.protocol else ""
    if rule.above:
        return " ".join(filter(None, (protocol, f"packets of more than {rule.above} bytes")))
    return protocol


def _is_for_one_pair(rule: Rule) -> bool:
    """Return True if a rule is only for one sender and one receiver."""
    ends = (rule.sources, rule.destinations)
    return all(len(networks) == 1 and networks[0].prefixlen == 32 for networks in ends)


def _device(machine: Machine, address: IPv4Address | None) -> str:
    interface = machine.find_interface(address) if address else None
    return interface.name if interface else ""
