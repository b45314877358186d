# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of discovery: datagrams between two computers, and the discovery node of each master."""

from __future__ import annotations

from ipaddress import IPv4Address

from ..._base.features import load_hooks
from ..._base.hosts import host_of
from ..._plan.model import COMMON
from ..context import needs
from ..context.check_context import CheckContext
from ..context.errors import find_components, list_refusers
from ..context.needs import Components, join_components, make_components
from ..context.packet_filters import GROUP, ROSCORE
from ..context.policy_routing import taker
from ..observe.observations import DatagramCounts, ListedMaster, TargetRoute
from ..observe.outcomes import Outcome
from ..observe.uris import is_one_of
from .engine import FAILED, MASTER, MASTER_TOO, MEMBER, OK, WARNING, Check, Judgement
from .hooks import CheckHooks

# The share of datagrams that may be lost.
LOSS = 0.05


# The interfaces that have joined the group: also by nodes that a person started by hand, whose parameters are not known

ALL_HOSTS = "224.0.0.1"  # every kernel has joined it


def _membership_interfaces(context: CheckContext) -> set[str] | None:
    """The interfaces on which a program has joined the group; None if that cannot be known, or is not needed."""
    memberships, own, group = context.observer.multicast.memberships, context.own, str(context.fleet.multicast_group)
    if not memberships or own is None or not own.multicast or group == ALL_HOSTS:
        return None
    runs = context.observer.plan.is_master and bool(context.observer.listed)
    if not runs or context.fleet.transport == "unicast":
        return None
    return {entry.interface for entry in memberships if entry.group == group}


@Check(
    title="discovery has joined the group",
)
def _judge_membership(context: CheckContext) -> Judgement | None:
    interfaces = _membership_interfaces(context)
    planned = context.observer.interface_on.get(COMMON)
    if interfaces is None or planned is None:
        return None
    expected = f"a program has joined {context.fleet.multicast_group} on {planned.interface}"
    found = f"on {' and '.join(sorted(interfaces))}" if interfaces else "on no interface"
    verdict = OK if planned.interface in interfaces else _transport_verdict(context, True)
    kind, mode = ("interface", "multicast") if interfaces else ("discovery", "group")
    return Judgement(verdict, expected, found, make_components(kind, context.observer.name, mode))


# Datagrams on the group


def _on_group(context: CheckContext) -> DatagramCounts | None:
    """The datagrams between two computers that the group reaches."""
    udp, own, planned = context.udp, context.own, context.planned
    if udp is None or own is None or planned is None or context.fleet.transport == "unicast":
        return None
    if own.robot == planned.robot and udp.other_interfaces:
        return None  # a gateway that passes the group on hears its own robot on the inner interface
    return udp if own.multicast and planned.multicast else None


def _transport_verdict(context: CheckContext, other: bool | None) -> str:
    """With the transport `both`, the discovery nodes find each other as long as one of the two ways works."""
    return WARNING if context.fleet.transport == "both" and other else FAILED


def _group_needs(context: CheckContext) -> Components:
    one, other = context.observer.name, context.target
    there = make_components("computer", other, "unmeasured", "login")
    return needs.multicast(context, one, other) | needs.loss_components(context, one, other) | there


def _group_suspects(context: CheckContext) -> Components:
    one, other = context.observer.name, context.target
    if context.udp and context.udp.heard_from:
        return needs.loss_components(context, one, other)
    if context.peer and context.peer.multicast.send_errors.count:  # its own kernel refuses to send
        return make_components("filter", other, "group out", "group", "udp out", "udp", "all out", "all")
    return _group_needs(context) - needs.loss_components(context, one, other)


def _translator(context: CheckContext, computer: str) -> Components:
    """Find the component that translates the addresses of a computer: its gateway, or the computer itself (a container, a virtual machine)."""
    other = context.observer.name if computer == context.target else context.target
    between = needs.translation_components(context, computer, other)
    if not between:
        return make_components("translation", computer, "on")
    first = context.ways.list_forwarders(computer, other)[0]
    return frozenset(component for component in between if component.place == first)


