# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The needs of an observation: the parts on the way between two computers, and those of ROS between two robots.

Pure: the context of a check in, parts out. A check joins these sets; see `engine.Check`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from itertools import pairwise

from ..._base.features import load_hooks
from ..._plan.model import COMMON
from ..components.parts import Component
from .check_context import CheckContext
from .hooks import ContextHooks

Parts = frozenset[Component]

NAMES = ("unknown", "loopback", "old", "several")  # a name with a wrong meaning
DISCOVERY = ("dead", "hung", "group")
# what a computer that forwards packets needs: kind and mode of parts
FORWARDER = (("computer", "off"), ("forwarding", "off"), ("filter", "forward"), ("reverse_path", "strict"))


def make_parts(kind: str, place: str, *modes: str, what: str = "") -> Parts:
    """Make parts of one kind at one place; an empty place has no parts."""
    return frozenset(Component(kind, place, mode, what) for mode in modes) if place else frozenset()


def _list_hooks() -> Collection[ContextHooks]:
    return load_hooks("context", ContextHooks).values()


def make_service_part(computer: str, service: str) -> Parts:
    """Make the part that is broken while a service of an optional feature is down; nothing for other services."""
    kinds = (hooks.services[service] for hooks in _list_hooks() if service in hooks.services)
    return join_parts(make_parts(kind, computer, mode) for kind, mode in kinds)


# The network


def way(context: CheckContext, one: str, other: str) -> Parts:
    """List the parts that a packet and its answer need between two computers."""
    if not one or not other or one == other:
        return frozenset()
    known = context.ways.parts
    if (one, other) not in known:
        known[one, other] = _way(context, one, other)
    return known[one, other]


def _way(context: CheckContext, one: str, other: str) -> Parts:
    parts = {Component.from_pair("filter", "pair", one, other)}
    for computer in (one, other):
        parts |= make_parts("computer", computer, "off") | make_parts("interface", computer, "address", "prefix")
        parts |= port_parts(context, computer)
    parts |= duplicates(context, one, other) | neighbours(context, one, other) | neighbours(context, other, one)
    for asks, answers in _hops(context, one, other):
        parts |= {Component("neighbour", asks, "fixed", answers), Component("neighbour", answers, "fixed", asks)}
    links, between = context.ways.list_links(one, other), context.ways.list_forwarders(one, other)
    places = [place for place, network in links if network == COMMON]
    parts |= join_parts(hooks.list_way_parts(context, places) for hooks in _list_hooks())
    parts |= {Component(kind, gateway, mode) for gateway in between for kind, mode in FORWARDER}
    return frozenset(parts | _link_parts(context, one, other, "down", "dead") | _routes(context, one, other))


def _link_parts(context: CheckContext, one: str, other: str, mode: str, *network_modes: str) -> Parts:
    """List a fault of each link on the way, and faults of each network."""
    return join_parts(
        make_parts("link", place, mode, what=network) | make_parts("network", network, *network_modes)
        for place, network in context.ways.list_links(one, other)
    )


def neighbours(context: CheckContext, sender: str, target: str) -> Parts:
    """List what the ARP questions and answers need of a packet from one computer to the other. Its answer needs those of the way back."""
    hops = list(_hops(context, sender, target))
    mute = frozenset(Component("neighbour", answers, "mute") for _asks, answers in hops)
    return mute | {Component("neighbour", place, "filter") for hop in hops for place in hop}


def _hops(context: CheckContext, one: str, other: str) -> Iterable[tuple[str, str]]:
    """List the neighbours on the way, two by two."""
    return pairwise(dict.fromkeys(place for place, _network in context.ways.list_links(one, other)))


def duplicates(context: CheckContext, one: str, other: str) -> Parts:
    """List the addresses on the way that a second computer may have. Chance decides which of the two a neighbour finds."""
    return frozenset(
        Component("interface", place, "duplicate", what)
        for asks, answers in _hops(context, one, other)
        for place, other_one in ((answers, asks), (asks, answers))
        for what in (other_one, "")
    )


def _routes(context: CheckContext, one: str, other: str) -> Parts:
    """List the routes of a packet and its answer: those of the two ends, and of the gateways between them."""
    if context.ways.robot_of(one) == context.ways.robot_of(other):
        return frozenset()
    there = context.ways.network_of(other)  # the other may be a gateway
    back = context.ways.network_of(one) if context.ways.find_gateway(one) else COMMON
    if context.ways.is_in(one, there) and context.ways.is_in(other, back):
        return frozenset()
    between = context.ways.list_forwarders(one, other)
    parts = set(make_parts("route", one, "defaults") | make_parts("route", other, "defaults"))
    for destination, computers in ((there, [one, *between]), (back, [*between, other])):
        for computer in computers:
            parts |= {
                Component("route", computer, "circle", destination),
                *make_parts("route", computer, "closed", "rule"),
            }
            if not context.ways.is_in(computer, destination):
                parts |= route_parts(computer, destination)
    return frozenset(parts)


