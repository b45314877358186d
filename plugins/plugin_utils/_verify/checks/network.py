# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of the network between two computers: names, routes, pings."""

from __future__ import annotations

import ipaddress

from ..._plan.model import COMMON
from ..context import needs
from ..context.case import Case
from ..context.needs import Parts, join_parts, make_parts
from ..context.policy_routing import taker
from ..observe.observations import Ping, TargetRoute
from ..observe.outcomes import Outcome
from .engine import FAILED, ITSELF_TOO, MEMBER, OK, WARNING, Check, Judgement, judge_fault

LOST = 0.2  # of the pings to one computer: in a wireless network some are always lost, and few are sent

# Whose an address is


def _find_duplicates(case: Case) -> dict[str, list[str]]:
    """List the addresses on the observer's networks for which another one answers, too: address -> hardware addresses.

    A computer with two interfaces in one network answers by both, so its own are left out.
    """
    found = {}
    own = {str(entry.address) for entry in case.observer.plan.networks}
    for claim in case.probe.claims:
        holder = case.observer if claim.address in own else case.run.get(case.ways.name_at(claim.address))
        known = holder.hardware_addresses if holder else frozenset()
        strange = [mac for mac in claim.macs if mac.lower() not in known]
        if case.ways.name_at(claim.address) and len(strange) > (0 if known else 1):
            found[claim.address] = strange
    return found


def _duplicate_needs(case: Case) -> Parts:
    """A computer that gets no ARP answer for its own address is alone with it, for all observers."""
    name = case.observer.name
    return make_parts("interface", name, "duplicate") | join_parts(
        make_parts("interface", name, "duplicate", what=other) for other in (*case.ways.members, *case.ways.titles)
    )


@Check(
    title="nobody else answers for an address",
    when=lambda case: bool(case.probe.claims),
    needs=_duplicate_needs,
)
def _judge_address_once(case: Case) -> Judgement:
    twice = _find_duplicates(case)
    found = "; ".join(f"for {address} also {' and '.join(macs)}" for address, macs in twice.items())
    parts = join_parts(make_parts("interface", case.ways.name_at(address), "duplicate") for address in twice)
    return judge_fault(FAILED, "one computer answers for each address", found, "one for each", parts)


# The name


def _name_mistake(case: Case) -> str:
    """Return the mode in which the name is wrong."""
    addresses = case.member.addresses
    if not addresses:
        return "unknown"
    if _is_own_too(case):
        return "own"
    if any(_is_loopback(address) for address in addresses):
        return "loopback"
    return "several" if len(addresses) > 1 else "old"


def _is_own_too(case: Case) -> bool:
    """The own name has the planned address beside that of the loopback interface: nobody else is concerned."""
    return case.target == case.observer.name and case.address in case.member.addresses


