# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The needs of an observation: the components on the way between two computers, and those of ROS between two robots.

Pure: the context of a check in, components out. A check joins these sets; see `engine.Check`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from itertools import pairwise

from ..._base.features import load_hooks
from ..._plan.model import COMMON
from ..components.component import Component
from .check_context import CheckContext
from .hooks import ContextHooks

Components = frozenset[Component]

NAMES = ("unknown", "loopback", "old", "several")  # a name with a wrong meaning
DISCOVERY = ("dead", "hung", "group")
# the needs of a computer that forwards packets: kind and mode of components
FORWARDER = (("computer", "off"), ("forwarding", "off"), ("filter", "forward"), ("reverse_path", "strict"))


def make_components(kind: str, place: str, *modes: str, what: str = "") -> Components:
    """Make components of one kind at one place; an empty place has no components."""
    return frozenset(Component(kind, place, mode, what) for mode in modes) if place else frozenset()


def _list_hooks() -> Collection[ContextHooks]:
    return load_hooks("context", ContextHooks).values()


def make_service_component(computer: str, service: str) -> Components:
    """Make the component that is broken while a service of an optional feature is down; nothing for other services."""
    kinds = (hooks.services[service] for hooks in _list_hooks() if service in hooks.services)
    return join_components(make_components(kind, computer, mode) for kind, mode in kinds)


# The network


def way(context: CheckContext, one: str, other: str) -> Components:
    """List the components that a packet and its answer need between two computers."""
    if not one or not other or one == other:
        return frozenset()
    known = context.ways.components
    if (one, other) not in known:
        known[one, other] = _way(context, one, other)
    return known[one, other]


def _way(context: CheckContext, one: str, other: str) -> Components:
    components = {Component.from_pair("filter", "pair", one, other)}
    for computer in (one, other):
        components |= make_components("computer", computer, "off") | make_components(
            "interface", computer, "address", "prefix"
        )
        components |= port_components(context, computer)
    components |= duplicates(context, one, other) | neighbours(context, one, other) | neighbours(context, other, one)
    for asks, answers in _hops(context, one, other):
        components |= {Component("neighbour", asks, "fixed", answers), Component("neighbour", answers, "fixed", asks)}
    links, between = context.ways.list_links(one, other), context.ways.list_forwarders(one, other)
    places = [place for place, network in links if network == COMMON]
    components |= join_components(hooks.list_way_components(context, places) for hooks in _list_hooks())
    components |= {Component(kind, gateway, mode) for gateway in between for kind, mode in FORWARDER}
    return frozenset(components | _link_components(context, one, other, "down", "dead") | _routes(context, one, other))


def _link_components(context: CheckContext, one: str, other: str, mode: str, *network_modes: str) -> Components:
    """List a fault of each link on the way, and faults of each network."""
    return join_components(
        make_components("link", place, mode, what=network) | make_components("network", network, *network_modes)
        for place, network in context.ways.list_links(one, other)
    )


def neighbours(context: CheckContext, sender: str, target: str) -> Components:
    """List the needs of the ARP questions and answers for a packet from one computer to the other. Its answer needs those of the way back."""
    hops = list(_hops(context, sender, target))
    mute = frozenset(Component("neighbour", answers, "mute") for _asks, answers in hops)
    return mute | {Component("neighbour", place, "filter") for hop in hops for place in hop}


def _hops(context: CheckContext, one: str, other: str) -> Iterable[tuple[str, str]]:
    """List the neighbours on the way, two by two."""
    return pairwise(dict.fromkeys(place for place, _network in context.ways.list_links(one, other)))


def duplicates(context: CheckContext, one: str, other: str) -> Components:
    """List the addresses on the way that a second computer may have. Chance decides which of the two a neighbour finds."""
    return frozenset(
        Component("interface", place, "duplicate", what)
        for asks, answers in _hops(context, one, other)
        for place, other_one in ((answers, asks), (asks, answers))
        for what in (other_one, "")
    )


def _routes(context: CheckContext, one: str, other: str) -> Components:
    """List the routes of a packet and its answer: those of the two ends, and of the gateways between them."""
    if context.ways.robot_of(one) == context.ways.robot_of(other):
        return frozenset()
    there = context.ways.network_of(other)  # the other may be a gateway
    back = context.ways.network_of(one) if context.ways.find_gateway(one) else COMMON
    if context.ways.is_in(one, there) and context.ways.is_in(other, back):
        return frozenset()
    between = context.ways.list_forwarders(one, other)
    components = set(make_components("route", one, "defaults") | make_components("route", other, "defaults"))
    for destination, computers in ((there, [one, *between]), (back, [*between, other])):
        for computer in computers:
            components |= {
                Component("route", computer, "circle", destination),
                *make_components("route", computer, "closed", "rule"),
            }
            if not context.ways.is_in(computer, destination):
                components |= route_components(computer, destination)
    return frozenset(components)


