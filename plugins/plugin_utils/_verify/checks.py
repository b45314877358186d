# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What must hold in a fleet that talks, and why it does not where it does not: checks as data over observations.

Pure: the plan of `fleet_plan` and what `multicast_verify` and `multimaster_verify` returned in, findings out.
Every observation is looked at once, so the cost grows with the number of observations.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.exchange import Conflict, Exchanges, Item
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.ways import Gateway, Layout, Way

OK, WARNING, FAILED, UNKNOWN = "ok", "warning", "failed", "unknown"
VERDICTS = (OK, WARNING, FAILED, UNKNOWN)

# Seconds that two clocks may differ: tf extrapolates and messages are dropped from some tenths on.
CLOCK_WARNING, CLOCK_FAILED = 0.1, 0.5
LOSS = 0.05  # the share of datagrams that may be lost
NAMED = 4  # registrations, names or connections that a finding names
TALKER_TYPE, TALKER_NODE = "std_msgs/String", "/multimaster_verify_talker_"

COMPUTER, ITSELF_TOO, MEMBER, MASTER, MASTER_TOO = "computer", "itself too", "member", "master", "master too"


@dataclass(frozen=True)
class Observation:
    """What one computer of this run gave: the two probes' returns, and what kept it from giving them."""

    multicast: Mapping[str, Any] | None = None
    probe: Mapping[str, Any] | None = None
    unreachable: bool = False
    problem: str = ""


@dataclass(frozen=True)
class Finding:
    """One check between an observer and a target, which is the observer itself for a check of one computer.

    `because` is the check whose failure explains this one, or empty.
    """

    check: str
    observer: str
    target: str
    verdict: str
    expected: str
    found: str
    cause: str = ""
    remedy: str = ""
    because: str = ""


class Judgement(NamedTuple):
    """Verdict, expected and found of one check."""

    verdict: str
    expected: str = ""
    found: str = ""


@dataclass(frozen=True)
class Cause:
    """A cause, what to do, and how it is told.

    Texts may have {observer}, {target}, {address}, {port} and {group}, {gateway} and {its_gateway} for the gateways of the
    observer's and the target's network, {master} and {its_master} for the computers with the two roscores.
    """

    when: Callable[[Case], bool]
    cause: str
    remedy: str


@dataclass(frozen=True)
class Check:
    """A check: for whom, its judge (None where nothing is to be judged), what explains its failure, causes in order.

    `explained_by` names checks, of this pair or of another one with a side of SIDES before a colon ("target:...").
    """

    id: str
    title: str
    scope: str
    judge: Callable[[Case], Judgement | None]
    explained_by: Sequence[str] = ()
    causes: Sequence[Cause] = ()


@dataclass
class Computer:
    """One computer of the run: its plan and its observation, each list of it by name."""

    name: str
    plan: Mapping[str, Any]
    seen: Observation
    members: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    masters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    listed: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    topics: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    udp: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    answered: frozenset[str] = frozenset()  # the members that answered its pings
    callers: frozenset[str] = frozenset()  # the addresses from which it was called

    @classmethod
    def of(cls, name: str, plan: Mapping[str, Any], seen: Observation) -> Computer:
        """Index an observation."""
        probe, multicast = seen.probe or {}, seen.multicast or {}
        return cls(
            name=name,
            plan=plan,
            seen=seen,
            members={entry["name"]: entry for entry in probe.get("members", ())},
            masters={entry["computer"]: entry for entry in probe.get("masters", ())},
            listed={entry["name"]: entry for entry in probe.get("list_masters", {}).get("masters", ())},
            topics={entry["computer"]: entry for entry in probe.get("topics", ())},
            udp={entry["name"]: entry for entry in multicast.get("udp", ())},
            answered=frozenset(
                entry["name"] for entry in probe.get("members", ()) if entry.get("ping_address", {}).get("ok")
            ),
            callers=frozenset(entry["address"] for entry in multicast.get("callers", ())),
        )


@dataclass
class Case:
    """What a judge sees: the fleet, the observer, and the target (a member or a master of the plan)."""

    fleet: Mapping[str, Any]
    layout: Layout
    observer: Computer
    target: str
    address: str
    master: Mapping[str, Any] | None
    run: Mapping[str, Computer]  # the computers of this run
    exchanges: Exchanges

    @property
    def robots(self) -> tuple[str, str]:
        """The robot of the observer, and that of the target."""
        return self.observer.plan["robot"], self.master["robot"] if self.master else self.planned.get("robot", "")

    @property
    def exchange(self) -> Mapping[str, Any] | None:
        """What the roscore holds of which the observer is the computer; None where it is none, or does not answer."""
        seen = (self.probe or {}).get("exchange") if self.observer.plan["is_master"] else None
        return None if seen is None or self.probe["roscore"]["error"] else seen

    @property
    def probe(self) -> Mapping[str, Any] | None:
        """What multimaster_verify returned."""
        return self.observer.seen.probe

    @property
    def udp(self) -> Mapping[str, Any] | None:
        """What multicast_verify measured towards the target; None where the target does not take part."""
        return self.observer.udp.get(self.target) if self.target in self.run else None

    @property
    def member(self) -> Mapping[str, Any]:
        """What multimaster_verify saw of the target."""
        return self.observer.members.get(self.target, {})

    @property
    def planned(self) -> Mapping[str, Any]:
        """The target among the members of the plan; empty for the router."""
        return self.layout.members.get(self.target, {})

    @property
    def own(self) -> Mapping[str, Any]:
        """The observer among the members of the plan; empty for the router."""
        return self.layout.members.get(self.observer.name, {})

    @property
    def way(self) -> Way:
        """The way that packets are to take to the target."""
        return self.layout.way(self.observer.plan, self.target)

    @property
    def gateways(self) -> tuple[Gateway | None, Gateway | None]:
        """The gateways that the way to the target crosses; for a check of one computer its own and the one before it."""
        if self.target in self.layout.members and self.target != self.observer.name:
            return self.way.own, self.way.its
        behind = not self.observer.plan["common_address"]
        return self.layout.gateways.get(self.observer.plan["robot"]) if behind else None, None

    @property
    def masters(self) -> tuple[str, str]:
        """The computers with the roscores of the observer and of the target."""
        return self.layout.master(self.observer.plan["robot"]), self.layout.master(self.planned.get("robot", ""))

    def sides(self) -> dict[str, tuple[str, str]]:
        """The pairs that SIDES speaks of; a pair with an empty name is of nobody."""
        observer, target = self.observer.name, self.target
        gateway, its_gateway = (found.name if found else "" for found in self.gateways)
        master, its_master = self.masters
        pairs = (
            (observer, target),
            (observer, observer),
            (target, target),
            (target, observer),
            (gateway, gateway),
            (its_gateway, its_gateway),
            (observer, gateway),
            (observer, its_gateway),
            (master, master),
            (its_master, its_master),
            (observer, its_master),
            (master, its_master),
        )
        return dict(zip(SIDES, pairs, strict=True))


# Of whom another check explains one, by what stands before its colon.
SIDES = (
    "",
    "observer",
    "target",
    "back",  # the target looks at the observer
    "gateway",  # of the observer's network
    "its gateway",  # of the target's network
    "to gateway",
    "to its gateway",
    "master",  # the computer with the observer's roscore
    "its master",
    "to its master",
    "between masters",
)


