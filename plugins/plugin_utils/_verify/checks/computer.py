# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of one computer by itself: reachable, services, environment, kernel settings, roscore, default routes."""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import ComputerPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.case import Case
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.by_hand import BY_HAND, of_site_yml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import (
    COMPUTER,
    FAILED,
    OK,
    UNKNOWN,
    WARNING,
    Cause,
    Check,
    Documented,
    Judgement,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import (
    DefaultRoute,
    ForwardingInterface,
    Probe,
    Service,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.uris import on_loopback, same_uri

# The kernel of gateways and of the router


def _passes_packets_on(case: Case) -> bool:
    return case.observer.plan.is_gateway or case.observer.plan.is_router


def _interfaces(probe: Probe, plan: ComputerPlan) -> list[ForwardingInterface]:
    """List the observer's interfaces on the networks of the plan."""
    planned = {str(entry.address) for entry in plan.networks}
    return [entry for entry in probe.forwarding.interfaces if planned & set(entry.addresses)]


def _forwarding(case: Case) -> Judgement | None:
    if case.probe is None or not _passes_packets_on(case):
        return None
    ip_forward = case.probe.forwarding.ip_forward
    expected = "net.ipv4.ip_forward is 1"
    if ip_forward is None:
        return Judgement(UNKNOWN, expected, "it cannot be read")
    closed = [entry.interface for entry in _interfaces(case.probe, case.observer.plan) if entry.forwarding == 0]
    if ip_forward == 0 or not closed:
        return Judgement(OK if ip_forward else FAILED, expected, str(ip_forward))
    return Judgement(FAILED, expected, f"1, but net.ipv4.conf.{closed[0]}.forwarding is 0")


FORWARDING = Check(
    id="forwarding",
    title="gateways and the router pass packets on",
    scope=COMPUTER,
    judge=_forwarding,
    documented=Documented("gateways, router", "`net.ipv4.ip_forward` is 1, also on the interfaces of the plan", "4.2"),
    causes=(
        Cause(
            "{observer} drops what is meant for another network, so nobody gets through it",
            "run site.yml; if the value comes back, see on {observer}: grep -r ip_forward /etc/sysctl.* /usr/lib/sysctl.d",
        ),
    ),
)


# Reachable


def _behind_gateway(case: Case) -> bool:
    return any(case.gateways)


def _reachable(case: Case) -> Judgement:
    if case.observer.seen.unreachable:
        return Judgement(FAILED, "an answer to the controller", case.observer.seen.problem or "no answer")
    return Judgement(OK, "an answer to the controller", "an answer")


REACHABLE = Check(
    id="reachable",
    title="computer answers the controller",
    scope=COMPUTER,
    judge=_reachable,
    documented=Documented("computer", "it answers the controller"),
    explained_by=("gateway:reachable", "gateway:forwarding"),
    causes=(
        Cause(
            "switched off, not on its network, or without the way back by its gateway {gateway}",
            "switch it on, and see there: ip route; from the controller try: ping {gateway}, then ping {address}",
            when=_behind_gateway,
        ),
        Cause(
            "switched off, not on the network, or the login is refused",
            "switch it on, and try: ansible <computer> -m ansible.builtin.ping",
        ),
    ),
)


# Services


def _has_services(case: Case) -> bool:
    return case.probe is not None and bool(case.observer.plan.services)


def _no_service(case: Case) -> bool:
    return case.probe is not None and any(entry.load_state == "not-found" for entry in case.probe.services)


def _services(case: Case) -> Judgement | None:
    planned = case.observer.plan.services
    if case.probe is None or not planned:
        return None
    states = {entry.name: entry for entry in case.probe.services}
    broken, restarted = [], []
    for name in planned:
        entry = states.get(name)
        if entry is None or entry.active_state != "active":
            state = "unknown" if entry is None else _state(entry)
            broken.append(f"multimaster-{name}.service is {state}")
        elif entry.restarts:
            restarted.append(f"{entry.unit} was started again {entry.restarts} times")
    expected = f"{', '.join(planned)} active"
    if broken:
        return Judgement(FAILED, expected, ", ".join(broken))
    verdict = WARNING if restarted else OK
    return Judgement(verdict, f"{expected}, never started again", ", ".join(restarted) or "all active")


def _state(entry: Service) -> str:
    return "not there" if entry.load_state == "not-found" else f"{entry.active_state} ({entry.sub_state})"


SERVICES = Check(
    id="services",
    title="services are active",
    scope=COMPUTER,
    judge=of_site_yml(_services, _has_services),
    documented=Documented("computer", "its services are active and were never started again by systemd", "3.3"),
    causes=(
        BY_HAND,
        Cause("it was not set up", "run site.yml", when=_no_service),
        Cause("a service does not start, or ends by itself", "read why there: journalctl -b -u 'multimaster-*'"),
    ),
)


def _closed_process(case: Case) -> bool:
    return case.probe is not None and all(not entry.differing for entry in case.probe.services)


def _environment(case: Case) -> Judgement | None:
    running = [entry for entry in (case.probe.services if case.probe else ()) if entry.active_state == "active"]
    if not running:
        return None
    expected = "the environment of the file in every service"
    differing = [f"{', '.join(entry.differing)} of {entry.unit}" for entry in running if entry.differing]
    closed = [entry.unit for entry in running if entry.differing is None]
    if closed and not differing:
        return Judgement(UNKNOWN, expected, f"the process of {', '.join(closed)} cannot be looked at")
    return Judgement(FAILED if differing else OK, expected, "; ".join(differing) or "the same")


ENVIRONMENT = Check(
    id="environment",
    title="services run with the planned environment",
    scope=COMPUTER,
    judge=of_site_yml(_environment, _has_services),
    documented=Documented(
        "computer", "the process of each service really has the variables of the environment file", "3.2"
    ),
    explained_by=("services",),
    causes=(
        BY_HAND,
        Cause("root may not look at other processes there, as in some containers", "nothing", when=_closed_process),
        Cause("the file was changed after the service started", "run site.yml"),
    ),
)


# Measured


def _measured(case: Case) -> Judgement | None:
    seen = case.observer.seen
    if seen.unreachable:
        return None
    problems = list(seen.probe.problems) if seen.probe is not None else []
    measures_udp = case.own is not None and case.own.discovery
    if seen.probe is None or (seen.multicast is None and measures_udp) or seen.problem:
        problems.insert(0, seen.problem or "a measurement gave no result")
    expected, good = (
        ("results of both measurements", "both") if measures_udp else ("a result of the measurement", "one")
    )
    return Judgement(FAILED if problems else OK, expected, " ".join(problems).rstrip(".") or good)


MEASURED = Check(
    id="measured",
    title="computer could be looked at",
    scope=COMPUTER,
    judge=_measured,
    documented=Documented("computer", "the measurements gave a result"),
)


# More of the kernel


def _reverse_path(case: Case) -> Judgement | None:
    if case.probe is None or not _passes_packets_on(case):
        return None
    expected = "a loose reverse-path filter, or none"
    strict = [entry.interface for entry in _interfaces(case.probe, case.observer.plan) if entry.rp_filter == 1]
    found = f"a strict one on {', '.join(strict)}" if strict else "no strict one"
    return Judgement(WARNING if strict else OK, expected, found)


REVERSE_PATH = Check(
    id="reverse_path",
    title="no strict reverse-path filter",
    scope=COMPUTER,
    judge=_reverse_path,
    documented=Documented(
        "gateways, router",
        "the reverse-path filter is not strict: the larger value of `all` and the interface is not 1 (warning)",
    ),
    causes=(
        Cause(
            "{observer} drops packets that come in on another interface than the one that leads back to their source",
            "run site.yml, which sets net.ipv4.conf.all.rp_filter to 2; the larger value of all and the interface counts",
        ),
    ),
)


def _redirects(case: Case) -> Judgement | None:
    if case.probe is None or not case.observer.plan.is_router:
        return None
    sending = [entry.interface for entry in _interfaces(case.probe, case.observer.plan) if entry.send_redirects]
    found = f"they are sent on {', '.join(sending)}" if sending else "none"
    return Judgement(WARNING if sending else OK, "no ICMP redirects", found)


REDIRECTS = Check(
    id="redirects",
    title="router sends no redirects",
    scope=COMPUTER,
    judge=_redirects,
    documented=Documented("router", "no ICMP redirects are sent into the common network (warning)"),
    causes=(
        Cause(
            "packets turn round on the common network, and each brings its sender an ICMP redirect, which ping takes "
            "for an error",
            "run site.yml, which sets net.ipv4.conf.*.send_redirects to 0; it is sent where all or the interface has 1",
        ),
    ),
)


# The robot's roscore


def _roscore_silent(case: Case) -> bool:
    return case.probe is not None and bool(case.probe.roscore.error)


def _roscore_on_loopback(case: Case) -> bool:
    return case.probe is not None and on_loopback(case.probe.roscore.answer)


def _master_uri(case: Case) -> Judgement | None:
    if case.probe is None or case.observer.without_ros:
        return None
    expected = case.ways.masters[case.observer.plan.robot].uri
    roscore = case.probe.roscore
    if roscore.error:
        return Judgement(FAILED, expected, roscore.error)
    good = same_uri(roscore.answer, expected) and same_uri(roscore.uri, expected)
    found = (
        roscore.answer
        if same_uri(roscore.answer, roscore.uri)
        else f"ROS_MASTER_URI {roscore.uri}, and the roscore calls itself {roscore.answer}"
    )
    return Judgement(OK if good else FAILED, expected, found)


MASTER_URI = Check(
    id="master_uri",
    title="ROS_MASTER_URI means the robot's roscore",
    scope=COMPUTER,
    judge=_master_uri,
    documented=Documented("computer", "`ROS_MASTER_URI` and the roscore's own `getUri` are the planned URI", "3.2"),
    explained_by=("services", "master:reachable", "master:services"),
    causes=(
        Cause(
            "no roscore answers at that URI",
            "start it, and see on {master}: journalctl -b -u multimaster-roscore (or the unit of your own roscore)",
            when=_roscore_silent,
        ),
        Cause(
            "the roscore was started with a name that only its own computer understands",
            "start it with the environment of the collection (multimaster_roscore: managed does)",
            when=_roscore_on_loopback,
        ),
        Cause(
            "the roscore, or the environment file, has another host name than planned",
            "run site.yml; a roscore of your own needs the variables of /etc/rosfleet-multimaster/environment",
        ),
    ),
)


# Default routes


def _inner(case: Case) -> bool:
    return bool(case.observer.plan.robot) and not case.observer.plan.common_address


def _default_routes(case: Case) -> Judgement | None:
    if case.probe is None:
        return None
    routes = case.probe.default_routes
    found = ", ".join(map(_told, routes)) or "none"
    return Judgement(OK if len(routes) <= 1 else WARNING, "one default route at most", found)


def _told(route: DefaultRoute) -> str:
    metric = f" with the metric {route.metric}" if route.metric else ""
    return f"{route.gateway or 'no gateway'} on {route.device}{metric}"


DEFAULT_ROUTES = Check(
    id="default_routes",
    title="one default route at most",
    scope=COMPUTER,
    judge=_default_routes,
    documented=Documented("computer", "one at most, of whatever metric (warning)", "4.2"),
    causes=(
        Cause(
            "beside the one by its gateway {gateway} there is another, as DHCP brings it: the lower metric wins, and "
            "packets to other robots may leave there",
            "take the default route from the other interface, or set multimaster_routes to networks for this robot, "
            "so that only the robots' networks go by {gateway}",
            when=_inner,
        ),
        Cause(
            "two interfaces both got a default route",
            "keep the one that leads to the other networks, or give them different metrics",
        ),
    ),
)


# The packet filter


def _packet_filter(case: Case) -> Judgement | None:
    found = case.observer.seen.packet_filter
    if found is None:
        return None
    expected = "the packet filter of the plan" if case.observer.plan.firewall else "no packet filter of the collection"
    return Judgement(FAILED if found.changed or found.failed else OK, expected, found.msg)


PACKET_FILTER = Check(
    id="packet_filter",
    title="the packet filter is as planned",
    scope=COMPUTER,
    judge=of_site_yml(_packet_filter, lambda case: case.observer.seen.packet_filter is not None),
    documented=Documented("computer", "with `multimaster_firewall: fleet`: all its rules are there, now and at boot"),
    causes=(
        BY_HAND,
        Cause(
            "site.yml has not run since the inventory changed, or somebody has changed the rules",
            "run site.yml; if they go again, see on {observer} what else changes the packet filter",
        ),
    ),
)


# In the order in which one failure can explain the next.
CHECKS = (
    FORWARDING,
    REACHABLE,
    SERVICES,
    ENVIRONMENT,
    MEASURED,
    REVERSE_PATH,
    REDIRECTS,
    MASTER_URI,
    DEFAULT_ROUTES,
    PACKET_FILTER,
)
