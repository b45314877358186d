# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of one computer by itself: reachable, services, environment, kernel settings, roscore, default routes."""

from __future__ import annotations

from ..._plan.model import COMMON
from ..context import needs
from ..context.actual_world import DOWN
from ..context.check_context import CheckContext
from ..context.needs import Components, join_components, make_components, make_service_component
from ..context.packet_filters import ROSCORE
from ..observe.observations import DefaultRoute, ForwardingInterface, ServiceState
from ..observe.outcomes import Outcome
from ..observe.uris import is_one_of, is_same_uri
from .engine import FAILED, OK, UNKNOWN, WARNING, Check, Judgement, judge_fault

# The kernel of gateways and of the router


def _interfaces(context: CheckContext) -> list[ForwardingInterface]:
    """List the observer's interfaces on the networks of the plan."""
    planned = {str(entry.address) for entry in context.observer.plan.networks}
    return [entry for entry in context.observer.interfaces if planned & set(entry.addresses)]


@Check(
    title="gateways and the router pass packets on",
    when=lambda context: context.observer.is_probed and context.observer.plan.forwards,
    needs=lambda context: make_components("forwarding", context.observer.name, "off"),
)
def _judge_forwarding(context: CheckContext) -> Judgement:
    ip_forward, name = context.probe.forwarding.ip_forward, context.observer.name
    expected = "net.ipv4.ip_forward is 1"
    if ip_forward is None:
        unread = make_components("setting", name, "unread", what="net.ipv4.ip_forward")
        return Judgement(UNKNOWN, expected, "it cannot be read", unread)
    closed = [entry.interface for entry in _interfaces(context) if entry.forwarding == 0]
    found = f"1, but net.ipv4.conf.{closed[0]}.forwarding is 0" if ip_forward and closed else str(ip_forward)
    good = ip_forward and not closed
    return Judgement(OK if good else FAILED, expected, found, make_components("forwarding", name, "off"))


# Reachable


def _reachable_needs(context: CheckContext) -> Components:
    return make_components("computer", context.observer.name, "off", "login")


def _reachable_suspects(context: CheckContext) -> Components:
    """List the suspects on both ways to the controller, which may be in the robot's network, or beyond its gateway."""
    name, plan = context.observer.name, context.observer.plan
    components = _reachable_needs(context) | make_components("interface", name, "address", "prefix")
    for network in [context.ways.network(plan.robot)] + ([COMMON] if plan.common_address else []):
        components |= make_components("link", name, "down", what=network) | make_components("network", network, "dead")
    if gateway := context.ways.find_gateway(name):
        components |= make_components("computer", gateway.title, "off") | make_components(
            "forwarding", gateway.title, "off"
        )
        components |= make_components("filter", gateway.title, "forward") | make_components(
            "route", name, "missing", "other"
        )
        components |= make_components("link", gateway.title, "down", what=context.ways.network(plan.robot))
    return components


@Check(
    title="computer answers the controller",
    needs=_reachable_needs,
    suspects=_reachable_suspects,
)
def _judge_reachable(context: CheckContext) -> Judgement:
    if context.observer.seen.unreachable:
        return Judgement(FAILED, "an answer to the controller", context.observer.seen.problem or "no answer")
    return Judgement(OK, "an answer to the controller", "an answer")


# Services


def _has_services(context: CheckContext) -> bool:
    return context.observer.is_probed and bool(context.observer.plan.all_services)


def _is_full(entry: ServiceState) -> bool:
    """Return True if the process of a service may open one more file at most: it takes no connection, although its kernel does (accept(2), EMFILE)."""
    return entry.open_files is not None and entry.most_files is not None and entry.most_files - entry.open_files <= 1


def _find_pid(context: CheckContext, entry: ServiceState) -> str:
    """Name the process of a service that may open no file more, as far as it was seen."""
    return next((f" (PID {one.pid})" for one in context.probe.full_processes if one.unit == entry.unit), "")