def by_passes(computer: str) -> Components:
    """List the components that optional features suspect if packets of a computer leave by another route than the planned one."""
    return join_components(hooks.list_route_components(computer) for hooks in _list_hooks())


def route_components(computer: str, network: str) -> Components:
    """List how the route of a computer to a network may be wrong, or its routes to all others."""
    return join_components(make_components("route", computer, "missing", "other", what=what) for what in (network, ""))


def large(context: CheckContext, one: str, other: str) -> Components:
    """List the components that lose only large packets on the way."""
    if one == other:
        return frozenset()
    components: set[Component] = set()
    for place, network in context.ways.list_links(one, other):
        if network == COMMON:
            components |= join_components(hooks.list_large_components(context, place) for hooks in _list_hooks())
        components |= make_components("interface", place, "mtu", what=network) | make_components(
            "network", network, "large"
        )
    for gateway in context.ways.list_forwarders(one, other):
        components |= make_components("forwarding", gateway, "large")
    return frozenset(components)


def arp_components(context: CheckContext, one: str, other: str) -> Components:
    """List the components that may keep the ARP answer for the next address on the way from coming.

    A computer that forwards packets reports it to their sender ("host unreachable"). A device of another make may not.
    """
    components: set[Component] = set()
    for (place, network), (following, beyond) in pairwise(context.ways.list_links(one, other)):
        if network == beyond and place in context.fleet.computers:
            components |= silent_components(place, following, network)
    return frozenset(components)


def silent_components(one: str, other: str, network: str) -> Components:
    """List the components that may keep a computer from answering its neighbour on a network."""
    links_down = make_components("link", one, "down", what=network) | make_components(
        "link", other, "down", what=network
    )
    there = make_components("computer", other, "off") | make_components("interface", other, "address")
    return links_down | there | make_components("network", network, "dead")


def port_components(context: CheckContext, computer: str) -> Components:
    """Suspect the port of a bridge only if an address was seen on one."""
    seen = context.run.get(computer)
    return make_components("interface", computer, "port") if seen and seen.list_ports() else frozenset()


def loss_components(context: CheckContext, one: str, other: str) -> Components:
    """List the components that lose some packets on the way: wireless interfaces that save power among them."""
    return _link_components(context, one, other, "loss", "loss") | join_components(
        make_components("link", place, "power_save", what=network)
        for place, network in context.ways.list_links(one, other)
        if (computer := context.run.get(place))
        and (interface := computer.interface_on.get(network))
        and interface.power_save
    )


def slow(context: CheckContext, one: str, other: str) -> Components:
    """List the components that may make a stream slow. It goes out of one link and into the next."""
    components: set[Component] = set()
    for number, (place, network) in enumerate(context.ways.list_links(one, other)):
        components |= make_components("link", place, "slow", "slow in" if number % 2 else "slow out", what=network)
        components |= make_components("network", network, "slow")
    return frozenset(components)


def translation_components(context: CheckContext, one: str, other: str) -> Components:
    """List the translations that may be on the way: a gateway translates packets that leave by one of its interfaces."""
    crossed = pairwise(context.ways.list_links(one, other))
    return join_components(
        make_components("translation", place, "on", what=network)
        for (before, _came), (place, network) in crossed
        if before == place
    )


def active_translations(context: CheckContext, one: str, other: str) -> Components:
    """List the translations that may be at work: the gateway's address has called the other end, if that end listened."""
    hearer = context.run.get(other)
    components = translation_components(context, one, other)
    if hearer is None or not hearer.multicast.udp:
        return components
    return frozenset(component for component in components if _outer_addresses(context, component) & hearer.callers)


def _outer_addresses(context: CheckContext, component: Component) -> frozenset[str]:
    """Return the address of a gateway on the network of a translation."""
    same = (gateway for gateway in context.ways.gateways.values() if gateway.title == component.place)
    return frozenset(str(one.common_address if component.what == COMMON else one.address) for one in same)


def passes(one: str, other: str, *whats: str) -> Components:
    """List the packet filters at the ends that may drop packets from one computer to the other, or their answers."""
    if one == other or not one or not other:
        return frozenset()
    coming = [mode for what in (*whats, "all") for mode in (f"{what} in", what)]
    going = [mode for what in (*whats, "all") for mode in (f"{what} out", what)]
    changed = make_components("filter", one, "changed") | make_components("filter", other, "changed")
    return make_components("filter", other, *coming) | make_components("filter", one, *going) | changed