def evaluate(fleet: Mapping[str, Any], observations: Mapping[str, Observation]) -> Iterator[Finding]:
    """Every check of every computer of the run, and of every pair whose observer is in the run, check by check.

    `fleet` is the return of `fleet_plan`; `observations` has an entry for each computer of the run.
    """
    run = {
        name: Computer.of(name, plan, observations[name])
        for name, plan in fleet["computers"].items()
        if name in observations
    }
    layout = Layout(fleet)
    masters = [(entry["computer"], entry["address"], entry) for entry in fleet["masters"]]
    exchanges = Exchanges(
        fleet,
        {
            computer.plan["robot"]: computer.seen.probe["exchange"]
            for computer in run.values()
            if computer.plan["is_master"] and computer.seen.probe and not computer.seen.probe["exchange"]["error"]
        },
    )
    # Gateways first, since what happens there explains what happens behind them.
    computers = sorted(run.values(), key=lambda computer: not computer.plan["is_gateway"])
    bad: set[tuple[str, str, str]] = set()  # (check, observer, target)
    for check in CHECKS:
        for computer in computers:
            for target, address, master in _targets(check, computer, layout, masters):
                if target == computer.name and check.scope in (MEMBER, MASTER):
                    continue
                finding = _finding(check, Case(fleet, layout, computer, target, address, master, run, exchanges), bad)
                if finding is not None:
                    if finding.verdict == FAILED:
                        bad.add((check.id, finding.observer, finding.target))
                    yield finding


def _targets(
    check: Check, computer: Computer, layout: Layout, masters: Sequence[tuple[str, str, Mapping[str, Any]]]
) -> Iterable[tuple[str, str, Mapping[str, Any] | None]]:
    """Whom a computer looks at in a check: (name, address, master or None)."""
    if check.scope == COMPUTER:
        return [(computer.name, computer.plan["address"], None)]
    if check.scope in (MASTER, MASTER_TOO):
        return masters
    return ((name, layout.members[name]["address"], None) for name in layout.order(computer.plan["robot"]))


def _finding(check: Check, case: Case, bad: set[tuple[str, str, str]]) -> Finding | None:
    judgement = check.judge(case)
    if judgement is None:
        return None
    verdict, expected, found = judgement
    observer, target = case.observer.name, case.target
    if verdict == OK:
        return Finding(check.id, observer, target, OK, expected, found)
    sides = case.sides()
    because = next((other for other in check.explained_by if _where(other, sides) in bad), "")
    # What only follows from another failure has that one's cause.
    cause = None if because else next((cause for cause in check.causes if cause.when(case)), None)
    own_gateway, its_gateway = (gateway.title if gateway else "the gateway" for gateway in case.gateways)
    words = {
        "observer": observer,
        "target": target,
        "address": case.address,
        "port": case.master["rpc_port"] if case.master else case.fleet["multicast_port"],
        "group": case.fleet["multicast_group"],
        "gateway": own_gateway,
        "its_gateway": its_gateway,
        "master": case.masters[0],
        "its_master": case.masters[1],
    }
    return Finding(
        check=check.id,
        observer=observer,
        target=target,
        verdict=verdict,
        expected=expected,
        found=found,
        cause=cause.cause.format(**words) if cause else "",
        remedy=cause.remedy.format(**words) if cause else "",
        because=because.rpartition(":")[2],
    )


def _where(reference: str, sides: Mapping[str, tuple[str, str]]) -> tuple[str, str, str]:
    side, _separator, check = reference.rpartition(":")
    return (check, *sides[side])


# The judges: one per check. None means that there is nothing to judge, because another check says so already.


def _reachable(case: Case) -> Judgement:
    if case.observer.seen.unreachable:
        return Judgement(FAILED, "an answer to the controller", case.observer.seen.problem or "no answer")
    return Judgement(OK, "an answer to the controller", "an answer")


def _measured(case: Case) -> Judgement | None:
    seen = case.observer.seen
    if seen.unreachable:
        return None
    problems = list(seen.probe["problems"]) if seen.probe is not None else []
    measures_udp = case.own.get("discovery", False)
    if seen.probe is None or (seen.multicast is None and measures_udp) or seen.problem:
        problems.insert(0, seen.problem or "a measurement gave no result")
    expected, good = (
        ("results of both measurements", "both") if measures_udp else ("a result of the measurement", "one")
    )
    return Judgement(FAILED if problems else OK, expected, " ".join(problems).rstrip(".") or good)


def _forwarding(case: Case) -> Judgement | None:
    if case.probe is None or not _passes_packets_on(case):
        return None
    seen = case.probe["forwarding"]
    expected = "net.ipv4.ip_forward is 1"
    if seen["ip_forward"] is None:
        return Judgement(UNKNOWN, expected, "it cannot be read")
    closed = [entry["interface"] for entry in _interfaces(case) if entry["forwarding"] == 0]
    if seen["ip_forward"] == 0 or not closed:
        return Judgement(OK if seen["ip_forward"] else FAILED, expected, str(seen["ip_forward"]))
    return Judgement(FAILED, expected, f"1, but net.ipv4.conf.{closed[0]}.forwarding is 0")


def _passes_packets_on(case: Case) -> bool:
    return case.observer.plan["is_gateway"] or case.observer.plan["is_router"]


def _interfaces(case: Case) -> list[Mapping[str, Any]]:
    """The observer's interfaces on the networks of the plan."""
    planned = {entry["address"] for entry in case.observer.plan["networks"]}
    return [entry for entry in case.probe["forwarding"]["interfaces"] if planned & set(entry["addresses"])]


def _reverse_path(case: Case) -> Judgement | None:
    if case.probe is None or not _passes_packets_on(case):
        return None
    expected = "a loose reverse-path filter, or none"
    strict = [entry["interface"] for entry in _interfaces(case) if entry["rp_filter"] == 1]
    found = f"a strict one on {', '.join(strict)}" if strict else "no strict one"
    return Judgement(WARNING if strict else OK, expected, found)


def _redirects(case: Case) -> Judgement | None:
    if case.probe is None or not case.observer.plan["is_router"]:
        return None
    sending = [entry["interface"] for entry in _interfaces(case) if entry["send_redirects"]]
    found = f"they are sent on {', '.join(sending)}" if sending else "none"
    return Judgement(WARNING if sending else OK, "no ICMP redirects", found)


def _services(case: Case) -> Judgement | None:
    if case.probe is None or not case.observer.plan["services"]:
        return None
    states = {entry["name"]: entry for entry in case.probe["services"]}
    broken, restarted = [], []
    for name in case.observer.plan["services"]:
        entry = states.get(name)
        if entry is None or entry["active_state"] != "active":
            state = "unknown" if entry is None else _state(entry)
            broken.append(f"multimaster-{name}.service is {state}")
        elif entry["restarts"]:
            restarted.append(f"{entry['unit']} was started again {entry['restarts']} times")
    expected = f"{', '.join(case.observer.plan['services'])} active"
    if broken:
        return Judgement(FAILED, expected, ", ".join(broken))
    return Judgement(
        WARNING if restarted else OK, f"{expected}, never started again", ", ".join(restarted) or "all active"
    )


