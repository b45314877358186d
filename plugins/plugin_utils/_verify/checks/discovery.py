# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of discovery: datagrams between two computers, and the discovery node of each master."""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import ComputerPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.case import Case
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import (
    FAILED,
    MASTER,
    MASTER_TOO,
    MEMBER,
    OK,
    WARNING,
    Cause,
    Check,
    Documented,
    Judgement,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import ListedMaster
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.uris import host_of, same_uri

# The share of datagrams that may be lost.
LOSS = 0.05
# Seconds that two clocks may differ: tf extrapolates and messages are dropped from some tenths on.
CLOCK_WARNING, CLOCK_FAILED = 0.1, 0.5


# Datagrams on the group


def _other_source(case: Case) -> bool:
    return bool(case.udp and case.udp.heard_from and case.udp.source_address != str(case.address))


def _other_interface(case: Case) -> bool:
    return bool(case.udp and case.udp.other_interfaces)


def _send_errors(case: Case) -> bool:
    multicast = case.peer.seen.multicast if case.peer else None
    return multicast is not None and bool(multicast.send_errors.count)


def _hears_unicast(case: Case) -> bool:
    return bool(case.udp and case.udp.unicast)


def _udp_multicast(case: Case) -> Judgement | None:
    udp, own, planned = case.udp, case.own, case.planned
    if udp is None or own is None or planned is None or case.fleet.transport == "unicast":
        return None
    if not (own.multicast and planned.multicast):
        return None
    address = str(planned.discovery_address)
    expected = f"datagrams on {case.fleet.multicast_group}:{case.fleet.multicast_port} from {address}"
    if not udp.heard_from:
        elsewhere = f"none, but on {', '.join(udp.other_interfaces)}" if udp.other_interfaces else "none"
        return Judgement(_other_leg(case, udp.unicast), expected, elsewhere)
    if udp.source_address != address:
        return Judgement(FAILED, expected, f"from {udp.source_address}")
    loss = case.back_udp.loss if case.back_udp else None  # the sender knows how many it has sent
    if loss is not None and loss >= LOSS:
        return Judgement(WARNING, expected, f"{loss:.0%} of them are lost")
    return Judgement(OK, expected, f"{udp.heard} datagrams")


def _other_leg(case: Case, other: bool | None) -> str:
    """With the transport `both`, the discovery nodes find each other as long as one of the two ways works."""
    return WARNING if case.fleet.transport == "both" and other else FAILED


UDP_MULTICAST = Check(
    id="udp_multicast",
    title="datagrams on the multicast group arrive",
    scope=MEMBER,
    judge=_udp_multicast,
    documented=Documented(
        "pair that the group reaches",
        "UDP datagrams on the group and port in use arrive, from the planned address",
        "3.3",
    ),
    explained_by=("target:reachable", "target:measured", "ping_address"),
    causes=(
        Cause(
            "addresses are translated on the way from {target} (NAT, a container or virtual machine)",
            "connect {target} by a bridge or the host's network, so that it is seen as {address}",
            when=_other_source,
        ),
        Cause(
            "{target} arrives on another interface of {observer} than planned",
            "set multimaster_address of both to addresses of one network",
            when=_other_interface,
        ),
        Cause(
            "datagrams are lost on the way, as on a weak wireless link",
            "look at the signal; a heartbeat is repeated, so discovery works, but later",
            when=Case.hears_target,
        ),
        Cause(
            "the kernel of {target} refuses to send to {group}",
            "look at the firewall of {target}: nft list ruleset",
            when=_send_errors,
        ),
        Cause(
            "{group} is filtered, unicast is not: IGMP snooping without a querier, an access point that "
            "drops multicast, or a firewall",
            "let UDP port {port} to {group} pass, switch IGMP snooping off or a querier on; with "
            "multimaster_transport: both the robots find each other meanwhile",
            when=_hears_unicast,
        ),
        Cause(
            "a firewall drops UDP port {port}, or the two are not in one network",
            "allow UDP port {port} on {target}, on {observer} and between them",
        ),
    ),
)


# Datagrams to the computer


def _translated_here(case: Case) -> bool:
    """The target's helper has heard this computer, from an address that is not the planned one."""
    theirs = case.back_udp.source_address if case.back_udp else None
    seen = (case.udp.own_source_address if case.udp else None) or theirs
    return seen is not None and case.own is not None and seen != str(case.own.discovery_address)


def _udp_unicast(case: Case) -> Judgement | None:
    if case.udp is None or case.fleet.transport == "multicast":
        return None
    expected = f"datagrams to port {case.fleet.multicast_port} arrive there"
    if case.udp.unicast:
        return Judgement(OK, expected, "they arrive")
    found = "no answer" if case.udp.unicast is None else "none arrives"
    return Judgement(_other_leg(case, case.udp.heard_from), expected, found)


UDP_UNICAST = Check(
    id="udp_unicast",
    title="datagrams to the computer arrive",
    scope=MEMBER,
    judge=_udp_unicast,
    documented=Documented("pair with discovery", "UDP datagrams to the computer itself arrive on that port"),
    explained_by=("target:reachable", "target:measured", "ping_address"),
    causes=(
        Cause(
            "addresses are translated on the way (NAT): {target} sees {observer} from another address",
            "let no gateway translate addresses (masquerade) between the robots' networks; see there: nft list ruleset",
            when=_translated_here,
        ),
        Cause(
            "a firewall drops UDP port {port} to {target}, or the answer to {observer}",
            "allow UDP port {port} in both directions between {observer} and {target}",
        ),
    ),
)


# The source address of datagrams


def _leaves_by_gateway(case: Case) -> bool:
    return case.way.own is not None


def _source(case: Case) -> Judgement | None:
    """Judge if a gateway between networks translates addresses: the helper on the target counts who called."""
    multicast = case.peer.seen.multicast if case.peer else None
    if case.probe is None or case.peer is None or multicast is None or not case.way.crosses or not multicast.udp:
        return None
    source = str(case.way.source)
    arrived = source in case.peer.callers
    expected = f"datagrams from {source} arrive there"
    return Judgement(OK if arrived else WARNING, expected, "they arrive" if arrived else "none arrives")


SOURCE = Check(
    id="source",
    title="datagrams arrive from the planned address",
    scope=MEMBER,
    judge=_source,
    documented=Documented(
        "pair between networks", "datagrams arrive from the planned address: no gateway translates it (warning)", "4.2"
    ),
    explained_by=("target:reachable", "target:measured", "observer:measured", "ping_address"),
    causes=(
        Cause(
            "the gateway {gateway} translates addresses (masquerading), or drops UDP port {port}",
            "translate nothing between the robots' networks; see on {gateway}: nft list ruleset; iptables -t nat -S",
            when=_leaves_by_gateway,
        ),
        Cause(
            "addresses are translated on the way from {observer} to {target} (NAT), or UDP port {port} is dropped",
            "translate nothing between the robots' networks, and let UDP port {port} pass",
        ),
    ),
)


# Pings of the group


def _icmp_rounds(case: Case) -> Judgement | None:
    icmp = case.observer.seen.multicast.icmp if case.observer.seen.multicast else None
    if icmp is None or case.peer is None or not _answers_broadcasts(case.peer.plan):
        return None  # by plan it does not answer: the kernel's default, and no harm
    if not (case.observer.plan.common_address and case.peer.plan.common_address):
        return None  # such a ping stays on the common network
    expected = f"an answer to each of {len(icmp.rounds)} pings of {icmp.group}"
    missed = [number for number, answered in case.observer.rounds if case.target not in answered]
    if icmp.error or missed:
        return Judgement(WARNING, expected, icmp.error or f"none in the rounds {', '.join(map(str, missed))}")
    return Judgement(OK, expected, "all")


def _answers_broadcasts(plan: ComputerPlan) -> bool:
    name = "net.ipv4.icmp_echo_ignore_broadcasts"
    return any(setting.name == name and setting.value == "0" for setting in plan.sysctl)


ICMP_ROUNDS = Check(
    id="icmp_rounds",
    title="ping of the multicast group (informs only)",
    scope=MEMBER,
    judge=_icmp_rounds,
    documented=Documented(
        "pair on the common network",
        "an answer in each round of `ping 224.0.0.1`; informs only, and only where computers are to answer",
        "3.2",
    ),
    explained_by=("target:reachable", "ping_address"),
    causes=(
        Cause(
            "{target} does not answer pings of a group; discovery does not depend on it",
            "if you want the answers: run site.yml on {target}, which sets net.ipv4.icmp_echo_ignore_broadcasts",
            when=Case.hears_target,
        ),
        Cause("multicast does not reach {target}", "see the check of datagrams on the group"),
    ),
)


# The port of a discovery node


def _connect_error(case: Case) -> str:
    entry = case.observer.masters.get(case.target)
    return entry.error.lower() if entry else ""


def _unreachable(case: Case) -> bool:
    return "network is unreachable" in _connect_error(case)


def _refused(case: Case) -> bool:
    return "refused" in _connect_error(case)


def _rpc_port(case: Case) -> Judgement | None:
    entry = case.observer.masters.get(case.target)
    if entry is None:
        return None
    expected = f"TCP port {entry.port} of {case.address} opens"
    if entry.open:
        return Judgement(OK, expected, f"{entry.connect_ms} ms")
    return Judgement(FAILED, expected, entry.error)


RPC_PORT = Check(
    id="rpc_port",
    title="port of the discovery node opens",
    scope=MASTER_TOO,
    judge=_rpc_port,
    documented=Documented("to masters", "the TCP port of the discovery node opens"),
    explained_by=("target:reachable", "target:services", "ping_address"),
    causes=(
        Cause(
            "{observer} has no route to {address}, the address of {target} on the common network",
            "run site.yml, which sets its routes; see on {observer}: ip route",
            when=_unreachable,
        ),
        Cause(
            "no discovery node listens on TCP port {port} of {target}",
            "see on {target}: systemctl status multimaster-discovery; ss -ltnp",
            when=_refused,
        ),
        Cause(
            "a firewall drops TCP port {port} of {target}, or {address} is not reached",
            "allow TCP port {port} on {target}, and all TCP ports above 1024 for the nodes",
        ),
    ),
)


# Clocks


def _no_clock(case: Case) -> bool:
    entry = case.observer.masters.get(case.target)
    return entry is not None and entry.clock_offset_s is None


def _clock(case: Case) -> Judgement | None:
    entry = case.observer.masters.get(case.target)
    if entry is None:
        return None
    expected = f"less than {CLOCK_WARNING} s apart"
    offset = entry.clock_offset_s
    if offset is None:
        return Judgement(FAILED, expected, entry.clock_error or "no answer")
    sure = abs(offset) - (entry.clock_uncertainty_s or 0.0)
    verdict = OK if sure < CLOCK_WARNING else WARNING if sure < CLOCK_FAILED else FAILED
    return Judgement(verdict, expected, f"{offset:+.4f} s")


CLOCK = Check(
    id="clock",
    title="clocks agree",
    scope=MASTER,
    judge=_clock,
    documented=Documented("to masters", "less than 0.1 s apart (warning), less than 0.5 s (failure)"),
    explained_by=("rpc_port",),
    causes=(
        Cause(
            "what listens on TCP port {port} of {target} is no discovery node that answers",
            "see on {target}: ss -ltnp; journalctl -b -u multimaster-discovery",
            when=_no_clock,
        ),
        Cause(
            "the clocks of {observer} and {target} are not synchronised",
            "run chrony on all computers with one of them, or a server, as the source",
        ),
    ),
)


# The masters that a discovery node lists


def _call_failed(case: Case) -> bool:
    return not case.observer.listed and case.probe is not None and bool(case.probe.list_masters.error)


def _offline(case: Case) -> bool:
    entry = case.observer.listed.get(case.master.name)
    return entry is not None and not entry.online


def _translated(case: Case) -> bool:
    entry = case.observer.listed.get(case.master.name)
    return entry is not None and not _monitored(entry, case)


def _listed_otherwise(case: Case) -> bool:
    return case.master.name in case.observer.listed


def _port_open(case: Case) -> bool:
    entry = case.observer.masters.get(case.target)
    return entry is not None and entry.open


def _list_masters(case: Case) -> Judgement | None:
    if case.probe is None or case.observer.without_ros:
        return None
    master = case.master
    expected = f"{master.name} online, {master.uri}, monitored at {master.monitor_uri}"
    entry = case.observer.listed.get(master.name)
    if entry is None:
        error = case.probe.list_masters.error
        return Judgement(FAILED, expected, error or f"not among {', '.join(sorted(case.observer.listed)) or 'none'}")
    state = "online" if entry.online else "offline"
    found = f"{entry.name} {state}, {entry.uri}, monitored at {entry.monitoruri}"
    good = entry.online and same_uri(entry.uri, master.uri) and _monitored(entry, case)
    return Judgement(OK if good else FAILED, expected, found)


def _monitored(entry: ListedMaster, case: Case) -> bool:
    """A node may see itself through its loopback interface; the others must see it at its planned address."""
    host = host_of(entry.monitoruri)
    own = case.master.robot == case.observer.plan.robot
    return host == str(case.address) or (own and host in ("localhost", "127.0.0.1"))


LIST_MASTERS = Check(
    id="list_masters",
    title="rosservice call /master_discovery/list_masters",
    scope=MASTER_TOO,
    judge=_list_masters,
    documented=Documented(
        "to masters",
        "`rosservice call /master_discovery/list_masters` has the master online, with its planned URIs",
        "3.3, Fig. 8",
    ),
    explained_by=(
        "target:reachable",
        "observer:services",
        "master:services",
        "target:services",
        "observer:master_uri",
        "target:master_uri",
        "rpc_port",
        "between masters:rpc_port",
        "between masters:udp_multicast",
        "between masters:udp_unicast",
    ),
    causes=(
        Cause(
            "the service of the discovery node on {master} cannot be called there",
            "see on {master}: systemctl status multimaster-discovery; on {observer}: rosservice list",
            when=_call_failed,
        ),
        Cause(
            "{master} has known {target}, and no longer hears it",
            "see on {target}: systemctl status multimaster-discovery",
            when=_offline,
        ),
        Cause(
            "{master} sees {target} from another address: addresses are translated on the way (NAT)",
            "connect {target} by a bridge or the host's network, so that it is seen as {address}",
            when=_translated,
        ),
        Cause(
            "the roscore of {target} calls itself otherwise than planned",
            "run site.yml on {target}; a roscore of your own needs the collection's ROS_HOSTNAME or ROS_IP",
            when=_listed_otherwise,
        ),
        Cause(
            "the TCP port of {target} opens, but its heartbeats do not reach the discovery node of {master}",
            "run site.yml, so that both use one group and port; see: journalctl -b -u multimaster-discovery",
            when=_port_open,
        ),
        Cause(
            "the discovery nodes of {master} and {target} do not find each other",
            "allow UDP port {port} and the discovery node's TCP port between them",
        ),
    ),
)


# In the order in which one failure can explain the next.
CHECKS = (
    UDP_MULTICAST,
    UDP_UNICAST,
    SOURCE,
    ICMP_ROUNDS,
    RPC_PORT,
    CLOCK,
    LIST_MASTERS,
)