@Check(
    title="datagrams on the multicast group arrive",
    scope=MEMBER,
    carries=GROUP,
    needs=_group_needs,
    suspects=_group_suspects,
)
def _judge_udp_multicast(context: CheckContext) -> Judgement | None:
    udp = _on_group(context)
    if udp is None:
        return None
    address = context.ways.discovery_addresses[context.target]
    loss = (context.back_udp.loss if context.back_udp else None) or 0.0  # the sender knows how many it has sent
    expected = f"datagrams on {context.ways.group} from {address}"
    elsewhere = (
        make_components("interface", context.observer.name, "multicast") if udp.other_interfaces else frozenset()
    )
    if not udp.heard_from:
        found = f"none, but on {', '.join(udp.other_interfaces)}" if udp.other_interfaces else "none"
        return Judgement(_transport_verdict(context, udp.unicast), expected, found, elsewhere)
    if udp.source_address != address:
        return Judgement(FAILED, expected, f"from {udp.source_address}", _translator(context, context.target))
    if loss > LOSS:
        return Judgement(WARNING, expected, f"{loss:.0%} of them are lost", elsewhere)
    return Judgement(OK, expected, f"{udp.heard} datagrams")


# Datagrams to the computer


def _is_translated(context: CheckContext) -> bool:
    """The target's helper has heard this computer, from an address that is not the planned one."""
    theirs = context.back_udp.source_address if context.back_udp else None
    seen = (context.udp.own_source_address if context.udp else None) or theirs
    return seen is not None and seen != context.ways.discovery_addresses.get(context.observer.name)


def _unicast_needs(context: CheckContext) -> Components:
    one, other = context.observer.name, context.target
    there = needs.passes(one, other, "udp") | make_components("computer", other, "unmeasured", "login")
    # A datagram gets no answer, so the ARP questions of the way back are not asked.
    only_back = needs.neighbours(context, other, one) - needs.neighbours(context, one, other)
    return needs.way(context, one, other) - only_back | there | _outside(context)


@Check(
    title="datagrams to the computer arrive",
    scope=MEMBER,
    carries="udp",
    needs=_unicast_needs,
    suspects=lambda context: (
        _unicast_needs(context)
        | needs.active_translations(context, context.observer.name, context.target)
        | needs.active_translations(context, context.target, context.observer.name)
        | needs.passes(context.target, context.observer.name, "udp")  # the counts come back by the same port
    ),
)
def _judge_udp_unicast(context: CheckContext) -> Judgement | None:
    if context.udp is None:
        return None
    expected = f"datagrams to port {context.fleet.multicast_port} arrive there"
    if context.udp.unicast:
        return Judgement(OK, expected, "they arrive")
    if context.fleet.transport == "multicast":
        return None  # no computer needs them
    found = "no answer" if context.udp.unicast is None else "none arrives"
    broken = _translator(context, context.observer.name) if _is_translated(context) else frozenset()
    return Judgement(_transport_verdict(context, context.udp.heard_from), expected, found, broken)


# The source address of datagrams


@Check(
    title="datagrams arrive from the planned address",
    scope=MEMBER,
    needs=lambda context: (
        _unicast_needs(context) | needs.translation_components(context, context.observer.name, context.target)
    ),
    # Whatever drops the questions of ARP may drop the answers, too.
    suspects=lambda context: (
        _unicast_needs(context)
        | needs.neighbours(context, context.target, context.observer.name)
        | needs.active_translations(context, context.observer.name, context.target)
    ),
)
def _judge_source(context: CheckContext) -> Judgement | None:
    """Judge if a gateway between networks translates addresses: the helper on the target counts who called."""
    if not context.observer.is_probed or context.peer is None or not context.peer.multicast.udp:
        return None
    source = context.way.source
    arrived = source in context.peer.callers
    if not context.way.crosses and not arrived:
        return None  # in one network no gateway translates; a datagram that arrives clears the packet filters there
    expected = f"datagrams from {source} arrive there"
    if arrived:
        return Judgement(OK, expected, "they arrive")
    return Judgement(WARNING, expected, "none arrives", _find_masquerade(context))


def _find_masquerade(context: CheckContext) -> Components:
    """Find the translation on the way to the target that a rule shows and that is at work: its address has called there."""
    one, other = context.observer.name, context.target
    place = context.state.filters.find_translator(one, other)
    active = needs.active_translations(context, one, other) if place else frozenset()
    return frozenset(component for component in active if component.place == place)


# Pings of the group


def _rounds_suspects(context: CheckContext) -> Components:
    one, other = context.observer.name, context.target
    lost = needs.loss_components(context, one, other)
    if any(other in answered for _number, answered in context.observer.rounds):
        return lost  # a packet was lost: no filter drops them
    there = needs.multicast(context, other, one) | needs.way(context, one, other) | needs.passes(one, other, "icmp")
    return lost | there | make_components("setting", other, "icmp_group")


