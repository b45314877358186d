# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of discovery: datagrams between two computers, and the discovery node of each master."""

from __future__ import annotations

from ipaddress import IPv4Address

from ..._base.features import load_hooks
from ..._base.hosts import host_of
from ..._plan.model import COMMON
from ..context import needs
from ..context.case import Case
from ..context.errors import find_parts, list_refusers
from ..context.needs import Parts, join_parts, make_parts
from ..context.packet_filters import GROUP, ROSCORE
from ..context.policy_routing import taker
from ..observe.observations import DatagramCounts, ListedMaster, TargetRoute
from ..observe.outcomes import Outcome
from ..observe.uris import is_one_of
from .engine import FAILED, MASTER, MASTER_TOO, MEMBER, OK, WARNING, Check, Judgement
from .hooks import CheckHooks

# The share of datagrams that may be lost.
LOSS = 0.05


# Who has joined the group: also of nodes that a person started by hand; their parameters are not known

ALL_HOSTS = "224.0.0.1"  # every kernel has joined it


def _membership_interfaces(case: Case) -> set[str] | None:
    """The interfaces on which a program has joined the group; None where that cannot be known, or is not needed."""
    memberships, own, group = case.observer.multicast.memberships, case.own, str(case.fleet.multicast_group)
    if not memberships or own is None or not own.multicast or group == ALL_HOSTS:
        return None
    runs = case.observer.plan.is_master and bool(case.observer.listed)
    if not runs or case.fleet.transport == "unicast":
        return None
    return {entry.interface for entry in memberships if entry.group == group}


@Check(
    title="discovery has joined the group",
)
def _judge_membership(case: Case) -> Judgement | None:
    interfaces = _membership_interfaces(case)
    planned = case.observer.interface_on.get(COMMON)
    if interfaces is None or planned is None:
        return None
    expected = f"a program has joined {case.fleet.multicast_group} on {planned.interface}"
    found = f"on {' and '.join(sorted(interfaces))}" if interfaces else "on no interface"
    verdict = OK if planned.interface in interfaces else _transport_verdict(case, True)
    kind, mode = ("interface", "multicast") if interfaces else ("discovery", "group")
    return Judgement(verdict, expected, found, make_parts(kind, case.observer.name, mode))


# Datagrams on the group


def _on_group(case: Case) -> DatagramCounts | None:
    """The datagrams between two computers that the group reaches."""
    udp, own, planned = case.udp, case.own, case.planned
    if udp is None or own is None or planned is None or case.fleet.transport == "unicast":
        return None
    if own.robot == planned.robot and udp.other_interfaces:
        return None  # a gateway that passes the group on hears its own robot on the inner interface
    return udp if own.multicast and planned.multicast else None


def _transport_verdict(case: Case, other: bool | None) -> str:
    """With the transport `both`, the discovery nodes find each other as long as one of the two ways works."""
    return WARNING if case.fleet.transport == "both" and other else FAILED


def _group_needs(case: Case) -> Parts:
    one, other = case.observer.name, case.target
    there = make_parts("computer", other, "unmeasured", "login")
    return needs.multicast(case, one, other) | needs.loss_parts(case, one, other) | there


def _group_suspects(case: Case) -> Parts:
    one, other = case.observer.name, case.target
    if case.udp and case.udp.heard_from:
        return needs.loss_parts(case, one, other)
    if case.peer and case.peer.multicast.send_errors.count:  # its own kernel refuses to send
        return make_parts("filter", other, "group out", "group", "udp out", "udp", "all out", "all")
    return _group_needs(case) - needs.loss_parts(case, one, other)


def _translator(case: Case, computer: str) -> Parts:
    """Find what translates the addresses of a computer: its gateway, or the computer itself (a container, a virtual machine)."""
    other = case.observer.name if computer == case.target else case.target
    between = needs.translation_parts(case, computer, other)
    if not between:
        return make_parts("translation", computer, "on")
    first = case.ways.list_forwarders(computer, other)[0]
    return frozenset(part for part in between if part.place == first)