def _was_started_again(context: CheckContext, entry: ServiceState) -> bool:
    """Return True if systemd has started it again lately: starts from before the last verification are not reported again."""
    return bool(entry.restarts) and entry.age_s is not None and 0 <= entry.age_s <= context.state.lately


#: the Result of systemd -> who ended a service, and why
_ENDS = {
    "success": "it was stopped, or ended by itself without an error",
    "watchdog": "the watchdog ended it, since it hung (Result=watchdog)",
    "oom-kill": "the kernel ended it, since memory ran out (Result=oom-kill)",
    "signal": "the signal {status} ended it, which systemd had not sent (Result=signal)",
    "core-dump": "it crashed with the signal {status} (Result=core-dump)",
    "exit-code": "it ended by itself with the status {status} (Result=exit-code)",
    "timeout": "systemd ended it, since its start or its end took too long (Result=timeout)",
    "start-limit-hit": "systemd starts it no more, since it ended too often (Result=start-limit-hit)",
}


def _describe_end(entry: ServiceState) -> str:
    """Say who ended a service last, and why; nothing if that is not known."""
    text = _ENDS.get(entry.result, "").format(status="?" if entry.status is None else entry.status)
    return f": {text}" if text else ""


def _describe_state(entry: ServiceState) -> str:
    state = "not there" if entry.load_state == "not-found" else f"{entry.active_state} ({entry.sub_state})"
    return state + _describe_end(entry)


def _inactive_components(context: CheckContext, service: str, entry: ServiceState | None) -> Components:
    name, unit = context.observer.name, f"multimaster-{service}.service"
    if entry is not None and entry.load_state == "not-found":
        return make_components("service", name, "missing", what=unit)
    if entry is not None and entry.active_state == "activating" and entry.restarts:
        return make_components("service", name, "looping", what=unit)
    if service == "roscore" and context.probe.roscore.answer:
        return make_components("set_up", name, "others")  # the roscore that answers is another one than the unit's
    return _service_down_components(name, service)


def _service_down_components(computer: str, service: str) -> Components:
    if service in ("roscore", "discovery", "sync"):
        return make_components(service, computer, "dead")
    down = make_components("service", computer, "down", what=f"multimaster-{service}.service")
    return make_service_component(computer, service) or down


@Check(
    title="services are active",
    when=_has_services,
    of_site=True,
    needs=lambda context: join_components(
        _service_down_components(context.observer.name, service) for service in context.observer.plan.all_services
    ),
)
def _judge_services(context: CheckContext) -> Judgement:
    states = {entry.name: entry for entry in context.probe.services}
    if not states:
        unasked = make_components("computer", context.observer.name, "unmeasured")
        return Judgement(UNKNOWN, "the state of the services", "systemd did not report it", unasked)
    components: Components = frozenset()
    broken, restarted = [], []
    for name in context.observer.plan.all_services:
        entry, unit = states.get(name), f"multimaster-{name}.service"
        if entry is None or entry.active_state != "active":
            broken.append(f"{unit} is {'unknown' if entry is None else _describe_state(entry)}")
            components |= _inactive_components(context, name, entry)
        elif entry.stopped:
            broken.append(f"the process of {entry.unit} is stopped")
            components |= make_components("service", context.observer.name, "stopped", what=unit)
        elif _is_full(entry):
            broken.append(
                f"{entry.unit}{_find_pid(context, entry)} has {entry.open_files} of {entry.most_files} files open"
            )
            components |= make_components("service", context.observer.name, "full", what=unit)
        elif _was_started_again(context, entry):
            restarted.append(
                f"{entry.unit} was started again {entry.age_s:.0f} s ago, {entry.restarts} in all{_describe_end(entry)}"
            )
            components |= make_components("service", context.observer.name, "restarting", what=unit)
    expected = f"{', '.join(context.observer.plan.all_services)} active"
    if broken:
        return Judgement(FAILED, expected, ", ".join(broken), components)
    return judge_fault(WARNING, f"{expected}, not started again", ", ".join(restarted), "all active", components)