def _state(entry: Mapping[str, Any]) -> str:
    if entry["load_state"] == "not-found":
        return "not there"
    return f"{entry['active_state']} ({entry['sub_state']})"


def _environment(case: Case) -> Judgement | None:
    running = [entry for entry in (case.probe or {}).get("services", ()) if entry["active_state"] == "active"]
    if not running:
        return None
    expected = "the environment of the file in every service"
    differing = [f"{', '.join(entry['differing'])} of {entry['unit']}" for entry in running if entry["differing"]]
    closed = [entry["unit"] for entry in running if entry["differing"] is None]
    if closed and not differing:
        return Judgement(UNKNOWN, expected, f"the process of {', '.join(closed)} cannot be looked at")
    return Judgement(FAILED if differing else OK, expected, "; ".join(differing) or "the same")


def _master_uri(case: Case) -> Judgement | None:
    if case.probe is None or _without_ros(case.observer):
        return None
    expected = case.layout.masters[case.observer.plan["robot"]]["uri"]
    roscore = case.probe["roscore"]
    if roscore["error"]:
        return Judgement(FAILED, expected, roscore["error"])
    good = _same_uri(roscore["answer"], expected) and _same_uri(roscore["uri"], expected)
    found = (
        roscore["answer"]
        if _same_uri(roscore["answer"], roscore["uri"])
        else (f"ROS_MASTER_URI {roscore['uri']}, and the roscore calls itself {roscore['answer']}")
    )
    return Judgement(OK if good else FAILED, expected, found)


def _without_ros(computer: Computer) -> bool:
    """The router is without ROS, and a second computer of a robot may be; the master's computer may not."""
    return not computer.plan["is_master"] and bool((computer.seen.probe or {}).get("ros_missing", True))


def _same_uri(one: str, other: str) -> bool:
    return one.rstrip("/").lower() == other.rstrip("/").lower()


def _default_routes(case: Case) -> Judgement | None:
    if case.probe is None:
        return None
    routes = case.probe["default_routes"]
    found = ", ".join(map(_default_route, routes)) or "none"
    return Judgement(OK if len(routes) <= 1 else WARNING, "one default route at most", found)


def _default_route(route: Mapping[str, Any]) -> str:
    metric = f" with the metric {route['metric']}" if route.get("metric") else ""
    return f"{route['gateway'] or 'no gateway'} on {route['device']}{metric}"


def _name(case: Case) -> Judgement | None:
    if not case.member or case.observer.plan["is_router"]:
        return None
    addresses = case.member["addresses"]
    found = ", ".join(addresses) or case.member["resolve_error"]
    return Judgement(OK if addresses == [case.address] else FAILED, case.address, found)


def _route(case: Case) -> Judgement | None:
    if not case.member:
        return None
    route, way = case.member["route"], case.way
    expected = f"a route from {way.source}" + (f" by {way.hop}" if way.hop else "")
    if route["error"]:
        return Judgement(FAILED, expected, route["error"])
    via = f" by {route['gateway']}" if route["gateway"] else ""
    good = route["source"] == way.source and (route["gateway"] or "") in _hops(case, way)
    return Judgement(OK if good else FAILED, expected, f"on {route['device']} from {route['source']}{via}")


def _hops(case: Case, way: Way) -> set[str]:
    """With `multimaster_routes: existing`, a computer on the common network may also go by the router."""
    hops = {way.hop}
    if (
        way.hop
        and case.observer.plan["common_address"]
        and case.observer.plan["routes_expected"]
        and case.fleet["router"]
    ):
        hops.add(case.fleet["router"]["address"])
    return hops


def _ping_address(case: Case) -> Judgement | None:
    return _ping(case.member.get("ping_address"), f"an answer of {case.address}")


def _ping_name(case: Case) -> Judgement | None:
    if case.observer.plan["is_router"]:
        return None
    return _ping(case.member.get("ping_name"), f"an answer of {case.target}")


def _ping(ping: Mapping[str, Any] | None, expected: str) -> Judgement | None:
    if ping is None:
        return None
    return Judgement(OK, expected, f"{ping['rtt_ms']} ms") if ping["ok"] else Judgement(FAILED, expected, ping["error"])


def _udp_multicast(case: Case) -> Judgement | None:
    if (
        case.udp is None
        or case.fleet["transport"] == "unicast"
        or not (case.own["multicast"] and case.planned["multicast"])
    ):
        return None
    udp, address = case.udp, case.planned["discovery_address"]
    expected = f"datagrams on {case.fleet['multicast_group']}:{case.fleet['multicast_port']} from {address}"
    if not udp["heard_from"]:
        elsewhere = f"none, but on {', '.join(udp['other_interfaces'])}" if udp["other_interfaces"] else "none"
        return Judgement(_other_leg(case, udp["unicast"]), expected, elsewhere)
    if udp["source_address"] != address:
        return Judgement(FAILED, expected, f"from {udp['source_address']}")
    loss = case.run[case.target].udp.get(case.observer.name, {}).get("loss")  # the sender knows how many it has sent
    if loss is not None and loss >= LOSS:
        return Judgement(WARNING, expected, f"{loss:.0%} of them are lost")
    return Judgement(OK, expected, f"{udp['heard']} datagrams")


def _udp_unicast(case: Case) -> Judgement | None:
    if case.udp is None or case.fleet["transport"] == "multicast":
        return None
    expected = f"datagrams to port {case.fleet['multicast_port']} arrive there"
    if case.udp["unicast"]:
        return Judgement(OK, expected, "they arrive")
    found = "no answer" if case.udp["unicast"] is None else "none arrives"
    return Judgement(_other_leg(case, case.udp["heard_from"]), expected, found)


def _source(case: Case) -> Judgement | None:
    """Between networks, whether a gateway on the way translates addresses: the helper there has counted who called."""
    target = case.run.get(case.target)
    if case.probe is None or target is None or not case.way.crosses or not (target.seen.multicast or {}).get("udp"):
        return None
    source = case.way.source
    expected = f"datagrams from {source} arrive there"
    arrived = source in target.callers
    return Judgement(OK if arrived else WARNING, expected, "they arrive" if arrived else "none arrives")


def _other_leg(case: Case, other: bool | None) -> str:
    """With the transport `both`, the discovery nodes find each other as long as one of the two ways works."""
    return WARNING if case.fleet["transport"] == "both" and other else FAILED


def _icmp_rounds(case: Case) -> Judgement | None:
    icmp = (case.observer.seen.multicast or {}).get("icmp")
    if not icmp or case.target not in case.run or not _answers_broadcasts(case.run[case.target].plan):
        return None  # by plan it does not answer: the kernel's default, and no harm
    if not (case.observer.plan["common_address"] and case.run[case.target].plan["common_address"]):
        return None  # such a ping stays on the common network
    expected = f"an answer to each of {len(icmp['rounds'])} pings of {icmp['group']}"
    missed = [item["round"] for item in icmp["rounds"] if case.target not in item["answered"]]
    if icmp["error"] or missed:
        return Judgement(WARNING, expected, icmp["error"] or f"none in the rounds {', '.join(map(str, missed))}")
    return Judgement(OK, expected, "all")


