# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of the network between two computers: names, routes, pings."""

from __future__ import annotations

import ipaddress

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.case import Case
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import (
    FAILED,
    ITSELF_TOO,
    MEMBER,
    OK,
    WARNING,
    Cause,
    Check,
    Documented,
    Judgement,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import Ping

# The name


def _addresses(case: Case) -> tuple[str, ...]:
    """List the addresses that the target's name has on the observer."""
    return case.member.addresses if case.member else ()


def _loopback_name(case: Case) -> bool:
    return any(ipaddress.ip_address(address).is_loopback for address in _addresses(case))


def _no_address(case: Case) -> bool:
    return not _addresses(case)


def _several_addresses(case: Case) -> bool:
    return len(_addresses(case)) > 1


def _name(case: Case) -> Judgement | None:
    if case.member is None or case.observer.plan.is_router:
        return None
    addresses, expected = case.member.addresses, str(case.address)
    found = ", ".join(addresses) or case.member.resolve_error
    # Fig. 6 of the report leaves 127.0.1.1 at the own name, and these robots talk.
    verdict = WARNING if case.by_hand and case.target == case.observer.name and expected in addresses else FAILED
    return Judgement(OK if addresses == (expected,) else verdict, expected, found)


NAME = Check(
    id="name",
    title="name means the planned address",
    scope=ITSELF_TOO,
    judge=_name,
    documented=Documented("pair, itself too", "the name resolves to the planned address and no other", "3.1, Fig. 6"),
    causes=(
        Cause("the name is not known there", "run site.yml, which writes /etc/hosts", when=_no_address),
        Cause(
            "/etc/hosts there binds the name to the loopback interface",
            "run site.yml, which also keeps cloud-init from writing the line again at boot",
            when=_loopback_name,
        ),
        Cause(
            "the name has a second address: another line of /etc/hosts, or a name server",
            "remove the line that is not the collection's from /etc/hosts there",
            when=_several_addresses,
        ),
        Cause(
            "another line of /etc/hosts there, or a name server, has an older address",
            "run site.yml, which names the line that stands against it",
        ),
    ),
)


# The route


def _next_hops(case: Case) -> set[str]:
    """List the gateways that the route may have, as texts; an empty text is a route without a gateway.

    With `multimaster_routes: existing`, a computer on the common network may also go by the router.
    """
    hop, plan, router = case.way.next_hop, case.observer.plan, case.fleet.router
    hops = {str(hop) if hop else ""}
    if hop and plan.common_address and plan.routes_expected and router:
        hops.add(str(router.address))
    return hops


def _no_route(case: Case) -> bool:
    return case.member is not None and case.member.route is not None and bool(case.member.route.error)


def _other_hop(case: Case) -> bool:
    route = case.member.route if case.member else None
    return route is not None and case.way.crosses and (route.gateway or "") not in _next_hops(case)


def _route(case: Case) -> Judgement | None:
    route = case.member.route if case.member else None
    if route is None:
        return None
    way = case.way
    expected = f"a route from {way.source}" + (f" by {way.next_hop}" if way.next_hop else "")
    if route.error:
        return Judgement(FAILED, expected, route.error)
    via = f" by {route.gateway}" if route.gateway else ""
    good = route.source == str(way.source) and (route.gateway or "") in _next_hops(case)
    return Judgement(OK if good else FAILED, expected, f"on {route.device} from {route.source}{via}")


ROUTE = Check(
    id="route",
    title="packets leave from the planned address",
    scope=MEMBER,
    judge=_route,
    documented=Documented("pair", "packets leave from the planned address, and by the planned gateway", "4.2"),
    causes=(
        Cause(
            "{observer} has no way out of its network, so it neither asks nor answers",
            "run site.yml, which sets its routes; see on {observer}: ip route",
            when=_no_route,
        ),
        Cause(
            "another route of {observer} comes first: a second default route, as DHCP brings it, or one set by hand",
            "run site.yml, which names it; see on {observer}: ip route",
            when=_other_hop,
        ),
        Cause(
            "another interface of {observer} has a network that holds {address}, or its own interface is down",
            "see on {observer}: ip route get {address}; ip address; correct the interface or multimaster_address",
        ),
    ),
)


# The ping by address


def _ping_error(case: Case) -> str:
    ping = case.member.ping_address if case.member else None
    return ping.error if ping else ""


def _target_down(case: Case) -> bool:
    return case.peer is not None and case.peer.seen.unreachable


def _refused_on_the_way(case: Case) -> bool:
    return "prohibited" in _ping_error(case)


def _in_a_circle(case: Case) -> bool:
    return "time to live" in _ping_error(case)


def _gateway_finds_nobody(case: Case) -> bool:
    """The gateway of the target's network itself says that nobody has the address there."""
    error, its = _ping_error(case), case.way.its
    return (
        its is not None
        and "host unreachable" in error
        and error.startswith((str(its.common_address), str(its.address)))
    )


def _own_gateway_silent(case: Case) -> bool:
    gateway = case.ways.gateways.get(case.observer.plan.robot)
    return gateway is not None and gateway.name == case.target


def _no_way_back(case: Case) -> bool:
    """The target has no route to any other network."""
    seen = case.peer.members if case.peer else {}
    errors = [
        member.route.error
        for name, member in seen.items()
        if member.route is not None and case.ways.members[name].robot != _its_robot(case)
    ]
    return bool(errors) and all(errors)


def _its_robot(case: Case) -> str:
    return case.planned.robot if case.planned else ""


def _nothing_leaves(case: Case) -> bool:
    """The observer reaches its gateway, and nobody behind it."""
    own, answered = case.way.own, case.observer.answered
    if own is None or own.name not in answered:  # a device of another make was not asked
        return False
    return _only_its_own(case, answered)


def _only_its_own(case: Case, answered: frozenset[str]) -> bool:
    return all(case.ways.members[name].robot == case.observer.plan.robot for name in answered)


def _nothing_enters(case: Case) -> bool:
    """The target's gateway is reached, but nobody behind it, though the target reaches its gateway."""
    its, answered = case.way.its, case.observer.answered
    if its is None or its.name not in answered:
        return False
    if case.peer is not None and its.name not in case.peer.answered:
        return False
    return not any(name in answered for name in case.ways.inner[_its_robot(case)])


def _device_passes_nothing_out(case: Case) -> bool:
    """The observer is behind a device of another make, and reaches nobody beyond it."""
    own = case.way.own
    return own is not None and not own.name and _only_its_own(case, case.observer.answered)


def _device_passes_nothing_in(case: Case) -> bool:
    """The target is behind a device of another make, and the observer reaches nobody behind it."""
    its = case.way.its
    if its is None or its.name:
        return False
    return not any(name in case.observer.answered for name in case.ways.inner[_its_robot(case)])


def _only_from_outside(case: Case) -> bool:
    """The computers of its own robot reach the target."""
    neighbours = (case.run.get(name) for name in case.ways.robots[_its_robot(case)])
    return case.way.crosses and any(neighbour and case.target in neighbour.answered for neighbour in neighbours)


def _crosses(case: Case) -> bool:
    return case.way.crosses


def _ping_address(case: Case) -> Judgement | None:
    return _judged(case.member.ping_address if case.member else None, f"an answer of {case.address}")


def _judged(ping: Ping | None, expected: str) -> Judgement | None:
    if ping is None:
        return None
    return Judgement(OK, expected, f"{ping.rtt_ms} ms") if ping.ok else Judgement(FAILED, expected, ping.error)


PING_ADDRESS = Check(
    id="ping_address",
    title="ping by address",
    scope=MEMBER,
    judge=_ping_address,
    documented=Documented("pair", "one of three ICMP echo requests to its address is answered", "3.2, 4.2"),
    explained_by=(
        "target:reachable",
        "route",
        "gateway:reachable",
        "its gateway:reachable",
        "gateway:forwarding",
        "its gateway:forwarding",
        "back:route",
        "to gateway:ping_address",
        "to its gateway:ping_address",
    ),
    causes=(
        Cause(
            "{target} does not answer the controller either",
            "switch {target} on, or repair its network",
            when=_target_down,
        ),
        Cause(
            "{target} is there, since its datagrams arrive: a firewall drops ICMP",
            "allow ICMP echo requests on {target} and on the access point",
            when=Case.hears_target,
        ),
        Cause(
            "a firewall on the way from {observer} to {target} refuses to pass packets on",
            "let packets between the robots' networks pass there; see: nft list ruleset",
            when=_refused_on_the_way,
        ),
        Cause(
            "a gateway or the router on the way sends packets for {address} back to where they came from",
            "run site.yml on all gateways and the router; see there: ip route get {address}",
            when=_in_a_circle,
        ),
        Cause(
            "its gateway {its_gateway} is reached, and finds nobody with the address {address}",
            "switch {target} on, or repair its network; see there: ip address",
            when=_gateway_finds_nobody,
        ),
        Cause(
            "the gateway of {observer} is off, has another address, or its interface to the robot's network is down",
            "switch {target} on; see there: ip address; nothing of {observer} leaves its network meanwhile",
            when=_own_gateway_silent,
        ),
        Cause(
            "{target} has no way out of its network, so its answers do not leave it",
            "run site.yml, which sets its routes; see on {target}: ip route",
            when=_no_way_back,
        ),
        Cause(
            "{gateway} is reached, but passes nothing on between its robot's network and the others: a firewall there "
            "drops forwarded packets, as Docker sets it up",
            "let packets between the robots' networks pass on {gateway}; see there: nft list ruleset; iptables -S FORWARD",
            when=_nothing_leaves,
        ),
        Cause(
            "{its_gateway} is reached, but passes nothing on between its robot's network and the others: a firewall there "
            "drops forwarded packets, as Docker sets it up",
            "let packets between the robots' networks pass on {its_gateway}; see there: nft list ruleset; iptables -S FORWARD",
            when=_nothing_enters,
        ),
        Cause(
            "the gateway {gateway}, a device of another make, is off, has another address, or does not pass packets on",
            "switch it on; playbooks/router_config.yml writes what to paste into it (docs/router.md)",
            when=_device_passes_nothing_out,
        ),
        Cause(
            "the gateway {its_gateway}, a device of another make, is off, has another address, or does not pass packets on",
            "switch it on; playbooks/router_config.yml writes what to paste into it (docs/router.md)",
            when=_device_passes_nothing_in,
        ),
        Cause(
            "{target} answers in its own network: its answers to {observer} do not find back, or its firewall knows its "
            "own network only",
            "see on {target}: ip route; nft list ruleset; and run site.yml on it",
            when=_only_from_outside,
        ),
        Cause(
            "{target} is off, has another address, or its gateway {its_gateway} does not pass packets on",
            "see on {target}: ip address; ip route; on {its_gateway}: ip route; nft list ruleset",
            when=_crosses,
        ),
        Cause(
            "{target} is off, has another address, or the access point keeps its clients apart",
            "see on {target}: ip address; switch off client isolation on the access point",
        ),
    ),
)


# The ping by name


def _ping_name(case: Case) -> Judgement | None:
    if case.observer.plan.is_router:
        return None
    return _judged(case.member.ping_name if case.member else None, f"an answer of {case.target}")


PING_NAME = Check(
    id="ping_name",
    title="ping by name",
    scope=MEMBER,
    judge=_ping_name,
    documented=Documented("pair", "one of three ICMP echo requests to what its name means is answered", "3.2, 4.2"),
    explained_by=("name", "ping_address", "target:reachable"),
    causes=(Cause("the name {target} leads elsewhere", "see on {observer}: getent ahostsv4 {target}"),),
)


# In the order in which one failure can explain the next.
CHECKS = (
    NAME,
    ROUTE,
    PING_ADDRESS,
    PING_NAME,
)