@Check(
    title="datagrams on the multicast group arrive",
    scope=MEMBER,
    carries=GROUP,
    needs=_group_needs,
    suspects=_group_suspects,
)
def _judge_udp_multicast(case: Case) -> Judgement | None:
    udp = _on_group(case)
    if udp is None:
        return None
    address = case.ways.discovery_addresses[case.target]
    loss = (case.back_udp.loss if case.back_udp else None) or 0.0  # the sender knows how many it has sent
    expected = f"datagrams on {case.ways.group} from {address}"
    elsewhere = make_parts("interface", case.observer.name, "multicast") if udp.other_interfaces else frozenset()
    if not udp.heard_from:
        found = f"none, but on {', '.join(udp.other_interfaces)}" if udp.other_interfaces else "none"
        return Judgement(_transport_verdict(case, udp.unicast), expected, found, elsewhere)
    if udp.source_address != address:
        return Judgement(FAILED, expected, f"from {udp.source_address}", _translator(case, case.target))
    if loss > LOSS:
        return Judgement(WARNING, expected, f"{loss:.0%} of them are lost", elsewhere)
    return Judgement(OK, expected, f"{udp.heard} datagrams")


# Datagrams to the computer


def _is_translated(case: Case) -> bool:
    """The target's helper has heard this computer, from an address that is not the planned one."""
    theirs = case.back_udp.source_address if case.back_udp else None
    seen = (case.udp.own_source_address if case.udp else None) or theirs
    return seen is not None and seen != case.ways.discovery_addresses.get(case.observer.name)


def _unicast_needs(case: Case) -> Parts:
    one, other = case.observer.name, case.target
    there = needs.passes(one, other, "udp") | make_parts("computer", other, "unmeasured", "login")
    nobody_asks = needs.neighbours(case, other, one) - needs.neighbours(case, one, other)  # a datagram gets no answer
    return needs.way(case, one, other) - nobody_asks | there | _outside(case)


@Check(
    title="datagrams to the computer arrive",
    scope=MEMBER,
    carries="udp",
    needs=_unicast_needs,
    suspects=lambda case: (
        _unicast_needs(case)
        | needs.active_translations(case, case.observer.name, case.target)
        | needs.active_translations(case, case.target, case.observer.name)
        | needs.passes(case.target, case.observer.name, "udp")  # the counts come back by the same port
    ),
)
def _judge_udp_unicast(case: Case) -> Judgement | None:
    if case.udp is None:
        return None
    expected = f"datagrams to port {case.fleet.multicast_port} arrive there"
    if case.udp.unicast:
        return Judgement(OK, expected, "they arrive")
    if case.fleet.transport == "multicast":
        return None  # no computer needs them
    found = "no answer" if case.udp.unicast is None else "none arrives"
    broken = _translator(case, case.observer.name) if _is_translated(case) else frozenset()
    return Judgement(_transport_verdict(case, case.udp.heard_from), expected, found, broken)


# The source address of datagrams


@Check(
    title="datagrams arrive from the planned address",
    scope=MEMBER,
    needs=lambda case: _unicast_needs(case) | needs.translation_parts(case, case.observer.name, case.target),
    # Whatever drops the questions of ARP may drop the answers, too.
    suspects=lambda case: (
        _unicast_needs(case)
        | needs.neighbours(case, case.target, case.observer.name)
        | needs.active_translations(case, case.observer.name, case.target)
    ),
)
def _judge_source(case: Case) -> Judgement | None:
    """Judge if a gateway between networks translates addresses: the helper on the target counts who called."""
    if not case.observer.is_probed or case.peer is None or not case.peer.multicast.udp:
        return None
    source = case.way.source
    arrived = source in case.peer.callers
    if not case.way.crosses and not arrived:
        return None  # in one network no gateway translates; what arrives clears the packet filters there
    expected = f"datagrams from {source} arrive there"
    return Judgement(OK if arrived else WARNING, expected, "they arrive" if arrived else "none arrives")


# Pings of the group


def _rounds_suspects(case: Case) -> Parts:
    one, other = case.observer.name, case.target
    lost = needs.loss_parts(case, one, other)
    if any(other in answered for _number, answered in case.observer.rounds):
        return lost  # a packet was lost: no filter drops them
    there = needs.multicast(case, other, one) | needs.way(case, one, other) | needs.passes(one, other, "icmp")
    return lost | there | make_parts("setting", other, "icmp_group")