def _answers_broadcasts(plan: Mapping[str, Any]) -> bool:
    name = "net.ipv4.icmp_echo_ignore_broadcasts"
    return any(setting["name"] == name and str(setting["value"]) == "0" for setting in plan["sysctl"])


def _rpc_port(case: Case) -> Judgement | None:
    entry = case.observer.masters.get(case.target)
    if entry is None:
        return None
    expected = f"TCP port {entry['port']} of {case.address} opens"
    return (
        Judgement(OK, expected, f"{entry['connect_ms']} ms")
        if entry["open"]
        else (Judgement(FAILED, expected, entry["error"]))
    )


def _clock(case: Case) -> Judgement | None:
    entry = case.observer.masters.get(case.target)
    if entry is None:
        return None
    expected = f"less than {CLOCK_WARNING} s apart"
    offset = entry["clock_offset_s"]
    if offset is None:
        return Judgement(FAILED, expected, entry["clock_error"] or "no answer")
    sure = abs(offset) - entry["clock_uncertainty_s"]
    verdict = OK if sure < CLOCK_WARNING else WARNING if sure < CLOCK_FAILED else FAILED
    return Judgement(verdict, expected, f"{offset:+.4f} s")


def _list_masters(case: Case) -> Judgement | None:
    if case.probe is None or _without_ros(case.observer):
        return None
    master = case.master
    expected = f"{master['name']} online, {master['uri']}, monitored at {master['monitor_uri']}"
    entry = case.observer.listed.get(master["name"])
    if entry is None:
        error = case.probe["list_masters"]["error"]
        return Judgement(FAILED, expected, error or f"not among {', '.join(sorted(case.observer.listed)) or 'none'}")
    state = "online" if entry["online"] else "offline"
    found = f"{entry['name']} {state}, {entry['uri']}, monitored at {entry['monitoruri']}"
    good = entry["online"] and _same_uri(entry["uri"], master["uri"]) and _monitored(entry, case)
    return Judgement(OK if good else FAILED, expected, found)


def _monitored(entry: Mapping[str, Any], case: Case) -> bool:
    """A node may see itself through its loopback interface; the others must see it at its planned address."""
    host = _host(entry["monitoruri"])
    own = case.master["robot"] == case.observer.plan["robot"]
    return host == case.address or (own and host in ("localhost", "127.0.0.1"))


def _host(uri: str) -> str:
    return (urlsplit(uri).hostname or "").lower()


def _strangers(case: Case) -> Judgement | None:
    if case.probe is None or not (case.observer.seen.multicast or case.observer.listed):
        return None
    names = {master["name"] for master in case.fleet["masters"]}
    listed = sorted(name for name in case.observer.listed if name not in names)
    heard = [
        f"{entry['address']} on {entry['interface']}"
        for entry in (case.observer.seen.multicast or {}).get("unexpected", ())
    ]
    found = [f"master {name}" for name in listed] + [f"datagrams from {source}" for source in heard]
    return Judgement(WARNING if found else OK, "only computers of the fleet", ", ".join(found) or "only those")


def _topic_heard(case: Case) -> Judgement | None:
    target = case.run.get(case.target)
    if case.probe is None or target is None or _without_ros(case.observer) or _declared_away(case):
        return None
    entry = case.observer.topics.get(case.target)
    if entry is None:
        # A talker that never was is no fault of this pair.
        silent = target.seen.unreachable or (target.seen.probe is not None and _without_ros(target))
        return None if silent else Judgement(FAILED, "its message", "not listened to")
    expected = f"a message on {entry['topic']}"
    if not entry["heard"] and _filtered(case, entry["topic"]):
        return Judgement(UNKNOWN, expected, "the topic is left out by multimaster_filters")
    return (
        Judgement(OK, expected, "heard") if entry["heard"] else Judgement(FAILED, expected, entry["error"] or "nothing")
    )


def _filtered(case: Case, topic: str) -> bool:
    """Whether what passes between the two robots leaves the topic out."""
    own, its = case.robots
    talker = Item("publisher", topic, TALKER_NODE + topic.rpartition("/")[2])
    return own != its and not case.exchanges.flows.rules(its, own).passes(talker, TALKER_TYPE)


def _declared_away(case: Case) -> bool:
    """Whether the target's robot declares that it gives the observer's nothing."""
    own, its = case.robots
    return own != its and case.exchanges.flows.declared_away(its, own)


def _same_robot(case: Case) -> bool:
    return case.planned["robot"] == case.observer.plan["robot"]


def _direct_connection(case: Case) -> Judgement | None:
    entry = case.observer.topics.get(case.target)
    if entry is None or not entry["publishers"]:
        return None
    names = {case.target.lower(), case.address, *case.layout.names.get(case.address, ())}
    hosts = [_host(publisher["uri"]) for publisher in entry["publishers"]]
    found = ", ".join(publisher["uri"] or f"{publisher['node']} without a URI" for publisher in entry["publishers"])
    return Judgement(
        OK if all(host in names for host in hosts) else FAILED, f"the publisher is on {case.target}", found
    )


def _nodes_answer(case: Case) -> Judgement | None:
    if case.exchange is None or case.exchange["error"]:
        return None
    silent = case.exchange["silent"]
    found = f"no answer of {_some(silent)}" if silent else "they answer"
    return Judgement(WARNING if silent else OK, "every node that is registered answers", found)


def _names(case: Case) -> Judgement | None:
    if not _both_seen(case):
        return None
    own, its = case.robots
    clashes = case.exchanges.clashes(its, own)
    found = _some(f"the {clash.kind} {clash.name} is of {' and of '.join(clash.robots)}" for clash in clashes)
    return Judgement(FAILED if clashes else OK, "each name once", found or "no name twice")


def _types(case: Case) -> Judgement | None:
    if not _both_seen(case):
        return None
    own, its = case.robots
    conflicts, expected = case.exchanges.conflicts(its, own), "each topic has one type"
    if conflicts:
        return Judgement(FAILED, expected, _some(map(_told, conflicts)))
    if case.exchange["types_error"]:
        return Judgement(UNKNOWN, expected, f"the md5 sums are not known: {case.exchange['types_error']}")
    return Judgement(OK, expected, "the same types")


def _told(conflict: Conflict) -> str:
    (one, its_type, its_sum), (other, type_name, md5sum) = sorted((conflict.one, conflict.other))
    if its_type != type_name:
        return f"{conflict.topic} is {its_type} on {one} and {type_name} on {other}"
    return f"{conflict.topic} is {type_name} on both, with the md5 sum {its_sum} on {one} and {md5sum} on {other}"


def _both_seen(case: Case) -> bool:
    return case.exchange is not None and all(robot in case.exchanges.robots for robot in case.robots)


def _flow(case: Case) -> Judgement | None:
    if case.exchange is None:
        return None
    own, its = case.robots
    if case.exchange["error"]:
        return Judgement(UNKNOWN, f"what {its} gives", case.exchange["error"])
    missing, superfluous = case.exchanges.missing(its, own), case.exchanges.superfluous(its, own)
    parts = [("not there", missing), ("there against the plan", superfluous)]
    found = "; ".join(f"{words}: {_some(map(str, items))}" for words, items in parts if items)
    return Judgement(FAILED if found else OK, f"what {its} gives to {own}, and nothing else", found or "just that")