@Check(
    title="ping of the multicast group (informs only)",
    scope=MEMBER,
    needs=lambda context: make_components("setting", context.target, "icmp_group"),
    suspects=_rounds_suspects,
)
def _judge_icmp_rounds(context: CheckContext) -> Judgement | None:
    icmp = context.observer.multicast.icmp
    if icmp is None or context.peer is None or not context.peer.answers_broadcasts or context.observer.plan.carrier:
        return None  # by plan it does not answer: the kernel's default, and no harm
    if not (context.observer.plan.common_address and context.peer.plan.common_address):
        return None  # such a ping stays on the common network
    missed = [number for number, answered in context.observer.rounds if context.target not in answered]
    expected = f"an answer to each of {len(icmp.rounds)} pings of {icmp.group}"
    if icmp.error or missed:
        return Judgement(WARNING, expected, icmp.error or f"none in the rounds {', '.join(map(str, missed))}")
    return Judgement(OK, expected, "all")


# The port of a discovery node


def _connect_outcome(context: CheckContext) -> Outcome:
    entry = context.observer.masters.get(context.target)
    return entry.outcome if entry else Outcome.NOT_TRIED


def _outside(context: CheckContext) -> Components:
    """List the route that a computer needs to the discovery node of its own gateway: the node is at the gateway's outer address."""
    own, planned = context.own, context.planned
    if own is None or planned is None or own.robot != planned.robot or own.name == planned.name:
        return frozenset()
    return frozenset() if planned.discovery_address in own.network else needs.route_components(own.name, COMMON)


def _port_needs(context: CheckContext) -> Components:
    one, other = context.observer.name, context.target
    node = make_components("discovery", other, "dead", "port")
    return needs.way(context, one, other) | needs.passes(one, other, "rpc") | node | _outside(context)


def _port_suspects(context: CheckContext) -> Components:
    """List the suspects of a port that does not open. With no program on the port, the computer would refuse instead of being silent."""
    # A filter for all interfaces also drops a computer's own packets.
    filtered = make_components("filter", context.target, "rpc in", "rpc", "all in", "all")
    unused = make_components("discovery", context.target, "dead", "port")
    return _port_needs(context) - unused | make_components("discovery", context.target, "hung") | filtered


def _find_port_fault(context: CheckContext) -> Components:
    outcome = _connect_outcome(context)
    if outcome == Outcome.NETWORK_UNREACHABLE and _outside(context):  # no ping was sent to that address
        return make_components("route", context.observer.name, "missing", what=COMMON)
    if (
        outcome == Outcome.REFUSED and context.target == context.observer.name
    ):  # its node has ended, or listens elsewhere
        runs = bool(context.probe.list_masters.masters)
        return make_components("discovery", context.target, "port" if runs else "dead")
    return frozenset()


@Check(
    title="port of the discovery node opens",
    scope=MASTER_TOO,
    carries="rpc",
    needs=_port_needs,
    suspects=_port_suspects,
)
def _judge_rpc_port(context: CheckContext) -> Judgement | None:
    entry = context.observer.masters.get(context.target)
    if entry is None:
        return None
    expected = f"TCP port {entry.port} of {context.address} opens"
    if entry.open:
        return Judgement(OK, expected, f"{entry.connect_ms} ms")
    return Judgement(FAILED, expected, entry.error, _find_port_fault(context), entry.outcome)


# The route to a discovery node


def _hops(context: CheckContext, address: IPv4Address) -> frozenset[str]:
    """The next hops that packets to the address of a discovery node may have; an empty text stands for a target in a network of the computer itself."""
    plan = context.observer.plan
    if any(address in entry.network for entry in plan.networks):
        return frozenset([""])
    gateway = context.ways.find_gateway(plan.computer)
    return frozenset([str(gateway.address)]) if gateway else context.way.hops


def _judge_route(context: CheckContext, route: TargetRoute | None, address: IPv4Address) -> Judgement | None:
    if route is None:
        return None
    by, hops = route.gateway or "", _hops(context, address)
    expected = " or ".join(f"a route by {hop}" if hop else "a route without a gateway" for hop in sorted(hops))
    if not route.error and by in hops:
        return Judgement(OK, expected, f"by {by}" if by else "without a gateway")
    found = route.error or (f"by {by}" if by else "without a gateway")
    return Judgement(FAILED, expected, found, _find_route_fault(context, route, address))