@Check(
    title="ping of the multicast group (informs only)",
    scope=MEMBER,
    needs=lambda case: make_parts("setting", case.target, "icmp_group"),
    suspects=_rounds_suspects,
)
def _judge_icmp_rounds(case: Case) -> Judgement | None:
    icmp = case.observer.multicast.icmp
    if icmp is None or case.peer is None or not case.peer.answers_broadcasts or case.observer.plan.carrier:
        return None  # by plan it does not answer: the kernel's default, and no harm
    if not (case.observer.plan.common_address and case.peer.plan.common_address):
        return None  # such a ping stays on the common network
    missed = [number for number, answered in case.observer.rounds if case.target not in answered]
    expected = f"an answer to each of {len(icmp.rounds)} pings of {icmp.group}"
    if icmp.error or missed:
        return Judgement(WARNING, expected, icmp.error or f"none in the rounds {', '.join(map(str, missed))}")
    return Judgement(OK, expected, "all")


# The port of a discovery node


def _connect_outcome(case: Case) -> Outcome:
    entry = case.observer.masters.get(case.target)
    return entry.outcome if entry else Outcome.NOT_TRIED


def _outside(case: Case) -> Parts:
    """A computer's own gateway is asked at its other side, where its discovery node is."""
    own, planned = case.own, case.planned
    if own is None or planned is None or own.robot != planned.robot or own.name == planned.name:
        return frozenset()
    return frozenset() if planned.discovery_address in own.network else needs.route_parts(own.name, COMMON)


def _port_needs(case: Case) -> Parts:
    one, other = case.observer.name, case.target
    node = make_parts("discovery", other, "dead", "port")
    return needs.way(case, one, other) | needs.passes(one, other, "rpc") | node | _outside(case)


def _port_suspects(case: Case) -> Parts:
    """A computer that is silent would refuse if no program listened on the port."""
    # One for all interfaces also drops what a computer sends itself.
    filtered = make_parts("filter", case.target, "rpc in", "rpc", "all in", "all")
    nobody = make_parts("discovery", case.target, "dead", "port")
    return _port_needs(case) - nobody | make_parts("discovery", case.target, "hung") | filtered


def _find_port_fault(case: Case) -> Parts:
    outcome = _connect_outcome(case)
    if outcome == Outcome.NETWORK_UNREACHABLE and _outside(case):  # no ping was sent to that address
        return make_parts("route", case.observer.name, "missing", what=COMMON)
    if outcome == Outcome.REFUSED and case.target == case.observer.name:  # its node has ended, or listens elsewhere
        runs = bool(case.probe.list_masters.masters)
        return make_parts("discovery", case.target, "port" if runs else "dead")
    return frozenset()


@Check(
    title="port of the discovery node opens",
    scope=MASTER_TOO,
    carries="rpc",
    needs=_port_needs,
    suspects=_port_suspects,
)
def _judge_rpc_port(case: Case) -> Judgement | None:
    entry = case.observer.masters.get(case.target)
    if entry is None:
        return None
    expected = f"TCP port {entry.port} of {case.address} opens"
    if entry.open:
        return Judgement(OK, expected, f"{entry.connect_ms} ms")
    return Judgement(FAILED, expected, entry.error, _find_port_fault(case), entry.outcome)


# The route to a discovery node


def _hops(case: Case, address: IPv4Address) -> frozenset[str]:
    """The next hops that packets to the address of a discovery node may have; an empty text is none."""
    plan = case.observer.plan
    if any(address in entry.network for entry in plan.networks):
        return frozenset([""])
    gateway = case.ways.find_gateway(plan.computer)
    return frozenset([str(gateway.address)]) if gateway else case.way.hops


def _judge_route(case: Case, route: TargetRoute | None, address: IPv4Address) -> Judgement | None:
    if route is None:
        return None
    by, hops = route.gateway or "", _hops(case, address)
    expected = " or ".join(f"a route by {hop}" if hop else "a route without a gateway" for hop in sorted(hops))
    if not route.error and by in hops:
        return Judgement(OK, expected, f"by {by}" if by else "without a gateway")
    found = route.error or (f"by {by}" if by else "without a gateway")
    return Judgement(FAILED, expected, found, _find_route_fault(case, route, address))