def _cross_link(case: Case) -> Judgement | None:
    if case.exchange is None or case.exchange["error"]:
        return None
    crossing = case.exchanges.crossing(case.exchange["connections"], *case.robots)
    found = _some(
        f"{link['node']} {'hears' if link['direction'] == 'in' else 'is heard by'} {link['peer']} of {link['robot']} on {link['topic']}"
        for link in crossing
    )
    return Judgement(FAILED if crossing else OK, "only connections of what is exchanged", found or "only such")


def _some(items: Iterable[str]) -> str:
    """The first ones, and how many more there are."""
    texts = list(items)
    more = f" and {len(texts) - NAMED} more" if len(texts) > NAMED else ""
    return ", ".join(texts[:NAMED]) + more


# How causes are told from each other.


def _always(case: Case) -> bool:
    return True


def _loopback_name(case: Case) -> bool:
    return any(ipaddress.ip_address(address).is_loopback for address in case.member["addresses"])


def _no_address(case: Case) -> bool:
    return not case.member["addresses"]


def _several_addresses(case: Case) -> bool:
    return len(case.member["addresses"]) > 1


def _target_down(case: Case) -> bool:
    computer = case.run.get(case.target)
    return computer is not None and computer.seen.unreachable


def _behind_gateway(case: Case) -> bool:
    return any(case.gateways)


def _inner(case: Case) -> bool:
    return bool(case.observer.plan["robot"]) and not case.observer.plan["common_address"]


def _no_route(case: Case) -> bool:
    return bool(case.member["route"]["error"])


def _other_hop(case: Case) -> bool:
    route = case.member["route"]
    return case.way.crosses and (route["gateway"] or "") not in _hops(case, case.way)


def _refused_on_the_way(case: Case) -> bool:
    return "prohibited" in case.member["ping_address"]["error"]


def _in_a_circle(case: Case) -> bool:
    return "time to live" in case.member["ping_address"]["error"]


def _gateway_finds_nobody(case: Case) -> bool:
    """The gateway of the target's network itself says that nobody has the address there."""
    error, its = case.member["ping_address"]["error"], case.way.its
    return bool(its) and "host unreachable" in error and error.startswith((its.common_address, its.address))


def _nothing_leaves(case: Case) -> bool:
    """The observer reaches its gateway, and nobody behind it."""
    own, answered = case.way.own, case.observer.answered
    if own is None or own.name not in answered:  # a device of another make was not asked
        return False
    return all(case.layout.members[name]["robot"] == case.observer.plan["robot"] for name in answered)


def _nothing_enters(case: Case) -> bool:
    """The target's gateway is reached, but nobody behind it, though the target reaches its gateway."""
    its, target, answered = case.way.its, case.run.get(case.target), case.observer.answered
    if its is None or its.name not in answered:
        return False
    if target is not None and its.name not in target.answered:
        return False
    return not any(name in answered for name in case.layout.inner[case.planned["robot"]])


def _device_passes_nothing_out(case: Case) -> bool:
    """The observer is behind a device of another make, and reaches nobody beyond it."""
    own, answered = case.way.own, case.observer.answered
    if own is None or own.name:
        return False
    return all(case.layout.members[name]["robot"] == case.observer.plan["robot"] for name in answered)


def _device_passes_nothing_in(case: Case) -> bool:
    """The target is behind a device of another make, and the observer reaches nobody behind it."""
    its = case.way.its
    if its is None or its.name:
        return False
    return not any(name in case.observer.answered for name in case.layout.inner[case.planned["robot"]])


def _no_way_back(case: Case) -> bool:
    """The target has no route to any other network."""
    target = case.run.get(case.target)
    ways = [
        member["route"]["error"]
        for name, member in (target.members if target else {}).items()
        if "route" in member and case.layout.members[name]["robot"] != case.planned["robot"]
    ]
    return bool(ways) and all(ways)


def _only_from_outside(case: Case) -> bool:
    """The computers of its own robot reach the target."""
    neighbours = (case.run.get(name) for name in case.layout.robots[case.planned["robot"]])
    return case.way.crosses and any(neighbour and case.target in neighbour.answered for neighbour in neighbours)


def _own_gateway_silent(case: Case) -> bool:
    gateway = case.layout.gateways.get(case.observer.plan["robot"])
    return gateway is not None and gateway.name == case.target


def _crosses(case: Case) -> bool:
    return case.way.crosses


def _leaves_by_gateway(case: Case) -> bool:
    return case.way.own is not None


def _translated_here(case: Case) -> bool:
    """The target's helper has heard this computer, from an address that is not the planned one."""
    entry = case.run[case.target].udp.get(case.observer.name, {})
    seen = (case.udp or {}).get("own_source_address") or entry.get("source_address")
    return seen is not None and seen != case.own["discovery_address"]


def _hears_unicast(case: Case) -> bool:
    return bool(case.udp and case.udp["unicast"])


def _other_interface(case: Case) -> bool:
    return bool(case.udp and case.udp["other_interfaces"])


def _other_source(case: Case) -> bool:
    return bool(case.udp and case.udp["heard_from"] and case.udp["source_address"] != case.address)


def _heard_here(case: Case) -> bool:
    return bool(case.udp and case.udp["heard_from"])


def _send_errors(case: Case) -> bool:
    computer = case.run.get(case.target)
    return bool(computer and ((computer.seen.multicast or {}).get("send_errors") or {}).get("count"))


def _refused(case: Case) -> bool:
    return "refused" in case.observer.masters[case.target]["error"].lower()


def _unreachable(case: Case) -> bool:
    return "network is unreachable" in case.observer.masters[case.target]["error"].lower()


def _no_clock(case: Case) -> bool:
    return case.observer.masters[case.target]["clock_offset_s"] is None


def _call_failed(case: Case) -> bool:
    return not case.observer.listed and bool(case.probe["list_masters"]["error"])


def _listed_otherwise(case: Case) -> bool:
    return case.master["name"] in case.observer.listed


def _offline(case: Case) -> bool:
    entry = case.observer.listed.get(case.master["name"])
    return entry is not None and not entry["online"]


def _translated(case: Case) -> bool:
    entry = case.observer.listed.get(case.master["name"])
    return entry is not None and not _monitored(entry, case)


def _port_open(case: Case) -> bool:
    return bool(case.observer.masters.get(case.target, {}).get("open"))


def _talker_ended(case: Case) -> bool:
    computer = case.run.get(case.target)
    return computer is not None and not ((computer.seen.probe or {}).get("talker") or {"running": True})["running"]


def _listener_failed(case: Case) -> bool:
    return case.observer.topics.get(case.target, {"error": ""})["error"].startswith("the listener")


def _not_registered_at_home(case: Case) -> bool:
    return _not_registered(case) and _same_robot(case)


def _only_the_master(case: Case) -> bool:
    """What the computer of the target's roscore says is heard, and what its second computers say is not even known."""
    its_master = case.masters[1]
    return (
        _not_registered(case)
        and case.target != its_master
        and bool(case.observer.topics.get(its_master, {"heard": False})["heard"])
    )