def by_passes(computer: str) -> Parts:
    """List what optional features find where packets of a computer leave by another route than the planned one."""
    return join_parts(hooks.list_route_parts(computer) for hooks in _list_hooks())


def route_parts(computer: str, network: str) -> Parts:
    """List how the route of a computer to a network may be wrong, or its routes to all others."""
    return join_parts(make_parts("route", computer, "missing", "other", what=what) for what in (network, ""))


def large(context: CheckContext, one: str, other: str) -> Parts:
    """List the parts that lose only large packets on the way."""
    if one == other:
        return frozenset()
    parts: set[Component] = set()
    for place, network in context.ways.list_links(one, other):
        if network == COMMON:
            parts |= join_parts(hooks.list_large_parts(context, place) for hooks in _list_hooks())
        parts |= make_parts("interface", place, "mtu", what=network) | make_parts("network", network, "large")
    for gateway in context.ways.list_forwarders(one, other):
        parts |= make_parts("forwarding", gateway, "large")
    return frozenset(parts)


def arp_parts(context: CheckContext, one: str, other: str) -> Parts:
    """List what may keep the ARP answer for the next address on the way from coming.

    A computer that forwards packets reports it to their sender ("host unreachable"). A device of another make may not.
    """
    parts: set[Component] = set()
    for (place, network), (following, beyond) in pairwise(context.ways.list_links(one, other)):
        if network == beyond and place in context.fleet.computers:
            parts |= silent_parts(place, following, network)
    return frozenset(parts)


def silent_parts(one: str, other: str, network: str) -> Parts:
    """List what may keep a computer from answering its neighbour on a network."""
    links_down = make_parts("link", one, "down", what=network) | make_parts("link", other, "down", what=network)
    there = make_parts("computer", other, "off") | make_parts("interface", other, "address")
    return links_down | there | make_parts("network", network, "dead")


def port_parts(context: CheckContext, computer: str) -> Parts:
    """Suspect the port of a bridge only where an address was seen on one."""
    seen = context.run.get(computer)
    return make_parts("interface", computer, "port") if seen and seen.list_ports() else frozenset()


def loss_parts(context: CheckContext, one: str, other: str) -> Parts:
    """List the parts that lose some packets on the way: wireless interfaces that save power among them."""
    return _link_parts(context, one, other, "loss", "loss") | join_parts(
        make_parts("link", place, "power_save", what=network)
        for place, network in context.ways.list_links(one, other)
        if (computer := context.run.get(place))
        and (interface := computer.interface_on.get(network))
        and interface.power_save
    )


def slow(context: CheckContext, one: str, other: str) -> Parts:
    """List the parts that may make a stream slow. It goes out of one link and into the next."""
    parts: set[Component] = set()
    for number, (place, network) in enumerate(context.ways.list_links(one, other)):
        parts |= make_parts("link", place, "slow", "slow in" if number % 2 else "slow out", what=network)
        parts |= make_parts("network", network, "slow")
    return frozenset(parts)


def translation_parts(context: CheckContext, one: str, other: str) -> Parts:
    """List the translations that may be on the way: a gateway translates what leaves by one of its interfaces."""
    crossed = pairwise(context.ways.list_links(one, other))
    return join_parts(
        make_parts("translation", place, "on", what=network)
        for (before, _came), (place, network) in crossed
        if before == place
    )


def active_translations(context: CheckContext, one: str, other: str) -> Parts:
    """List the translations that may be at work: the gateway's address has called the other end, if that end listened."""
    hearer = context.run.get(other)
    parts = translation_parts(context, one, other)
    if hearer is None or not hearer.multicast.udp:
        return parts
    return frozenset(part for part in parts if _outer_addresses(context, part) & hearer.callers)


def _outer_addresses(context: CheckContext, part: Component) -> frozenset[str]:
    """Return the address of a gateway on the network of a translation."""
    same = (gateway for gateway in context.ways.gateways.values() if gateway.title == part.place)
    return frozenset(str(one.common_address if part.what == COMMON else one.address) for one in same)


def passes(one: str, other: str, *whats: str) -> Parts:
    """List the packet filters at the ends that may drop packets from one computer to the other, or their answers."""
    if one == other or not one or not other:
        return frozenset()
    coming = [mode for what in (*whats, "all") for mode in (f"{what} in", what)]
    going = [mode for what in (*whats, "all") for mode in (f"{what} out", what)]
    changed = make_parts("filter", one, "changed") | make_parts("filter", other, "changed")
    return make_parts("filter", other, *coming) | make_parts("filter", one, *going) | changed