def _find_route_fault(case: Case, route: TargetRoute, address: IPv4Address) -> Parts:
    mode, what = taker(case.probe.policy, str(address))
    if mode:
        return make_parts("route", case.observer.name, mode, what=what)
    if _hops(case, address) == {""}:
        return frozenset()  # on one network: the checks of addresses and routes tell it
    return make_parts("route", case.observer.name, "missing" if route.error else "other", what=_beyond(case, address))


def _beyond(case: Case, address: IPv4Address) -> str:
    """The network of the address of a discovery node, as seen from the observer."""
    return COMMON if address in case.fleet.common_network else case.ways.network(case.robots[1])


def _route_suspects(case: Case) -> Parts:
    """List what makes another route than the planned ones come first."""
    name = case.observer.name
    return make_parts("interface", name, "prefix", "address") | needs.by_passes(name)


@Check(
    title="route to the discovery node",
    scope=MASTER,
    needs=lambda case: make_parts(
        "route", case.observer.name, "missing", "other", what=_beyond(case, case.master.address)
    ),
    suspects=_route_suspects,
)
def _judge_master_route(case: Case) -> Judgement | None:
    entry = case.observer.masters.get(case.target)
    return _judge_route(case, entry.route, case.master.address) if entry and case.target != case.observer.name else None


# The same for the other address of a gateway, which is no master: its datagrams are measured there


def _outer(case: Case) -> IPv4Address:
    return case.planned.discovery_address if case.planned else case.fleet.common_network.network_address


@Check(
    title="route to the other address of a gateway",
    scope=MEMBER,
    needs=lambda case: make_parts("route", case.observer.name, "missing", "other", what=_beyond(case, _outer(case))),
    suspects=_route_suspects,
)
def _judge_outer_route(case: Case) -> Judgement | None:
    return _judge_route(case, case.member.discovery_route, _outer(case))


# The port of a roscore, seen from others: no other computer needs it, but it tells a roscore that has ended


@Check(
    title="port of the roscore is not refused",
    scope=MASTER,
    needs=lambda case: make_parts("roscore", case.target, "dead"),
    suspects=lambda case: list_refusers(case, case.target, ROSCORE),
)
def _judge_roscore_port(case: Case) -> Judgement | None:
    entry = case.observer.masters.get(case.target)
    if entry is None or entry.roscore_outcome == Outcome.NOT_TRIED:
        return None
    expected = "the TCP port of the roscore opens"
    if entry.roscore_outcome == Outcome.OPEN:
        return Judgement(OK, expected, "it opens")
    if entry.roscore_outcome != Outcome.REFUSED:
        return None  # no other computer needs it, so a packet filter may drop it
    answers = case.peer is not None and bool(case.peer.probe.roscore.answer)  # there, so something else refuses
    dead = frozenset() if answers else make_parts("roscore", case.target, "dead")
    return Judgement(WARNING, expected, entry.roscore, dead)


# Clocks

# Seconds that a clock may differ from its source: tf extrapolates and messages are dropped from some tenths on.
OFF_WARNING, OFF_FAILED = 0.1, 0.5


def rate_offset(seconds: float) -> str:
    """Return the verdict of a clock that is off by so much."""
    return OK if seconds < OFF_WARNING else WARNING if seconds < OFF_FAILED else FAILED


def _clock_needs(case: Case) -> Parts:
    clocks = join_parts(make_parts("clock", name, "off") for name in (case.observer.name, case.target))
    return _port_needs(case) | make_parts("discovery", case.target, "hung") | clocks


def _has_time_source(case: Case, computer: str) -> bool:
    """Something keeps the clock of a computer right, as chrony does."""
    return computer in case.run and case.run[computer].probe.clock.synchronised is True


def _list_clock_parts(case: Case, computer: str) -> Parts:
    """List what keeps the clock of a computer right by the plan."""
    return join_parts(hooks.list_clock_parts(case, computer) for hooks in load_hooks("checks", CheckHooks).values())