def _not_registered(case: Case) -> bool:
    return not case.observer.topics.get(case.target, {"publishers": ()})["publishers"]


def _publisher_on_loopback(case: Case) -> bool:
    hosts = [_host(publisher["uri"]) for publisher in case.observer.topics[case.target]["publishers"]]
    return any(host == "localhost" or host.startswith("127.") for host in hosts)


def _left_out(case: Case) -> bool:
    entry = case.observer.topics.get(case.target)
    return entry is not None and _filtered(case, entry["topic"])


def _superfluous(case: Case) -> bool:
    own, its = case.robots
    return bool(case.exchanges.superfluous(its, own))


def _nothing_registered(case: Case) -> bool:
    own, its = case.robots
    return not case.exchanges.imported(its, own)


def _exchange_unknown(case: Case) -> bool:
    return bool(case.exchange["error"])


def _types_unknown(case: Case) -> bool:
    own, its = case.robots
    return not case.exchanges.conflicts(its, own)


def _roscore_silent(case: Case) -> bool:
    return bool(case.probe["roscore"]["error"])


def _roscore_on_loopback(case: Case) -> bool:
    host = _host(case.probe["roscore"]["answer"])
    return host == "localhost" or host.startswith("127.")


def _closed_process(case: Case) -> bool:
    return all(not entry["differing"] for entry in case.probe["services"])


def _no_service(case: Case) -> bool:
    return any(entry["load_state"] == "not-found" for entry in case.probe["services"])


# The table, in the order in which one check can explain the next.