def multicast(context: CheckContext, hearer: str, speaker: str) -> Components:
    """List the components that datagrams on the group need from the speaker to the hearer."""
    components = set(passes(speaker, hearer, "udp", "group"))
    components |= make_components("interface", hearer, "multicast") | make_components("interface", speaker, "multicast")
    components |= _link_components(context, speaker, hearer, "down", "dead", "multicast")
    for gateway in _group_forwarders(context, hearer, speaker):
        components |= make_components("computer", gateway, "off") | make_components("filter", gateway, "forward")
        components |= make_components("service", gateway, "down", what="multimaster-multicast-routing.service")
    components |= port_components(context, hearer) | port_components(context, speaker)
    sends = make_components("computer", speaker, "off") | make_components("interface", speaker, "address")
    return frozenset(components | sends | {Component.from_pair("filter", "pair", hearer, speaker)})


def _group_forwarders(context: CheckContext, one: str, other: str) -> list[str]:
    """List the computers that forward the group between two. A gateway also forwards its own datagrams."""
    between = context.ways.list_forwarders(one, other)
    if not between and context.ways.robot_of(one) == context.ways.robot_of(other):
        return [place for place in (one, other) if (plan := context.fleet.computers.get(place)) and plan.passes_group]
    return between


# Names, and ROS on a computer


def names(observer: str, target: str) -> Components:
    """List how the name of the target may be wrong on the observer."""
    if not observer or not target:
        return frozenset()
    return make_components("names", observer, *NAMES, what=target) | make_components(
        "names", observer, "rights", "order"
    )


def talks(context: CheckContext, one: str, other: str, *whats: str) -> Components:
    """List the needs of a connection by name: the way, the packet filters, and the name."""
    if not one or not other:
        return frozenset()
    return way(context, one, other) | passes(one, other, *whats) | names(one, other)


def roscore(context: CheckContext, computer: str, master: str) -> Components:
    """List the needs of a computer's question to its roscore."""
    asked = make_components("roscore", master, "dead", "hung", "name") | make_components(
        "environment", computer, "shell"
    )
    return asked | (talks(context, computer, master, "roscore") if computer != master else names(computer, master))


def discovery(computer: str) -> Components:
    """List the faults of a discovery node and its roscore."""
    return make_components("discovery", computer, *DISCOVERY) | make_components("roscore", computer, "dead", "hung")


def master_query_components(context: CheckContext, own: str, its: str) -> Components:
    """List the needs of a query to the discovery node of another master."""
    if own == its:
        return frozenset()
    node = make_components("discovery", its, *DISCOVERY, "configuration", "port")
    served = make_components("roscore", its, "dead", "hung", "name") | make_components(
        "environment", its, "service", "shell"
    )
    return node | served | talks(context, own, its, "rpc")


def heartbeats(context: CheckContext, own: str, its: str) -> Components:
    """List the components that may keep heartbeats of another master from arriving, with either transport.

    If the probes' datagrams arrive, two reasons are left. The node sends by another interface, or a gateway translates
    the source address, so that the heartbeats belong to no member.
    """
    if own == its:
        return frozenset()
    changed = active_translations(context, its, own)
    if _arrive(context, its, own):
        return changed | make_components("interface", own, "multicast") | make_components("interface", its, "multicast")
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


def registration_components(context: CheckContext, observer: str, target: str) -> Components:
    """List the needs of the target's registrations on their way to the observer's roscore, and those of a query there."""
    own, its = context.ways.master_of(observer), context.ways.master_of(target)
    at_home, asked = home_components(context, target), roscore(context, observer, own)
    if own == its:
        return at_home | asked
    return at_home | asked | master_query_components(context, own, its) | make_components("sync", own, "dead", "hung")


def home_components(context: CheckContext, target: str) -> Components:
    """List the needs of the target's talker for its registration at its own roscore."""
    own_components = make_components("registration", target, "talker") | make_components("environment", target, "shell")
    return roscore(context, target, context.ways.master_of(target)) | own_components


def node_connection_components(context: CheckContext, observer: str, target: str) -> Components:
    """List the needs of a connection between nodes of two computers."""
    return (
        talks(context, observer, target, "nodes")
        | make_components("environment", target, "shell")
        | make_components(
            "environment", observer, "shell"
        )  # at its URI the roscore notifies a subscriber of new publishers
        | make_components("registration", observer, "listener")
    )


def join_components(groups: Iterable[Components]) -> Components:
    """Join sets of components."""
    return frozenset().union(*groups)