def _clock_suspects(case: Case) -> Parts:
    entry = case.observer.masters.get(case.target)
    if entry is not None and entry.clock_offset_s is not None:
        free = [name for name in (case.observer.name, case.target) if not _has_time_source(case, name)]
        suspects = free or [case.observer.name, case.target]
        return join_parts(make_parts("clock", name, "off") | _list_clock_parts(case, name) for name in suspects)
    if entry is not None and entry.open:
        # A discovery node closes the connection of who calls from no address of the plan.
        stranger = make_parts("interface", case.observer.name, "address")
        return (
            make_parts("discovery", case.target, "hung") | needs.large(case, case.observer.name, case.target) | stranger
        )
    return _find_port_fault(case) or find_parts(case, _connect_outcome(case), "rpc") or _port_suspects(case)


@Check(
    title="clocks agree",
    scope=MASTER,
    needs=_clock_needs,
    suspects=_clock_suspects,
)
def _judge_clock(case: Case) -> Judgement | None:
    entry = case.observer.masters.get(case.target)
    if entry is None:
        return None
    expected = f"less than {OFF_WARNING} s apart"
    offset = entry.clock_offset_s
    if offset is None:
        return Judgement(FAILED, expected, entry.clock_error or "no answer")
    sure = abs(offset) - (entry.clock_uncertainty_s or 0.0)
    return Judgement(rate_offset(sure), expected, f"{offset:+.4f} s")


# The masters that a discovery node lists


def _has_planned_uri(entry: ListedMaster, case: Case) -> bool:
    """Nobody here can rename a sealed roscore: it may have any of its names."""
    return is_one_of(entry.uri, case.fleet.master_uris[case.master.robot])


def _has_planned_address(entry: ListedMaster, case: Case) -> bool:
    """A node may see itself through its loopback interface; the others must see it at its planned address."""
    host = host_of(entry.monitoruri)
    own = case.master.robot == case.observer.plan.robot
    return host == case.address or (own and host in ("localhost", "127.0.0.1"))


def _service_call_needs(case: Case) -> Parts:
    """List what calling the service of the own discovery node needs."""
    one, master = case.observer.name, case.masters[0]
    call = needs.talks(case, one, master, "nodes") if one != master else frozenset()
    return needs.roscore(case, one, master) | make_parts("discovery", master, "dead", "hung") | call


def _list_needs(case: Case) -> Parts:
    """A master stays in the list for a while, and one of two transports is enough: so little is cleared."""
    own, its = case.masters[0], case.target
    cleared = _service_call_needs(case) | make_parts("roscore", its, "name")
    if own == its:
        return cleared
    group = make_parts("discovery", own, "group") | make_parts("discovery", its, "group")
    return cleared | group | needs.translation_parts(case, its, own)  # the address of its heartbeats is in the list


def _list_suspects(case: Case) -> Parts:
    if not case.observer.listed:
        return _service_call_needs(case)
    own, its = case.masters[0], case.target
    others = needs.master_query_parts(case, own, its) | needs.heartbeats(case, own, its)
    return _service_call_needs(case) | needs.discovery(own) | others


@Check(
    title="rosservice call /master_discovery/list_masters",
    scope=MASTER_TOO,
    when=lambda case: case.observer.is_probed and not case.observer.lacks_ros,
    needs=_list_needs,
    suspects=_list_suspects,
)
def _judge_list_masters(case: Case) -> Judgement:
    master = case.master
    entry = case.observer.listed.get(master.name)
    expected = f"{master.name} online, {master.uri}, monitored at {master.monitor_uri}"
    if entry is None:
        error = case.probe.list_masters.error
        return Judgement(FAILED, expected, error or f"not among {', '.join(sorted(case.observer.listed)) or 'none'}")
    state = "online" if entry.online else "offline"
    found = f"{entry.name} {state}, {entry.uri}, monitored at {entry.monitoruri}"
    if not entry.online:
        return Judgement(FAILED, expected, found)
    if not _has_planned_uri(entry, case):
        return Judgement(FAILED, expected, found, make_parts("roscore", case.target, "name", what=entry.uri))
    if _has_planned_address(entry, case):
        return Judgement(OK, expected, found)
    if case.robots[0] == case.robots[1]:  # the node tells the address from which it sends
        return Judgement(FAILED, expected, found, make_parts("interface", case.target, "multicast"))
    return Judgement(FAILED, expected, found, _translator(case, case.target))