@Check(
    title="services run with the planned environment",
    when=_has_services,
    of_site=True,
    needs=lambda context: make_components("environment", context.observer.name, "service"),
)
def _judge_environment(context: CheckContext) -> Judgement | None:
    running = [entry for entry in context.probe.services if entry.active_state == "active"]
    if not running:
        return None
    expected = "the planned environment in every service"
    differing = [f"{', '.join(entry.differing)} of {entry.unit}" for entry in running if entry.differing]
    closed = [entry.unit for entry in running if entry.differing is None]
    if closed and not differing:
        unread = make_components("setting", context.observer.name, "unread", what="the environment of a service")
        return Judgement(UNKNOWN, expected, f"the process of {', '.join(closed)} cannot be looked at", unread)
    names = ", ".join(sorted({name for entry in running for name in entry.differing or ()}))
    components = make_components("environment", context.observer.name, "service", what=names)
    return judge_fault(FAILED, expected, "; ".join(differing), "the same", components)


# Measured


@Check(
    title="computer could be looked at",
    when=lambda context: not context.observer.seen.unreachable,
    needs=lambda context: make_components("computer", context.observer.name, "unmeasured"),
)
def _judge_measured(context: CheckContext) -> Judgement:
    seen = context.observer.seen
    problems = list(seen.probe.problems) if seen.probe is not None else []
    first = (seen.problem or next(iter(problems), "")).rstrip(".")
    measures_udp = context.own is not None and context.own.discovery
    if seen.probe is None or (seen.multicast is None and measures_udp) or seen.problem:
        problems.insert(0, seen.problem or "a measurement gave no result")
    expected, good = (
        ("results of both measurements", "both") if measures_udp else ("a result of the measurement", "one")
    )
    components = make_components("computer", context.observer.name, "unmeasured", what=first)
    return Judgement(FAILED if problems else OK, expected, " ".join(problems).rstrip(".") or good, components)


# Addresses


def _find_missing_addresses(context: CheckContext) -> list[str]:
    present = {address for entry in context.observer.interfaces for address in entry.addresses}
    return [str(entry.address) for entry in context.observer.plan.networks if str(entry.address) not in present]


def _find_down_links(context: CheckContext) -> list[str]:
    networks = context.observer.interface_on.items()
    return [network for network, interface in networks if interface.state in DOWN]


def _find_dead_link(context: CheckContext, network: str) -> Components:
    """Blame the network if no computer on it has a link. A single observed computer is not enough."""
    states = [one.interface_on[network].state for one in context.run.values() if network in one.interface_on]
    if len(states) < 2:
        return frozenset()
    if all(state in DOWN for state in states):
        return make_components("network", network, "dead")
    return make_components(
        "link", context.observer.name, "flapping" if _is_flapping(context, network) else "down", what=network
    )


def _is_flapping(context: CheckContext, network: str) -> bool:
    """Return True if a link that is down now has carried answers in the same run, to others on its network."""
    name = context.observer.name
    near = (one for one in context.run.values() if one.name != name and network in one.interface_on)
    return any(name in one.answered for one in near)


def _addresses_suspects(context: CheckContext) -> Components:
    down = _find_down_links(context)
    links = join_components(make_components("link", context.observer.name, "down", what=network) for network in down)
    return links | join_components(make_components("network", network, "dead") for network in down)


def _addresses_needs(context: CheckContext) -> Components:
    """A link is cleared only if its state was read as up."""
    networks = context.observer.interface_on.items()
    up = join_components(
        make_components("link", context.observer.name, "down", what=network)
        for network, seen in networks
        if seen.state == "up"
    )
    return make_components("interface", context.observer.name, "address", "prefix") | up


