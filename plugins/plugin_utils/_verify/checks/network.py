# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of the network between two computers: names, routes, pings."""

from __future__ import annotations

import ipaddress

from ..._plan.model import COMMON
from ..context import needs
from ..context.check_context import CheckContext
from ..context.needs import Components, join_components, make_components
from ..context.policy_routing import taker
from ..observe.observations import Ping, TargetRoute
from ..observe.outcomes import Outcome
from .engine import FAILED, ITSELF_TOO, MEMBER, OK, WARNING, Check, Judgement, judge_fault

LOST = 0.2  # of the pings to one computer: in a wireless network some are always lost, and few are sent

# The computer that has an address


def _find_duplicates(context: CheckContext) -> dict[str, list[str]]:
    """List the addresses on the observer's networks for which another one answers, too: address -> hardware addresses.

    A computer with two interfaces in one network answers by both, so its own are left out.
    """
    found = {}
    own = {str(entry.address) for entry in context.observer.plan.networks}
    for claim in context.probe.claims:
        holder = context.observer if claim.address in own else context.run.get(context.ways.name_at(claim.address))
        known = holder.hardware_addresses if holder else frozenset()
        strange = [mac for mac in claim.macs if mac.lower() not in known]
        if context.ways.name_at(claim.address) and len(strange) > (0 if known else 1):
            found[claim.address] = strange
    return found


def _duplicate_needs(context: CheckContext) -> Components:
    """List the duplicates that are ruled out: a computer that gets no ARP answer for its own address is the only one with it, for all observers."""
    name = context.observer.name
    return make_components("interface", name, "duplicate") | join_components(
        make_components("interface", name, "duplicate", what=other)
        for other in (*context.ways.members, *context.ways.titles)
    )


@Check(
    title="nobody else answers for an address",
    when=lambda context: bool(context.probe.claims),
    needs=_duplicate_needs,
)
def _judge_address_once(context: CheckContext) -> Judgement:
    twice = _find_duplicates(context)
    found = "; ".join(f"for {address} also {' and '.join(macs)}" for address, macs in twice.items())
    components = join_components(
        make_components("interface", context.ways.name_at(address), "duplicate") for address in twice
    )
    return judge_fault(FAILED, "one computer answers for each address", found, "one for each", components)


# The name


def _name_mistake(context: CheckContext) -> str:
    """Return the mode in which the name is wrong."""
    addresses = context.member.addresses
    if not addresses:
        return "unknown"
    if _is_own_too(context):
        return "own"
    if any(_is_loopback(address) for address in addresses):
        return "loopback"
    return "several" if len(addresses) > 1 else "old"


def _is_own_too(context: CheckContext) -> bool:
    """The own name has the planned address and that of the loopback interface: no other computer is concerned."""
    return context.target == context.observer.name and context.address in context.member.addresses