def _is_loopback(address: str) -> bool:
    """Return True if an address is one of the loopback interface; a text that is none, as a strange machine may report, is not."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return False


@Check(
    title="name means the planned address",
    scope=ITSELF_TOO,
    when=lambda case: bool(case.member.name) and not case.observer.plan.is_router,
    needs=lambda case: needs.names(case.observer.name, case.target),
)
def _judge_name(case: Case) -> Judgement:
    addresses, expected = case.member.addresses, case.address
    found = ", ".join(addresses) or case.member.resolve_error
    if addresses == (expected,):
        return Judgement(OK, expected, found)
    # Fig. 6 of the report leaves 127.0.1.1 at the own name, and these robots talk.
    verdict = WARNING if case.is_set_up_by_hand and _is_own_too(case) else FAILED
    parts = make_parts("names", case.observer.name, _name_mistake(case), what=case.target)
    return Judgement(verdict, expected, found, parts)


# The name, as others than root look it up


@Check(
    title="name means the same without rights",
    scope=ITSELF_TOO,
    needs=lambda case: make_parts("names", case.observer.name, "rights"),
)
def _judge_user_name(case: Case) -> Judgement | None:
    found = case.member.user_addresses
    if found is None or case.member.addresses != (case.address,) or case.observer.plan.is_router:
        return None  # another check judges what root finds
    expected = f"{case.address}, as for root"
    if found == (case.address,):
        return Judgement(OK, expected, case.address)
    parts = make_parts("names", case.observer.name, "rights", what=case.target)
    return Judgement(FAILED, expected, ", ".join(found) or "no address", parts)


# The route


def _route_needs(case: Case) -> Parts:
    if not case.way.crosses:
        return frozenset()
    found = make_parts("route", case.observer.name, "missing", "other", what=case.ways.network(case.robots[1]))
    return found | make_parts("route", case.observer.name, "missing")


def _find_route_fault(case: Case, route: TargetRoute) -> Parts:
    mode, what = taker(case.probe.policy, case.address)
    if mode and (route.error or (route.gateway or "") not in case.way.hops):
        return make_parts("route", case.observer.name, mode, what=what)
    return _route_absence_parts(case) if route.error else _wrong_route_parts(case, route)


def _route_absence_parts(case: Case) -> Parts:
    name, network = case.observer.name, case.ways.network(case.robots[1])
    if not case.way.crosses:
        small = bool(case.observer.find_wrong_prefixes())  # the target is beyond what it takes for its network
        return make_parts("interface", name, "prefix") if small else make_parts("link", name, "down", what=network)
    return make_parts("route", name, "missing", what="" if _has_no_routes(case) else network)


def _wrong_route_parts(case: Case, route: TargetRoute) -> Parts:
    name, network, by = case.observer.name, case.ways.network(case.robots[1]), route.gateway or ""
    if _leaves_fleet(case, route.device):
        return make_parts("route", name, "other", what=network)
    if by not in case.way.hops:
        if not (by and case.way.crosses):  # it is sent to a gateway, and is in this network, or the other way round
            return make_parts("interface", name, "prefix")
        return make_parts("route", name, "missing" if _falls_to_default(case, by) else "other", what=network)
    return make_parts("interface", name, "address")


def _leaves_fleet(case: Case, device: str | None) -> bool:
    """Packets leave by an interface that is on no network of the plan, as that of a VPN or of Docker."""
    own = case.observer.interface_on
    return len(own) == len(case.observer.plan.networks) and device not in {entry.interface for entry in own.values()}


def _falls_to_default(case: Case, by: str) -> bool:
    """The planned route is one to the network, and is gone: the default route takes what it was for."""
    special = all(route.destination.prefixlen for route in case.observer.plan.routes)
    return special and by in {route.gateway for route in case.probe.default_routes}


def _has_no_routes(case: Case) -> bool:
    """The observer has a route to no other network."""
    members, plan = case.observer.members, case.observer.plan
    others = [name for name in case.ways.members if name in members and case.ways.way(plan, name).crosses]
    return all(route.error for name in others if (route := members[name].route))


@Check(
    title="packets leave from the planned address",
    scope=MEMBER,
    needs=_route_needs,
)
def _judge_route(case: Case) -> Judgement | None:
    route, way = case.member.route, case.way
    if route is None:
        return None
    good = not route.error and route.source == way.source and (route.gateway or "") in way.hops
    expected = f"a route from {way.source}" + (f" by {way.next_hop}" if way.next_hop else "")
    via = f" by {route.gateway}" if route.gateway else ""
    found = route.error or f"on {route.device} from {route.source}{via}"
    broken = frozenset() if good else _find_route_fault(case, route)
    return Judgement(OK if good else FAILED, expected, found, broken)


# The ping by address


def _ping_needs(case: Case) -> Parts:
    one, other = case.observer.name, case.target
    return needs.way(case, one, other) | needs.passes(one, other, "icmp") | make_parts("setting", other, "icmp_all")


def _answers_sometimes(case: Case) -> bool:
    """Of further requests some were answered: packets get lost, and no filter drops them."""
    return case.member.loss is not None and case.member.loss < 1.0


def _ping_suspects(case: Case) -> Parts:
    if _answers_sometimes(case):
        return needs.loss_parts(case, case.observer.name, case.target)
    asked = needs.arp_parts(case, case.observer.name, case.target) if case.member.silent else frozenset()
    return _ping_needs(case) - asked


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
def _judge_ping_address(case: Case) -> Judgement | None:
    ping = case.member.ping_address
    if ping is None or _answers_sometimes(case):
        return _judge_ping(ping, case.address)  # where only some were lost on the way, an error says nothing
    return _judge_ping(ping, case.address, ping.outcome)


# TCP, where no ping is answered: a packet filter that drops pings alone is told from a computer that is off


@Check(
    title="TCP is refused, so the computer is there",
    scope=MEMBER,
    needs=lambda case: needs.way(case, case.observer.name, case.target),
)
def _judge_tcp_answer(case: Case) -> Judgement | None:
    if not case.member.tcp or case.member.tcp_outcome != Outcome.REFUSED:
        return None  # nothing comes back where a packet filter drops what is not let in: no fault
    return Judgement(OK, "a TCP port that nobody uses refuses", "refused")


# The ping by name


@Check(
    title="ping by name",
    scope=MEMBER,
    when=lambda case: not case.observer.plan.is_router,
    needs=lambda case: _ping_needs(case) | needs.names(case.observer.name, case.target),
    suspects=lambda case: (
        needs.loss_parts(case, case.observer.name, case.target)
        if _answers_sometimes(case) and case.address in case.member.addresses[:1]
        else _ping_needs(case) | needs.names(case.observer.name, case.target)
    ),
)
def _judge_ping_name(case: Case) -> Judgement | None:
    return _judge_ping(case.member.ping_name, case.target)


# Large packets


@Check(
    title="large packets arrive",
    scope=MEMBER,
    needs=lambda case: needs.large(case, case.observer.name, case.target),
)
def _judge_ping_large(case: Case) -> Judgement | None:
    """Judge by warnings: some devices drop only large pings. Where large packets are lost, other checks fail, too."""
    judged = _judge_ping(case.member.ping_large, f"{case.address} to a large packet")
    if judged is not None and judged.verdict != OK and (case.member.loss or 0.0) > LOST:
        return None  # small ones are lost, too: the size need not be the reason
    return judged if judged is None or judged.verdict == OK else judged._replace(verdict=WARNING)


# Lost packets


@Check(
    title="few pings are lost",
    scope=MEMBER,
    needs=lambda case: needs.loss_parts(case, case.observer.name, case.target),
)
def _judge_ping_loss(case: Case) -> Judgement | None:
    loss = case.member.loss
    if loss is None or loss == 1.0:  # nothing at all arrives: another check judges that
        return None
    return Judgement(WARNING if loss > LOST else OK, f"less than {LOST:.0%} of the pings are lost", f"{loss:.0%}")


# The neighbour


@Check(
    title="address belongs to one computer",
    scope=MEMBER,
    needs=lambda case: make_parts("interface", case.target, "duplicate", what=case.observer.name),
)
def _judge_neighbour(case: Case) -> Judgement | None:
    seen, known = case.member.neighbour.lower(), case.peer.macs if case.peer else frozenset()
    if not seen or not known or case.way.crosses:
        return None
    expected = f"{case.address} is at {' or '.join(sorted(known))}"
    if case.peer and seen in case.peer.hardware_addresses:
        return Judgement(OK, expected, f"it is at {seen}")
    parts = (
        make_parts("neighbour", case.observer.name, "fixed", what=case.target)
        if case.member.neighbour_fixed
        else make_parts("interface", case.target, "duplicate", what=case.observer.name)
    )
    return Judgement(WARNING, expected, f"it is at {seen}", parts)  # a proxy may answer for it


# Whether a neighbour answers, whatever its packet filters drop


@Check(
    title="its packet filter lets ARP pass",
    needs=lambda case: make_parts("neighbour", case.observer.name, "filter"),
)
def _judge_arp_filter(case: Case) -> Judgement | None:
    filters = case.observer.seen.filters
    if filters is None or not filters.readable:
        return None
    found = ", ".join(filters.arp)
    parts = make_parts("neighbour", case.observer.name, "filter", what=found)
    return judge_fault(FAILED, "no packet filter that drops ARP", found, "none", parts)


def _arp_question(case: Case) -> tuple[str, str]:
    """Return the target's address on a network of the observer, and this network; two empty texts where it has none."""
    own, its = case.robots
    if own == its and case.address in case.observer.claimed:
        return case.address, case.ways.network(own)
    outer = case.ways.discovery_addresses.get(case.target, "")
    return (outer, COMMON) if own != its and outer in case.observer.claimed else ("", "")


def _arp_needs(case: Case) -> Parts:
    one, other, network = case.observer.name, case.target, _arp_question(case)[1]
    ports = needs.port_parts(case, one) | needs.port_parts(case, other)
    return needs.silent_parts(one, other, network) | make_parts("neighbour", other, "mute", "filter") | ports


@Check(
    title="computer on the same network answers ARP",
    scope=MEMBER,
    needs=_arp_needs,
    # In a network that is too large, a computer looks for those of other networks, too.
    suspects=lambda case: _arp_needs(case) | make_parts("interface", case.observer.name, "prefix"),
)
def _judge_answers_arp(case: Case) -> Judgement | None:
    address, _network = _arp_question(case)
    answered, ping = case.observer.claimed.get(address), case.member.ping_address
    if answered is None or (not answered and ping and ping.ok):
        return None  # the question may have got lost
    expected = f"somebody answers who has {address}"
    return Judgement(OK if answered else FAILED, expected, "somebody does" if answered else "nobody answers")