@Check(
    title="interfaces have the planned addresses",
    when=lambda context: bool(context.observer.interfaces),
    needs=_addresses_needs,
    suspects=_addresses_suspects,
)
def _judge_addresses(context: CheckContext) -> Judgement:
    expected = ", ".join(f"{entry.address}/{entry.network.prefixlen}" for entry in context.observer.plan.networks)
    missing, down, sizes = (
        _find_missing_addresses(context),
        _find_down_links(context),
        context.observer.find_wrong_prefixes(),
    )
    problems = [f"no interface has {address}" for address in missing]
    on_ports = context.observer.list_ports()
    ports = [f"{address} is on {port.interface}, a port of {port.port_of}" for address, port in on_ports]
    problems += [*ports, *(f"the link to {network} is down" for network in down)]
    problems += [f"{address}/{size}" for _name, address, size, _planned in sizes]
    modes = [mode for mode, wrong in (("address", missing), ("port", ports), ("prefix", sizes)) if wrong]
    components = make_components("interface", context.observer.name, *modes) | join_components(
        _find_dead_link(context, one) for one in down
    )
    # If it does harm, other checks fail. A single robot works without any network.
    return judge_fault(WARNING, expected, ", ".join(problems), "all of them", components)


@Check(
    title="interfaces have the MTU of the others",
    when=lambda context: bool(context.observer.mtus),
    needs=lambda context: join_components(
        make_components("interface", context.observer.name, "mtu", what=network) for network in context.observer.mtus
    ),
)
def _judge_mtu(context: CheckContext) -> Judgement:
    usual = context.state.usual
    odd = {network: mtu for network, mtu in context.observer.mtus.items() if mtu != usual[network]}
    found = "; ".join(f"{mtu} on {network}, but most have {usual[network]}" for network, mtu in odd.items())
    components = join_components(
        make_components("interface", context.observer.name, "mtu", what=network) for network in odd
    )
    return judge_fault(WARNING, "the MTU of the others", found, "the same", components)


# More of the kernel


@Check(
    title="no strict reverse-path filter",
    when=lambda context: context.observer.is_probed and context.observer.plan.forwards,
    needs=lambda context: make_components("reverse_path", context.observer.name, "strict"),
)
def _judge_reverse_path(context: CheckContext) -> Judgement:
    strict = [entry.interface for entry in _interfaces(context) if entry.rp_filter == 1]
    found = f"a strict one on {', '.join(strict)}" if strict else ""
    components = make_components("reverse_path", context.observer.name, "strict")
    return judge_fault(WARNING, "a loose reverse-path filter, or none", found, "no strict one", components)


@Check(
    title="router sends no redirects",
    when=lambda context: context.observer.is_probed and context.observer.plan.is_router,
)
def _judge_redirects(context: CheckContext) -> Judgement:
    sending = [entry.interface for entry in _interfaces(context) if entry.send_redirects]
    found = f"they are sent on {', '.join(sending)}" if sending else ""
    return judge_fault(
        WARNING, "no ICMP redirects", found, "none", make_components("redirects", context.observer.name, "sent")
    )


@Check(
    title="kernel answers pings",
    needs=lambda context: make_components("setting", context.observer.name, "icmp_all"),
)
def _judge_answers_pings(context: CheckContext) -> Judgement | None:
    ignored = context.probe.forwarding.icmp_echo_ignore_all
    if ignored is None:
        return None
    expected, components = (
        "net.ipv4.icmp_echo_ignore_all is 0",
        make_components("setting", context.observer.name, "icmp_all"),
    )
    return Judgement(WARNING if ignored else OK, expected, str(ignored), components)


# Sealed computers: people cannot log in there


def _list_sealed(context: CheckContext) -> list[str]:
    """List the sealed computers of the observer's robot, if the observer runs the nodes of that robot."""
    plan = context.observer.plan
    if not plan.is_master:
        return []
    return [name for name, other in context.fleet.computers.items() if other.sealed and other.robot == plan.robot]


@Check(
    title="sealed computer could be looked at",
)
def _judge_sealed(context: CheckContext) -> Judgement | None:
    names = _list_sealed(context)
    if not names:
        return None
    components = join_components(make_components("computer", name, "sealed") for name in names)
    return Judgement(UNKNOWN, "the values that only a login shows", f"nobody logs in on {', '.join(names)}", components)


# The robot's roscore