def _is_loopback(address: str) -> bool:
    """Return True if an address is one of the loopback interface; False for a text that is no address, as a strange machine may report."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return False


@Check(
    title="name means the planned address",
    scope=ITSELF_TOO,
    when=lambda context: bool(context.member.name) and not context.observer.plan.is_router,
    needs=lambda context: needs.names(context.observer.name, context.target),
)
def _judge_name(context: CheckContext) -> Judgement:
    addresses, expected = context.member.addresses, context.address
    found = ", ".join(addresses) or context.member.resolve_error
    if addresses == (expected,):
        return Judgement(OK, expected, found)
    # Fig. 6 of the report leaves 127.0.1.1 at the own name, and these robots talk.
    verdict = WARNING if context.is_set_up_by_hand and _is_own_too(context) else FAILED
    components = make_components("names", context.observer.name, _name_mistake(context), what=context.target)
    return Judgement(verdict, expected, found, components)


# The name, as others than root look it up


@Check(
    title="name means the same without rights",
    scope=ITSELF_TOO,
    needs=lambda context: make_components("names", context.observer.name, "rights"),
)
def _judge_user_name(context: CheckContext) -> Judgement | None:
    found = context.member.user_addresses
    if found is None or context.member.addresses != (context.address,) or context.observer.plan.is_router:
        return None  # another check judges the addresses for root
    expected = f"{context.address}, as for root"
    if found == (context.address,):
        return Judgement(OK, expected, context.address)
    components = make_components("names", context.observer.name, "rights", what=context.target)
    return Judgement(FAILED, expected, ", ".join(found) or "no address", components)


# The route


def _route_needs(context: CheckContext) -> Components:
    if not context.way.crosses:
        return frozenset()
    found = make_components(
        "route", context.observer.name, "missing", "other", what=context.ways.network(context.robots[1])
    )
    return found | make_components("route", context.observer.name, "missing")


def _find_route_fault(context: CheckContext, route: TargetRoute) -> Components:
    mode, what = taker(context.probe.policy, context.address)
    if mode and (route.error or (route.gateway or "") not in context.way.hops):
        return make_components("route", context.observer.name, mode, what=what)
    return _route_absence_components(context) if route.error else _wrong_route_components(context, route)


def _route_absence_components(context: CheckContext) -> Components:
    name, network = context.observer.name, context.ways.network(context.robots[1])
    if not context.way.crosses:
        small = bool(context.observer.find_wrong_prefixes())  # the target is outside of its network by the wrong prefix
        return (
            make_components("interface", name, "prefix")
            if small
            else make_components("link", name, "down", what=network)
        )
    return make_components("route", name, "missing", what="" if _has_no_routes(context) else network)


def _wrong_route_components(context: CheckContext, route: TargetRoute) -> Components:
    name, network, by = context.observer.name, context.ways.network(context.robots[1]), route.gateway or ""
    if _leaves_fleet(context, route.device):
        return make_components("route", name, "other", what=network)
    if by not in context.way.hops:
        if not (by and context.way.crosses):  # it is sent to a gateway, and is in this network, or the other way round
            return make_components("interface", name, "prefix")
        return make_components("route", name, "missing" if _falls_to_default(context, by) else "other", what=network)
    return make_components("interface", name, "address")


def _leaves_fleet(context: CheckContext, device: str | None) -> bool:
    """Packets leave by an interface that is on no network of the plan, as that of a VPN or of Docker."""
    own = context.observer.interface_on
    return len(own) == len(context.observer.plan.networks) and device not in {entry.interface for entry in own.values()}


def _falls_to_default(context: CheckContext, by: str) -> bool:
    """The planned route is one to the network, and is gone: the default route takes its packets."""
    special = all(route.destination.prefixlen for route in context.observer.plan.routes)
    return special and by in {route.gateway for route in context.probe.default_routes}


def _has_no_routes(context: CheckContext) -> bool:
    """The observer has a route to no other network."""
    members, plan = context.observer.members, context.observer.plan
    others = [name for name in context.ways.members if name in members and context.ways.way(plan, name).crosses]
    return all(route.error for name in others if (route := members[name].route))


@Check(
    title="packets leave from the planned address",
    scope=MEMBER,
    needs=_route_needs,
)
def _judge_route(context: CheckContext) -> Judgement | None:
    route, way = context.member.route, context.way
    if route is None:
        return None
    good = not route.error and route.source == way.source and (route.gateway or "") in way.hops
    expected = f"a route from {way.source}" + (f" by {way.next_hop}" if way.next_hop else "")
    via = f" by {route.gateway}" if route.gateway else ""
    found = route.error or f"on {route.device} from {route.source}{via}"
    broken = frozenset() if good else _find_route_fault(context, route)
    return Judgement(OK if good else FAILED, expected, found, broken)


# The ping by address


def _ping_needs(context: CheckContext) -> Components:
    one, other = context.observer.name, context.target
    return (
        needs.way(context, one, other)
        | needs.passes(one, other, "icmp")
        | make_components("setting", other, "icmp_all")
    )


def _answers_sometimes(context: CheckContext) -> bool:
    """Of further requests some were answered: packets get lost, and no filter drops them."""
    return context.member.loss is not None and context.member.loss < 1.0


def _ping_suspects(context: CheckContext) -> Components:
    if _answers_sometimes(context):
        return needs.loss_components(context, context.observer.name, context.target)
    asked = (
        needs.arp_components(context, context.observer.name, context.target) if context.member.silent else frozenset()
    )
    return _ping_needs(context) - asked


def _judge_ping(ping: Ping | None, whom: str, outcome: Outcome = Outcome.NOT_TRIED) -> Judgement | None:
    if ping is None:
        return None
    expected = f"an answer of {whom}"
    if not ping.ok:
        return Judgement(FAILED, expected, ping.error, outcome=outcome)
    return Judgement(OK, expected, "as planned" if ping.rtt_ms is None else f"{ping.rtt_ms} ms")


@Check(
    title="ping by address",
    scope=MEMBER,
    carries="icmp",
    needs=_ping_needs,
    suspects=_ping_suspects,
)
def _judge_ping_address(context: CheckContext) -> Judgement | None:
    ping = context.member.ping_address
    if ping is None or _answers_sometimes(context):
        return _judge_ping(ping, context.address)  # if only some were lost on the way, an error says nothing
    return _judge_ping(ping, context.address, ping.outcome)


# TCP, if no ping is answered: it distinguishes a packet filter that drops only pings from a computer that is off


@Check(
    title="TCP is refused, so the computer is there",
    scope=MEMBER,
    needs=lambda context: needs.way(context, context.observer.name, context.target),
)
def _judge_tcp_answer(context: CheckContext) -> Judgement | None:
    if not context.member.tcp or context.member.tcp_outcome != Outcome.REFUSED:
        return None  # nothing comes back if a packet filter drops all that it does not accept: no fault
    return Judgement(OK, "a TCP port that nobody uses refuses", "refused")


# The ping by name


@Check(
    title="ping by name",
    scope=MEMBER,
    when=lambda context: not context.observer.plan.is_router,
    needs=lambda context: _ping_needs(context) | needs.names(context.observer.name, context.target),
    suspects=lambda context: (
        needs.loss_components(context, context.observer.name, context.target)
        if _answers_sometimes(context) and context.address in context.member.addresses[:1]
        else _ping_needs(context) | needs.names(context.observer.name, context.target)
    ),
)
def _judge_ping_name(context: CheckContext) -> Judgement | None:
    return _judge_ping(context.member.ping_name, context.target)


# Large packets


@Check(
    title="large packets arrive",
    scope=MEMBER,
    needs=lambda context: needs.large(context, context.observer.name, context.target),
)
def _judge_ping_large(context: CheckContext) -> Judgement | None:
    """Judge by warnings: some devices drop only large pings. If large packets are lost, other checks fail, too."""
    judged = _judge_ping(context.member.ping_large, f"{context.address} to a large packet")
    if judged is not None and judged.verdict != OK and (context.member.loss or 0.0) > LOST:
        return None  # small ones are lost, too: the size need not be the reason
    return judged if judged is None or judged.verdict == OK else judged._replace(verdict=WARNING)


# Lost packets


@Check(
    title="few pings are lost",
    scope=MEMBER,
    needs=lambda context: needs.loss_components(context, context.observer.name, context.target),
)
def _judge_ping_loss(context: CheckContext) -> Judgement | None:
    loss = context.member.loss
    if loss is None or loss == 1.0:  # nothing at all arrives: another check judges that
        return None
    return Judgement(WARNING if loss > LOST else OK, f"less than {LOST:.0%} of the pings are lost", f"{loss:.0%}")


# The neighbour


@Check(
    title="address belongs to one computer",
    scope=MEMBER,
    needs=lambda context: make_components("interface", context.target, "duplicate", what=context.observer.name),
)
def _judge_neighbour(context: CheckContext) -> Judgement | None:
    seen, known = context.member.neighbour.lower(), context.peer.macs if context.peer else frozenset()
    if not seen or not known or context.way.crosses:
        return None
    expected = f"{context.address} is at {' or '.join(sorted(known))}"
    if context.peer and seen in context.peer.hardware_addresses:
        return Judgement(OK, expected, f"it is at {seen}")
    components = (
        make_components("neighbour", context.observer.name, "fixed", what=context.target)
        if context.member.neighbour_fixed
        else make_components("interface", context.target, "duplicate", what=context.observer.name)
    )
    return Judgement(WARNING, expected, f"it is at {seen}", components)  # a proxy may answer for it


# The answers of a neighbour to ARP, whatever its packet filters for IP drop


@Check(
    title="its packet filter lets ARP pass",
    needs=lambda context: make_components("neighbour", context.observer.name, "filter"),
)
def _judge_arp_filter(context: CheckContext) -> Judgement | None:
    filters = context.observer.seen.filters
    if filters is None or not filters.readable:
        return None
    found = ", ".join(filters.arp)
    components = make_components("neighbour", context.observer.name, "filter", what=found)
    return judge_fault(FAILED, "no packet filter that drops ARP", found, "none", components)


def _arp_question(context: CheckContext) -> tuple[str, str]:
    """Return the target's address on a network of the observer, and this network; two empty texts if the target has no address there."""
    own, its = context.robots
    if own == its and context.address in context.observer.claimed:
        return context.address, context.ways.network(own)
    outer = context.ways.discovery_addresses.get(context.target, "")
    return (outer, COMMON) if own != its and outer in context.observer.claimed else ("", "")


def _arp_needs(context: CheckContext) -> Components:
    one, other, network = context.observer.name, context.target, _arp_question(context)[1]
    ports = needs.port_components(context, one) | needs.port_components(context, other)
    return needs.silent_components(one, other, network) | make_components("neighbour", other, "mute", "filter") | ports


@Check(
    title="computer on the same network answers ARP",
    scope=MEMBER,
    needs=_arp_needs,
    # In a network that is too large, a computer looks for those of other networks, too.
    suspects=lambda context: _arp_needs(context) | make_components("interface", context.observer.name, "prefix"),
)
def _judge_answers_arp(context: CheckContext) -> Judgement | None:
    address, _network = _arp_question(context)
    answered, ping = context.observer.claimed.get(address), context.member.ping_address
    if answered is None or (not answered and ping and ping.ok):
        return None  # the question may have got lost
    expected = f"a computer with {address} answers"
    return Judgement(OK if answered else FAILED, expected, "one does" if answered else "nobody answers")