CHECKS: tuple[Check, ...] = (
    Check(
        "forwarding",
        "gateways and the router pass packets on",
        COMPUTER,
        _forwarding,
        causes=(
            Cause(
                _always,
                "{observer} drops what is meant for another network, so nobody gets through it",
                "run site.yml; if the value comes back, see on {observer}: grep -r ip_forward /etc/sysctl.* /usr/lib/sysctl.d",
            ),
        ),
    ),
    Check(
        "reachable",
        "computer answers the controller",
        COMPUTER,
        _reachable,
        ("gateway:reachable", "gateway:forwarding"),
        causes=(
            Cause(
                _behind_gateway,
                "switched off, not on its network, or without the way back by its gateway {gateway}",
                "switch it on, and see there: ip route; from the controller try: ping {gateway}, then ping {address}",
            ),
            Cause(
                _always,
                "switched off, not on the network, or the login is refused",
                "switch it on, and try: ansible <computer> -m ansible.builtin.ping",
            ),
        ),
    ),
    Check(
        "services",
        "services are active",
        COMPUTER,
        _services,
        causes=(
            Cause(_no_service, "it was not set up", "run site.yml"),
            Cause(
                _always,
                "a service does not start, or ends by itself",
                "read why there: journalctl -b -u 'multimaster-*'",
            ),
        ),
    ),
    Check(
        "environment",
        "services run with the planned environment",
        COMPUTER,
        _environment,
        ("services",),
        causes=(
            Cause(_closed_process, "root may not look at other processes there, as in some containers", "nothing"),
            Cause(_always, "the file was changed after the service started", "run site.yml"),
        ),
    ),
    Check("measured", "computer could be looked at", COMPUTER, _measured),
    Check(
        "reverse_path",
        "no strict reverse-path filter",
        COMPUTER,
        _reverse_path,
        causes=(
            Cause(
                _always,
                "{observer} drops packets that come in on another interface than the one that leads back to their source",
                "run site.yml, which sets net.ipv4.conf.all.rp_filter to 2; the larger value of all and the interface counts",
            ),
        ),
    ),
    Check(
        "redirects",
        "router sends no redirects",
        COMPUTER,
        _redirects,
        causes=(
            Cause(
                _always,
                "packets turn round on the common network, and each brings its sender an ICMP redirect, which ping takes "
                "for an error",
                "run site.yml, which sets net.ipv4.conf.*.send_redirects to 0; it is sent where all or the interface has 1",
            ),
        ),
    ),
    Check(
        "master_uri",
        "ROS_MASTER_URI means the robot's roscore",
        COMPUTER,
        _master_uri,
        ("services", "master:reachable", "master:services"),
        causes=(
            Cause(
                _roscore_silent,
                "no roscore answers at that URI",
                "start it, and see on {master}: journalctl -b -u multimaster-roscore (or the unit of your own roscore)",
            ),
            Cause(
                _roscore_on_loopback,
                "the roscore was started with a name that only its own computer understands",
                "start it with the environment of the collection (multimaster_roscore: managed does)",
            ),
            Cause(
                _always,
                "the roscore, or the environment file, has another host name than planned",
                "run site.yml; a roscore of your own needs the variables of /etc/rosfleet-multimaster/environment",
            ),
        ),
    ),
    Check(
        "default_routes",
        "one default route at most",
        COMPUTER,
        _default_routes,
        causes=(
            Cause(
                _inner,
                "beside the one by its gateway {gateway} there is another, as DHCP brings it: the lower metric wins, and "
                "packets to other robots may leave there",
                "take the default route from the other interface, or set multimaster_routes to networks for this robot, "
                "so that only the robots' networks go by {gateway}",
            ),
            Cause(
                _always,
                "two interfaces both got a default route",
                "keep the one that leads to the other networks, or give them different metrics",
            ),
        ),
    ),
    Check(
        "name",
        "name means the planned address",
        ITSELF_TOO,
        _name,
        causes=(
            Cause(_no_address, "the name is not known there", "run site.yml, which writes /etc/hosts"),
            Cause(
                _loopback_name,
                "/etc/hosts there binds the name to the loopback interface",
                "run site.yml; if the line comes back, cloud-init writes it: set manage_etc_hosts to false there",
            ),
            Cause(
                _several_addresses,
                "the name has a second address: another line of /etc/hosts, or a name server",
                "remove the line that is not the collection's from /etc/hosts there",
            ),
            Cause(
                _always,
                "another line of /etc/hosts there, or a name server, has an older address",
                "run site.yml, which names the line that stands against it",
            ),
        ),
    ),
    Check(
        "route",
        "packets leave from the planned address",
        MEMBER,
        _route,
        causes=(
            Cause(
                _no_route,
                "{observer} has no way out of its network, so it neither asks nor answers",
                "run site.yml, which sets its routes; see on {observer}: ip route",
            ),
            Cause(
                _other_hop,
                "another route of {observer} comes first: a second default route, as DHCP brings it, or one set by hand",
                "run site.yml, which names it; see on {observer}: ip route",
            ),
            Cause(
                _always,
                "another interface of {observer} has a network that holds {address}, or its own interface is down",
                "see on {observer}: ip route get {address}; ip address; correct the interface or multimaster_address",
            ),
        ),
    ),
    Check(
        "ping_address",
        "ping by address",
        MEMBER,
        _ping_address,
        (
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
                _target_down,
                "{target} does not answer the controller either",
                "switch {target} on, or repair its network",
            ),
            Cause(
                _heard_here,
                "{target} is there, since its datagrams arrive: a firewall drops ICMP",
                "allow ICMP echo requests on {target} and on the access point",
            ),
            Cause(
                _refused_on_the_way,
                "a firewall on the way from {observer} to {target} refuses to pass packets on",
                "let packets between the robots' networks pass there; see: nft list ruleset",
            ),
            Cause(
                _in_a_circle,
                "a gateway or the router on the way sends packets for {address} back to where they came from",
                "run site.yml on all gateways and the router; see there: ip route get {address}",
            ),
            Cause(
                _gateway_finds_nobody,
                "its gateway {its_gateway} is reached, and finds nobody with the address {address}",
                "switch {target} on, or repair its network; see there: ip address",
            ),
            Cause(
                _own_gateway_silent,
                "the gateway of {observer} is off, has another address, or its interface to the robot's network is down",
                "switch {target} on; see there: ip address; nothing of {observer} leaves its network meanwhile",
            ),
            Cause(
                _no_way_back,
                "{target} has no way out of its network, so its answers do not leave it",
                "run site.yml, which sets its routes; see on {target}: ip route",
            ),
            Cause(
                _nothing_leaves,
                "{gateway} is reached, but passes nothing on between its robot's network and the others: a firewall there "
                "drops forwarded packets, as Docker sets it up",
                "let packets between the robots' networks pass on {gateway}; see there: nft list ruleset; iptables -S FORWARD",
            ),
            Cause(
                _nothing_enters,
                "{its_gateway} is reached, but passes nothing on between its robot's network and the others: a firewall there "
                "drops forwarded packets, as Docker sets it up",
                "let packets between the robots' networks pass on {its_gateway}; see there: nft list ruleset; iptables -S FORWARD",
            ),
            Cause(
                _device_passes_nothing_out,
                "the gateway {gateway}, a device of another make, is off, has another address, or does not pass packets on",
                "switch it on; playbooks/router_config.yml writes what to paste into it (docs/router.md)",
            ),
            Cause(
                _device_passes_nothing_in,
                "the gateway {its_gateway}, a device of another make, is off, has another address, or does not pass packets on",
                "switch it on; playbooks/router_config.yml writes what to paste into it (docs/router.md)",
            ),
            Cause(
                _only_from_outside,
                "{target} answers in its own network: its answers to {observer} do not find back, or its firewall knows its "
                "own network only",
                "see on {target}: ip route; nft list ruleset; and run site.yml on it",
            ),
            Cause(
                _crosses,
                "{target} is off, has another address, or its gateway {its_gateway} does not pass packets on",
                "see on {target}: ip address; ip route; on {its_gateway}: ip route; nft list ruleset",
            ),
            Cause(
                _always,
                "{target} is off, has another address, or the access point keeps its clients apart",
                "see on {target}: ip address; switch off client isolation on the access point",
            ),
        ),
    ),
    Check(
        "ping_name",
        "ping by name",
        MEMBER,
        _ping_name,
        ("name", "ping_address", "target:reachable"),
        causes=(Cause(_always, "the name {target} leads elsewhere", "see on {observer}: getent ahostsv4 {target}"),),
    ),
    Check(
        "udp_multicast",
        "datagrams on the multicast group arrive",
        MEMBER,
        _udp_multicast,
        ("target:reachable", "target:measured", "ping_address"),
        causes=(
            Cause(
                _other_source,
                "addresses are translated on the way from {target} (NAT, a container or virtual machine)",
                "connect {target} by a bridge or the host's network, so that it is seen as {address}",
            ),
            Cause(
                _other_interface,
                "{target} arrives on another interface of {observer} than planned",
                "set multimaster_address of both to addresses of one network",
            ),
            Cause(
                _heard_here,
                "datagrams are lost on the way, as on a weak wireless link",
                "look at the signal; a heartbeat is repeated, so discovery works, but later",
            ),
            Cause(
                _send_errors,
                "the kernel of {target} refuses to send to {group}",
                "look at the firewall of {target}: nft list ruleset",
            ),
            Cause(
                _hears_unicast,
                "{group} is filtered, unicast is not: IGMP snooping without a querier, an access point that "
                "drops multicast, or a firewall",
                "let UDP port {port} to {group} pass, switch IGMP snooping off or a querier on; with "
                "multimaster_transport: both the robots find each other meanwhile",
            ),
            Cause(
                _always,
                "a firewall drops UDP port {port}, or the two are not in one network",
                "allow UDP port {port} on {target}, on {observer} and between them",
            ),
        ),
    ),
    Check(
        "udp_unicast",
        "datagrams to the computer arrive",
        MEMBER,
        _udp_unicast,
        ("target:reachable", "target:measured", "ping_address"),
        causes=(
            Cause(
                _translated_here,
                "addresses are translated on the way (NAT): {target} sees {observer} from another address",
                "let no gateway translate addresses (masquerade) between the robots' networks; see there: nft list ruleset",
            ),
            Cause(
                _always,
                "a firewall drops UDP port {port} to {target}, or the answer to {observer}",
                "allow UDP port {port} in both directions between {observer} and {target}",
            ),
        ),
    ),
    Check(
        "source",
        "datagrams arrive from the planned address",
        MEMBER,
        _source,
        ("target:reachable", "target:measured", "observer:measured", "ping_address"),
        causes=(
            Cause(
                _leaves_by_gateway,
                "the gateway {gateway} translates addresses (masquerading), or drops UDP port {port}",
                "translate nothing between the robots' networks; see on {gateway}: nft list ruleset; iptables -t nat -S",
            ),
            Cause(
                _always,
                "addresses are translated on the way from {observer} to {target} (NAT), or UDP port {port} is dropped",
                "translate nothing between the robots' networks, and let UDP port {port} pass",
            ),
        ),
    ),
    Check(
        "icmp_rounds",
        "ping of the multicast group (informs only)",
        MEMBER,
        _icmp_rounds,
        ("target:reachable", "ping_address"),
        causes=(
            Cause(
                _heard_here,
                "{target} does not answer pings of a group; discovery does not depend on it",
                "if you want the answers: run site.yml on {target}, which sets net.ipv4.icmp_echo_ignore_broadcasts",
            ),
            Cause(_always, "multicast does not reach {target}", "see the check of datagrams on the group"),
        ),
    ),
    Check(
        "rpc_port",
        "port of the discovery node opens",
        MASTER_TOO,
        _rpc_port,
        ("target:reachable", "target:services", "ping_address"),
        causes=(
            Cause(
                _unreachable,
                "{observer} has no route to {address}, the address of {target} on the common network",
                "run site.yml, which sets its routes; see on {observer}: ip route",
            ),
            Cause(
                _refused,
                "no discovery node listens on TCP port {port} of {target}",
                "see on {target}: systemctl status multimaster-discovery; ss -ltnp",
            ),
            Cause(
                _always,
                "a firewall drops TCP port {port} of {target}, or {address} is not reached",
                "allow TCP port {port} on {target}, and all TCP ports above 1024 for the nodes",
            ),
        ),
    ),
    Check(
        "clock",
        "clocks agree",
        MASTER,
        _clock,
        ("rpc_port",),
        causes=(
            Cause(
                _no_clock,
                "what listens on TCP port {port} of {target} is no discovery node that answers",
                "see on {target}: ss -ltnp; journalctl -b -u multimaster-discovery",
            ),
            Cause(
                _always,
                "the clocks of {observer} and {target} are not synchronised",
                "run chrony on all computers with one of them, or a server, as the source",
            ),
        ),
    ),
    Check(
        "list_masters",
        "rosservice call /master_discovery/list_masters",
        MASTER_TOO,
        _list_masters,
        (
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
                _call_failed,
                "the service of the discovery node on {master} cannot be called there",
                "see on {master}: systemctl status multimaster-discovery; on {observer}: rosservice list",
            ),
            Cause(
                _offline,
                "{master} has known {target}, and no longer hears it",
                "see on {target}: systemctl status multimaster-discovery",
            ),
            Cause(
                _translated,
                "{master} sees {target} from another address: addresses are translated on the way (NAT)",
                "connect {target} by a bridge or the host's network, so that it is seen as {address}",
            ),
            Cause(
                _listed_otherwise,
                "the roscore of {target} calls itself otherwise than planned",
                "run site.yml on {target}; a roscore of your own needs the collection's ROS_HOSTNAME or ROS_IP",
            ),
            Cause(
                _port_open,
                "the TCP port of {target} opens, but its heartbeats do not reach the discovery node of {master}",
                "run site.yml, so that both use one group and port; see: journalctl -b -u multimaster-discovery",
            ),
            Cause(
                _always,
                "the discovery nodes of {master} and {target} do not find each other",
                "allow UDP port {port} and the discovery node's TCP port between them",
            ),
        ),
    ),
    Check(
        "topic_heard",
        "subscriber hears the other's talker",
        MEMBER,
        _topic_heard,
        (
            "target:reachable",
            "target:measured",
            "observer:services",
            "master:services",
            "target:services",
            "its master:services",
            "observer:master_uri",
            "target:master_uri",
            "to its master:list_masters",
            "between masters:list_masters",
            "name",
            "back:name",
            "ping_address",
        ),
        causes=(
            Cause(
                _left_out,
                "multimaster_filters of the robot of {observer} leave the test topic out",
                "nothing, if that is wanted; to have it tested, ignore less than everything",
            ),
            Cause(
                _talker_ended,
                "the talker on {target} does not run, so rostopic pub fails there, or verify_lifetime was too short",
                "see on {target}: journalctl -u multimaster-verify-talker; with many computers raise verify_lifetime",
            ),
            Cause(
                _listener_failed,
                "the subscriber on {observer} gave no result: the computer is overloaded, or rospy fails there",
                "try on {observer}: rostopic echo /rosout; with many computers raise verify_patience",
            ),
            Cause(
                _not_registered_at_home,
                "the talker on {target} has not registered with the roscore on {master}",
                "see on {target}: journalctl -u multimaster-verify-talker; rosnode list",
            ),
            Cause(
                _only_the_master,
                "{master} takes over the topics of {its_master}, but not those of {target}: its sync node, or the discovery node "
                "of {its_master}, leaves nodes of a robot's second computers out, as upstream's do unless told otherwise",
                "run site.yml, which installs the collection's nodes; with upstream's, set sync_remote_nodes to true",
            ),
            Cause(
                _not_registered,
                "the sync node on {master} has not registered the topics of {target}",
                "see on {master}: journalctl -b -u multimaster-sync; rosservice call /master_sync/get_sync_info",
            ),
            Cause(
                _always,
                "the topic is known, but no connection to its publisher opens: a firewall drops the TCP ports of nodes",
                "allow all TCP ports above 1024 between {observer} and {target}, in both directions",
            ),
        ),
    ),
    Check(
        "direct_connection",
        "rostopic info shows a direct connection",
        MEMBER,
        _direct_connection,
        causes=(
            Cause(
                _publisher_on_loopback,
                "nodes of {target} call themselves localhost",
                "run site.yml on {target}, and remove ROS_HOSTNAME=localhost from its shells' files",
            ),
            Cause(
                _always,
                "the publisher runs elsewhere, or calls itself otherwise than planned",
                "run site.yml on {target}, so that its nodes have the collection's ROS_HOSTNAME or ROS_IP",
            ),
        ),
    ),
    Check(
        "nodes_answer",
        "registered nodes answer",
        COMPUTER,
        _nodes_answer,
        ("master_uri",),
        causes=(
            Cause(
                _always,
                "they ended without saying so, as by kill -9 or a loss of power, and the roscore still hands out their addresses",
                "run on {observer}: rosnode cleanup; a node that hangs must be ended first",
            ),
        ),
    ),
    Check(
        "names",
        "no node or service name twice",
        MASTER,
        _names,
        causes=(
            Cause(
                _always,
                "one name, two nodes: a roscore holds one of them, so the collection's nodes refuse the second, and upstream's end the "
                "first",
                "give one of them another name or a namespace of its robot, or leave it out by multimaster_exports or "
                "multimaster_filters",
            ),
        ),
    ),
    Check(
        "types",
        "topics have the same type on both sides",
        MASTER,
        _types,
        causes=(
            Cause(
                _types_unknown,
                "the Python of ROS on {observer} does not tell the classes of its message types",
                "try on {observer}: rosmsg md5 std_msgs/String",
            ),
            Cause(
                _always,
                "subscribers and publishers of different types do not connect, so the collection's nodes refuse the topic of the "
                "other robot",
                "install the same version of the message package on both, or give one of the topics another name",
            ),
        ),
    ),
    Check(
        "flow",
        "robot has what it is to get, and nothing else",
        MASTER,
        _flow,
        (
            "target:reachable",
            "observer:services",
            "target:services",
            "master_uri",
            "rpc_port",
            "list_masters",
            "topic_heard",
        ),
        causes=(
            Cause(
                _exchange_unknown,
                "the sync node on {observer} does not tell what it has registered",
                "see on {observer}: rosservice call /master_sync/get_sync_info",
            ),
            Cause(
                _superfluous,
                "the sync node on {observer} or the discovery node on {target} runs with other parameters, or is not one that can leave "
                "this out",
                "run site.yml on both robots; docs/providers.md says what upstream's nodes cannot leave out",
            ),
            Cause(
                _nothing_registered,
                "the sync node on {observer} has registered nothing of {target}",
                "see on {observer}: journalctl -b -u multimaster-sync; rosservice call /master_sync/get_sync_info",
            ),
            Cause(
                _always,
                "the sync node on {observer} has not registered it, or the discovery node on {target} does not serve it",
                "run site.yml on both robots; see on {observer}: journalctl -b -u multimaster-sync",
            ),
        ),
    ),
    Check(
        "cross_link",
        "connections only as exchanged",
        MASTER,
        _cross_link,
        causes=(
            Cause(
                _always,
                "they connected before the flow was declared, or the roscore of a third robot, which knows both, has brought them "
                "together",
                "start these nodes again; if it comes back, run site.yml on all robots, so that none of them holds another one's "
                "subscribers",
            ),
        ),
    ),
    Check(
        "strangers",
        "nobody else is on the group",
        COMPUTER,
        _strangers,
        causes=(
            Cause(
                _always,
                "another fleet, or a computer that is not in the inventory, uses the same group and port",
                "add it to the inventory, or give this fleet another multimaster_multicast_group or port",
            ),
        ),
    ),
)
TITLES = {check.id: check.title for check in CHECKS}