def _roscore_suspects(context: CheckContext) -> Components:
    name, master = context.observer.name, context.masters[0]
    return needs.roscore(context, name, master) - make_components("roscore", master, "dead")


def _find_own_filter(context: CheckContext) -> Components:
    """Find the packet filter that keeps a computer from its own roscore: no connection waits there, and none opens."""
    roscore = context.probe.roscore
    if roscore.tcp_outcome != Outcome.NO_ANSWER or roscore.waiting != 0 or context.masters[0] != context.observer.name:
        return frozenset()
    return make_components("filter", context.observer.name, "roscore in")


@Check(
    title="ROS_MASTER_URI means the robot's roscore",
    when=lambda context: context.observer.is_probed and not context.observer.lacks_ros,
    carries=ROSCORE,
    needs=lambda context: needs.roscore(context, context.observer.name, context.masters[0]),
    suspects=_roscore_suspects,
)
def _judge_master_uri(context: CheckContext) -> Judgement:
    expected = context.fleet.master_of[context.observer.plan.robot].uri
    named = context.fleet.master_uris[context.observer.plan.robot]  # a sealed roscore may have any of its names
    roscore = context.probe.roscore
    is_asked = is_same_uri(roscore.uri, expected)
    shell = make_components("environment", context.observer.name, "shell", what=f"ROS_MASTER_URI is {roscore.uri}")
    broken = shell if roscore.uri and not is_asked else frozenset()
    if roscore.error:
        return Judgement(FAILED, expected, roscore.error, broken or _find_own_filter(context), roscore.outcome)
    good = is_one_of(roscore.answer, named) and is_asked
    found = (
        roscore.answer
        if is_same_uri(roscore.answer, roscore.uri)
        else f"ROS_MASTER_URI {roscore.uri}, and the roscore calls itself {roscore.answer}"
    )
    broken = broken or make_components("roscore", context.masters[0], "name", what=roscore.answer)
    return Judgement(OK if good else FAILED, expected, found, broken, roscore.outcome)


# Names

ASK_OTHERS = ("dns", "mdns", "nis", "ldap", "wins")  # the beginnings of sources that ask a server in the network


@Check(
    title="/etc/hosts is asked for names first",
    needs=lambda context: make_components("names", context.observer.name, "order"),
)
def _judge_name_order(context: CheckContext) -> Judgement | None:
    sources = context.probe.name_sources
    if not sources:
        return None
    before = sources[: sources.index("files")] if "files" in sources else sources
    first = not any(source.startswith(ASK_OTHERS) for source in before) and {"files", "resolve"} & set(sources)
    components = make_components("names", context.observer.name, "order")
    return Judgement(OK if first else WARNING, "files before dns", " ".join(sources), components)


# Default routes


def _describe_route(route: DefaultRoute) -> str:
    metric = f" with the metric {route.metric}" if route.metric else ""
    return f"{route.gateway or 'no gateway'} on {route.device}{metric}"


@Check(
    title="one default route at most",
    when=lambda context: context.observer.is_probed,
    needs=lambda context: make_components("route", context.observer.name, "defaults"),
)
def _judge_default_routes(context: CheckContext) -> Judgement:
    routes = context.probe.default_routes
    found = ", ".join(map(_describe_route, routes)) or "none"
    components = make_components("route", context.observer.name, "defaults")
    return Judgement(OK if len(routes) <= 1 else WARNING, "one default route at most", found, components)


# The packet filter


@Check(
    title="the packet filter is as planned",
    when=lambda context: context.observer.seen.packet_filter is not None,
    of_site=True,
    needs=lambda context: make_components("filter", context.observer.name, "changed"),
)
def _judge_packet_filter(context: CheckContext) -> Judgement | None:
    found = context.observer.seen.packet_filter
    if found is None:
        return None
    expected = (
        "the packet filter of the plan" if context.observer.plan.firewall else "no packet filter of the collection"
    )
    components = make_components("filter", context.observer.name, "changed")
    return Judgement(FAILED if found.changed or found.failed else OK, expected, found.msg, components)