def multicast(context: CheckContext, hearer: str, speaker: str) -> Parts:
    """List the parts that datagrams on the group need from the speaker to the hearer."""
    parts = set(passes(speaker, hearer, "udp", "group"))
    parts |= make_parts("interface", hearer, "multicast") | make_parts("interface", speaker, "multicast")
    parts |= _link_parts(context, speaker, hearer, "down", "dead", "multicast")
    for gateway in _group_forwarders(context, hearer, speaker):
        parts |= make_parts("computer", gateway, "off") | make_parts("filter", gateway, "forward")
        parts |= make_parts("service", gateway, "down", what="multimaster-multicast-routing.service")
    parts |= port_parts(context, hearer) | port_parts(context, speaker)
    sends = make_parts("computer", speaker, "off") | make_parts("interface", speaker, "address")
    return frozenset(parts | sends | {Component.from_pair("filter", "pair", hearer, speaker)})


def _group_forwarders(context: CheckContext, one: str, other: str) -> list[str]:
    """List the computers that forward the group between two. A gateway also forwards what it sends or receives itself."""
    between = context.ways.list_forwarders(one, other)
    if not between and context.ways.robot_of(one) == context.ways.robot_of(other):
        return [place for place in (one, other) if (plan := context.fleet.computers.get(place)) and plan.passes_group]
    return between


# Names, and ROS on a computer


def names(observer: str, target: str) -> Parts:
    """List how the name of the target may be wrong on the observer."""
    if not observer or not target:
        return frozenset()
    return make_parts("names", observer, *NAMES, what=target) | make_parts("names", observer, "rights", "order")


def talks(context: CheckContext, one: str, other: str, *whats: str) -> Parts:
    """List what a connection by name needs: the way, the packet filters, and the name."""
    if not one or not other:
        return frozenset()
    return way(context, one, other) | passes(one, other, *whats) | names(one, other)


def roscore(context: CheckContext, computer: str, master: str) -> Parts:
    """List what a computer needs to ask its roscore."""
    asked = make_parts("roscore", master, "dead", "hung", "name") | make_parts("environment", computer, "shell")
    return asked | (talks(context, computer, master, "roscore") if computer != master else names(computer, master))


def discovery(computer: str) -> Parts:
    """List the faults of a discovery node and its roscore."""
    return make_parts("discovery", computer, *DISCOVERY) | make_parts("roscore", computer, "dead", "hung")


def master_query_parts(context: CheckContext, own: str, its: str) -> Parts:
    """List what a query to the discovery node of another master needs."""
    if own == its:
        return frozenset()
    node = make_parts("discovery", its, *DISCOVERY, "configuration", "port")
    served = make_parts("roscore", its, "dead", "hung", "name") | make_parts("environment", its, "service", "shell")
    return node | served | talks(context, own, its, "rpc")


def heartbeats(context: CheckContext, own: str, its: str) -> Parts:
    """List what may keep heartbeats of another master from arriving, with either transport.

    Where the probes' datagrams arrive, two reasons are left. The node sends by another interface, or a gateway translates
    the source address, so that the heartbeats belong to no member.
    """
    if own == its:
        return frozenset()
    changed = active_translations(context, its, own)
    if _arrive(context, its, own):
        return changed | make_parts("interface", own, "multicast") | make_parts("interface", its, "multicast")
    members = [context.ways.members.get(name) for name in (own, its)]
    grouped = context.fleet.transport != "unicast" and all(
        member is not None and member.multicast for member in members
    )
    to_itself = passes(its, own, "udp") | changed
    return to_itself | passes(its, own, "group") | multicast(context, own, its) if grouped else to_itself


def _arrive(context: CheckContext, sender: str, hearer: str) -> bool:
    """Return True if datagrams of the transport are known to arrive, on the group or at the computer itself."""
    here, there = context.run.get(hearer), context.run.get(sender)
    on_group = here.udp.get(sender) if here else None
    to_it = there.udp.get(hearer) if there else None
    heard = context.fleet.transport != "unicast" and on_group is not None and on_group.heard_from
    return heard or (context.fleet.transport != "multicast" and to_it is not None and to_it.unicast is True)


def registration_parts(context: CheckContext, observer: str, target: str) -> Parts:
    """List what the target's registrations need to reach the observer's roscore, and what a query there needs."""
    own, its = context.ways.master_of(observer), context.ways.master_of(target)
    at_home, asked = home_parts(context, target), roscore(context, observer, own)
    if own == its:
        return at_home | asked
    return at_home | asked | master_query_parts(context, own, its) | make_parts("sync", own, "dead", "hung")


def home_parts(context: CheckContext, target: str) -> Parts:
    """List what the target's talker needs to be registered at its own roscore."""
    own_parts = make_parts("registration", target, "talker") | make_parts("environment", target, "shell")
    return roscore(context, target, context.ways.master_of(target)) | own_parts


def node_connection_parts(context: CheckContext, observer: str, target: str) -> Parts:
    """List what a connection between nodes of two computers needs."""
    return (
        talks(context, observer, target, "nodes")
        | make_parts("environment", target, "shell")
        | make_parts("environment", observer, "shell")  # by its URI the roscore tells a subscriber of new publishers
        | make_parts("registration", observer, "listener")
    )


def join_parts(groups: Iterable[Parts]) -> Parts:
    """Join sets of parts."""
    return frozenset().union(*groups)