def _find_route_fault(context: CheckContext, route: TargetRoute, address: IPv4Address) -> Components:
    mode, what = taker(context.probe.policy, str(address))
    if mode:
        return make_components("route", context.observer.name, mode, what=what)
    if _hops(context, address) == {""}:
        return frozenset()  # on one network: the checks of addresses and routes report it
    return make_components(
        "route", context.observer.name, "missing" if route.error else "other", what=_beyond(context, address)
    )


def _beyond(context: CheckContext, address: IPv4Address) -> str:
    """The network of the address of a discovery node, as seen from the observer."""
    return COMMON if address in context.fleet.common_network else context.ways.network(context.robots[1])


def _route_suspects(context: CheckContext) -> Components:
    """List the components that make another route than the planned ones come first."""
    name = context.observer.name
    return make_components("interface", name, "prefix", "address") | needs.by_passes(name)


@Check(
    title="route to the discovery node",
    scope=MASTER,
    needs=lambda context: make_components(
        "route", context.observer.name, "missing", "other", what=_beyond(context, context.master.address)
    ),
    suspects=_route_suspects,
)
def _judge_master_route(context: CheckContext) -> Judgement | None:
    entry = context.observer.masters.get(context.target)
    return (
        _judge_route(context, entry.route, context.master.address)
        if entry and context.target != context.observer.name
        else None
    )


# The same for the other address of a gateway, which is no master: its datagrams are measured there


def _outer(context: CheckContext) -> IPv4Address:
    """The address at which the target is discovered; if it is no member, an address that no computer has."""
    return context.planned.discovery_address if context.planned else context.fleet.common_network.network_address


@Check(
    title="route to the other address of a gateway",
    scope=MEMBER,
    needs=lambda context: make_components(
        "route", context.observer.name, "missing", "other", what=_beyond(context, _outer(context))
    ),
    suspects=_route_suspects,
)
def _judge_outer_route(context: CheckContext) -> Judgement | None:
    return _judge_route(context, context.member.discovery_route, _outer(context))


# The port of a roscore, seen from others: no other computer needs it, but it shows a roscore that has ended


@Check(
    title="port of the roscore is not refused",
    scope=MASTER,
    needs=lambda context: make_components("roscore", context.target, "dead"),
    suspects=lambda context: list_refusers(context, context.target, ROSCORE),
)
def _judge_roscore_port(context: CheckContext) -> Judgement | None:
    entry = context.observer.masters.get(context.target)
    if entry is None or entry.roscore_outcome == Outcome.NOT_TRIED:
        return None
    expected = "the TCP port of the roscore opens"
    if entry.roscore_outcome == Outcome.OPEN:
        return Judgement(OK, expected, "it opens")
    if entry.roscore_outcome != Outcome.REFUSED:
        return None  # no other computer needs it, so a packet filter may drop it
    answers = context.peer is not None and bool(context.peer.probe.roscore.answer)  # there, so something else refuses
    dead = frozenset() if answers else make_components("roscore", context.target, "dead")
    return Judgement(WARNING, expected, entry.roscore, dead)


# Clocks

# Seconds that a clock may differ from its source: tf extrapolates and messages are dropped from some tenths on.
OFF_WARNING, OFF_FAILED = 0.1, 0.5


def rate_offset(seconds: float) -> str:
    """Return the verdict of a clock that is off by so much."""
    return OK if seconds < OFF_WARNING else WARNING if seconds < OFF_FAILED else FAILED


def _clock_needs(context: CheckContext) -> Components:
    clocks = join_components(make_components("clock", name, "off") for name in (context.observer.name, context.target))
    return _port_needs(context) | make_components("discovery", context.target, "hung") | clocks


def _has_time_source(context: CheckContext, computer: str) -> bool:
    """Something keeps the clock of a computer right, as chrony does."""
    return computer in context.run and context.run[computer].probe.clock.synchronised is True


def _list_clock_components(context: CheckContext, computer: str) -> Components:
    """List the components that keep the clock of a computer right by the plan."""
    return join_components(
        hooks.list_clock_components(context, computer) for hooks in load_hooks("checks", CheckHooks).values()
    )


def _clock_suspects(context: CheckContext) -> Components:
    entry = context.observer.masters.get(context.target)
    if entry is not None and entry.clock_offset_s is not None:
        free = [name for name in (context.observer.name, context.target) if not _has_time_source(context, name)]
        suspects = free or [context.observer.name, context.target]
        return join_components(
            make_components("clock", name, "off") | _list_clock_components(context, name) for name in suspects
        )
    if entry is not None and entry.open:
        # A discovery node closes the connection of who calls from no address of the plan.
        stranger = make_components("interface", context.observer.name, "address")
        return (
            make_components("discovery", context.target, "hung")
            | needs.large(context, context.observer.name, context.target)
            | stranger
        )
    return (
        _find_port_fault(context)
        or find_components(context, _connect_outcome(context), "rpc")
        or _port_suspects(context)
    )


@Check(
    title="clocks agree",
    scope=MASTER,
    needs=_clock_needs,
    suspects=_clock_suspects,
)
def _judge_clock(context: CheckContext) -> Judgement | None:
    entry = context.observer.masters.get(context.target)
    if entry is None:
        return None
    expected = f"less than {OFF_WARNING} s apart"
    offset = entry.clock_offset_s
    if offset is None:
        return Judgement(FAILED, expected, entry.clock_error or "no answer")
    sure = abs(offset) - (entry.clock_uncertainty_s or 0.0)
    return Judgement(rate_offset(sure), expected, f"{offset:+.4f} s")


# The masters that a discovery node lists


def _has_planned_uri(entry: ListedMaster, context: CheckContext) -> bool:
    """Return True for any name that a sealed roscore may have, since the collection cannot rename it."""
    return is_one_of(entry.uri, context.fleet.master_uris[context.master.robot])


def _has_planned_address(entry: ListedMaster, context: CheckContext) -> bool:
    """A node may see itself through its loopback interface; the others must see it at its planned address."""
    host = host_of(entry.monitoruri)
    own = context.master.robot == context.observer.plan.robot
    return host == context.address or (own and host in ("localhost", "127.0.0.1"))


def _service_call_needs(context: CheckContext) -> Components:
    """List the components that a call of the own discovery node's service needs."""
    one, master = context.observer.name, context.masters[0]
    call = needs.talks(context, one, master, "nodes") if one != master else frozenset()
    return needs.roscore(context, one, master) | make_components("discovery", master, "dead", "hung") | call


def _list_needs(context: CheckContext) -> Components:
    """A master stays in the list for a while, and one of two transports is enough: so little is cleared."""
    own, its = context.masters[0], context.target
    cleared = _service_call_needs(context) | make_components("roscore", its, "name")
    if own == its:
        return cleared
    group = make_components("discovery", own, "group") | make_components("discovery", its, "group")
    return (
        cleared | group | needs.translation_components(context, its, own)
    )  # the address of its heartbeats is in the list


def _list_suspects(context: CheckContext) -> Components:
    if not context.observer.listed:
        return _service_call_needs(context)
    own, its = context.masters[0], context.target
    others = needs.master_query_components(context, own, its) | needs.heartbeats(context, own, its)
    return _service_call_needs(context) | needs.discovery(own) | others


@Check(
    title="rosservice call /master_discovery/list_masters",
    scope=MASTER_TOO,
    when=lambda context: context.observer.is_probed and not context.observer.lacks_ros,
    needs=_list_needs,
    suspects=_list_suspects,
)
def _judge_list_masters(context: CheckContext) -> Judgement:
    master = context.master
    entry = context.observer.listed.get(master.name)
    expected = f"{master.name} online, {master.uri}, monitored at {master.monitor_uri}"
    if entry is None:
        error = context.probe.list_masters.error
        return Judgement(FAILED, expected, error or f"not among {', '.join(sorted(context.observer.listed)) or 'none'}")
    state = "online" if entry.online else "offline"
    found = f"{entry.name} {state}, {entry.uri}, monitored at {entry.monitoruri}"
    if not entry.online:
        return Judgement(FAILED, expected, found)
    if not _has_planned_uri(entry, context):
        return Judgement(FAILED, expected, found, make_components("roscore", context.target, "name", what=entry.uri))
    if _has_planned_address(entry, context):
        return Judgement(OK, expected, found)
    if context.robots[0] == context.robots[1]:  # the node reports the address from which it sends
        return Judgement(FAILED, expected, found, make_components("interface", context.target, "multicast"))
    return Judgement(FAILED, expected, found, _translator(context, context.target))
