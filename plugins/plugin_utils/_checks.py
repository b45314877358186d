# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# Private to this collection: may change at any time.

"""What must hold in a fleet that talks, and why it does not where it does not: checks as data over observations.

Pure: the plan of `fleet_plan` and what `multicast_verify` and `multimaster_verify` returned in, findings out.
Every observation is looked at once, so the cost grows with the number of observations.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple
from urllib.parse import urlsplit

OK, WARNING, FAILED, UNKNOWN = "ok", "warning", "failed", "unknown"
VERDICTS = (OK, WARNING, FAILED, UNKNOWN)

# Seconds that two clocks may differ: tf extrapolates and messages are dropped from some tenths on.
CLOCK_WARNING, CLOCK_FAILED = 0.1, 0.5
LOSS = 0.05  # the share of datagrams that may be lost
TALKER_TYPE = "std_msgs/String"

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
    """A cause, what to do, and how it is told; texts may have {observer}, {target}, {address}, {port} and {group}."""

    when: Callable[[Case], bool]
    cause: str
    remedy: str


@dataclass(frozen=True)
class Check:
    """A check: for whom, its judge (None where nothing is to be judged), what explains its failure, causes in order.

    `explained_by` names checks, of this pair, of the observer ("observer:...") or of the target ("target:...").
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
        )


@dataclass
class Case:
    """What a judge sees: the fleet, the observer, and the target (a member or a master of the plan)."""

    fleet: Mapping[str, Any]
    observer: Computer
    target: str
    address: str
    master: Mapping[str, Any] | None
    run: Mapping[str, Computer]  # the computers of this run

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


def evaluate(fleet: Mapping[str, Any], observations: Mapping[str, Observation]) -> Iterator[Finding]:
    """Every check of every computer of the run, and of every pair whose observer is in the run, check by check.

    `fleet` is the return of `fleet_plan`; `observations` has an entry for each computer of the run.
    """
    run = {
        name: Computer.of(name, plan, observations[name])
        for name, plan in fleet["computers"].items()
        if name in observations
    }
    members = [(entry["name"], entry["address"], None) for entry in fleet["members"]]
    masters = [(entry["computer"], entry["address"], entry) for entry in fleet["masters"]]
    bad: set[tuple[str, str, str]] = set()  # (check, observer, target)
    for check in CHECKS:
        for computer in run.values():
            if check.scope == COMPUTER:
                targets = [(computer.name, computer.plan["address"], None)]
            else:
                targets = members if check.scope in (MEMBER, ITSELF_TOO) else masters
            for target, address, master in targets:
                if target == computer.name and check.scope in (MEMBER, MASTER):
                    continue
                finding = _finding(check, Case(fleet, computer, target, address, master, run), bad)
                if finding is not None:
                    if finding.verdict == FAILED:
                        bad.add((check.id, finding.observer, finding.target))
                    yield finding


def _finding(check: Check, case: Case, bad: set[tuple[str, str, str]]) -> Finding | None:
    judgement = check.judge(case)
    if judgement is None:
        return None
    verdict, expected, found = judgement
    observer, target = case.observer.name, case.target
    if verdict == OK:
        return Finding(check.id, observer, target, OK, expected, found)
    because = next((other for other in check.explained_by if _where(other, observer, target) in bad), "")
    # What only follows from another failure has that one's cause.
    cause = None if because else next((cause for cause in check.causes if cause.when(case)), None)
    words = {
        "observer": observer,
        "target": target,
        "address": case.address,
        "port": case.master["rpc_port"] if case.master else case.fleet["multicast_port"],
        "group": case.fleet["multicast_group"],
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


def _where(reference: str, observer: str, target: str) -> tuple[str, str, str]:
    side, _separator, check = reference.rpartition(":")
    whom = {"": (observer, target), "observer": (observer, observer), "target": (target, target)}[side]
    return (check, *whom)


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
    if seen.probe is None or seen.multicast is None or seen.problem:
        problems.insert(0, seen.problem or "one of the two measurements gave no result")
    return Judgement(
        FAILED if problems else OK, "results of both measurements", " ".join(problems).rstrip(".") or "both"
    )


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
    if case.probe is None or _without_ros(case):
        return None
    expected = next(master["uri"] for master in case.fleet["masters"] if master["robot"] == case.observer.plan["robot"])
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


def _without_ros(case: Case) -> bool:
    """A second computer of a robot may be without ROS; the master's computer may not."""
    return not case.observer.plan["is_master"] and not case.probe["roscore"]["uri"]


def _same_uri(one: str, other: str) -> bool:
    return one.rstrip("/").lower() == other.rstrip("/").lower()


def _default_routes(case: Case) -> Judgement | None:
    if case.probe is None:
        return None
    routes = case.probe["default_routes"]
    found = ", ".join(f"{route['gateway'] or 'no gateway'} on {route['device']}" for route in routes) or "none"
    return Judgement(OK if len(routes) <= 1 else WARNING, "one default route at most", found)


def _name(case: Case) -> Judgement | None:
    if not case.member:
        return None
    addresses = case.member["addresses"]
    found = ", ".join(addresses) or case.member["resolve_error"]
    return Judgement(OK if addresses == [case.address] else FAILED, case.address, found)


def _route(case: Case) -> Judgement | None:
    if not case.member:
        return None
    route, own = case.member["route"], case.observer.plan["address"]
    if route["error"]:
        return Judgement(FAILED, f"a route from {own}", route["error"])
    via = f" by {route['gateway']}" if route["gateway"] else ""
    found = f"on {route['device']} from {route['source']}{via}"
    return Judgement(OK if route["source"] == own else FAILED, f"a route from {own}", found)


def _ping_address(case: Case) -> Judgement | None:
    return _ping(case.member.get("ping_address"), f"an answer of {case.address}")


def _ping_name(case: Case) -> Judgement | None:
    return _ping(case.member.get("ping_name"), f"an answer of {case.target}")


def _ping(ping: Mapping[str, Any] | None, expected: str) -> Judgement | None:
    if ping is None:
        return None
    return Judgement(OK, expected, f"{ping['rtt_ms']} ms") if ping["ok"] else Judgement(FAILED, expected, ping["error"])


def _udp_multicast(case: Case) -> Judgement | None:
    if case.udp is None or case.fleet["transport"] == "unicast":
        return None
    udp = case.udp
    expected = f"datagrams on {case.fleet['multicast_group']}:{case.fleet['multicast_port']} from {case.address}"
    if not udp["heard_from"]:
        elsewhere = f"none, but on {', '.join(udp['other_interfaces'])}" if udp["other_interfaces"] else "none"
        return Judgement(_other_leg(case, udp["unicast"]), expected, elsewhere)
    if udp["source_address"] != case.address:
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


def _other_leg(case: Case, other: bool | None) -> str:
    """With the transport `both`, the discovery nodes find each other as long as one of the two ways works."""
    return WARNING if case.fleet["transport"] == "both" and other else FAILED


def _icmp_rounds(case: Case) -> Judgement | None:
    icmp = (case.observer.seen.multicast or {}).get("icmp")
    if not icmp or case.target not in case.run or not _answers_broadcasts(case.run[case.target].plan):
        return None  # by plan it does not answer: the kernel's default, and no harm
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
    if case.probe is None or _without_ros(case):
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
    return (
        host in (case.address, "localhost", "127.0.0.1") if case.target == case.observer.name else host == case.address
    )


def _host(uri: str) -> str:
    return (urlsplit(uri).hostname or "").lower()


def _strangers(case: Case) -> Judgement | None:
    if case.probe is None:
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
    if case.probe is None or case.target not in case.run or _without_ros(case):
        return None
    entry = case.observer.topics.get(case.target)
    if entry is None:
        # A talker that never was is no fault of this pair.
        return None if case.run[case.target].seen.unreachable else Judgement(FAILED, "its message", "not listened to")
    expected = f"a message on {entry['topic']}"
    if not entry["heard"] and _filtered(case, entry["topic"]):
        return Judgement(UNKNOWN, expected, "the topic is left out by multimaster_filters")
    return (
        Judgement(OK, expected, "heard") if entry["heard"] else Judgement(FAILED, expected, entry["error"] or "nothing")
    )


def _filtered(case: Case, topic: str) -> bool:
    """Whether a filter of the observer's robot that ignores leaves the topic out; the plan lets it pass white lists."""
    master = next(entry for entry in case.fleet["masters"] if entry["robot"] == case.observer.plan["robot"])
    rules = case.fleet["computers"][master["computer"]]["sync"]

    def matches(rule: str, value: str) -> bool:
        patterns = [pattern for pattern in rules.get(rule, ()) if isinstance(pattern, str)]
        return any(re.fullmatch(pattern.strip().replace("*", ".*"), value, re.IGNORECASE) for pattern in patterns)

    name = case.master["name"]
    return bool(
        (matches("ignore_hosts", name) and not matches("sync_hosts", name))
        or (rules.get("sync_hosts") and not rules.get("ignore_hosts") and not matches("sync_hosts", name))
        or any(matches(rule, topic) for rule in ("ignore_topics", "ignore_publishers"))
        or matches("ignore_type", TALKER_TYPE)
        or matches("ignore_nodes", "/rostopic_1_1")
    )


def _direct_connection(case: Case) -> Judgement | None:
    entry = case.observer.topics.get(case.target)
    if entry is None or not entry["publishers"]:
        return None
    names = {case.target.lower(), case.address, *_aliases(case)}
    hosts = [_host(publisher["uri"]) for publisher in entry["publishers"]]
    found = ", ".join(publisher["uri"] or f"{publisher['node']} without a URI" for publisher in entry["publishers"])
    return Judgement(
        OK if all(host in names for host in hosts) else FAILED, f"the publisher is on {case.target}", found
    )


def _aliases(case: Case) -> list[str]:
    return [
        name.lower()
        for entry in case.fleet["hosts_entries"]
        if entry["address"] == case.address
        for name in entry["names"]
    ]


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


def _not_registered(case: Case) -> bool:
    return not case.observer.topics.get(case.target, {"publishers": ()})["publishers"]


def _publisher_on_loopback(case: Case) -> bool:
    hosts = [_host(publisher["uri"]) for publisher in case.observer.topics[case.target]["publishers"]]
    return any(host == "localhost" or host.startswith("127.") for host in hosts)


def _left_out(case: Case) -> bool:
    entry = case.observer.topics.get(case.target)
    return entry is not None and _filtered(case, entry["topic"])


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
        "reachable",
        "computer answers the controller",
        COMPUTER,
        _reachable,
        causes=(
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
        "master_uri",
        "ROS_MASTER_URI means the robot's roscore",
        COMPUTER,
        _master_uri,
        ("services",),
        causes=(
            Cause(
                _roscore_silent,
                "no roscore answers at that URI",
                "start it, and see there: journalctl -b -u multimaster-roscore (or the unit of your own roscore)",
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
        ("target:reachable", "route"),
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
                _always,
                "a firewall drops UDP port {port} to {target}, or the answer to {observer}",
                "allow UDP port {port} in both directions between {observer} and {target}",
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
            "target:services",
            "observer:master_uri",
            "target:master_uri",
            "rpc_port",
            "udp_multicast",
            "udp_unicast",
        ),
        causes=(
            Cause(
                _call_failed,
                "the service of the discovery node cannot be called there",
                "see there: systemctl status multimaster-discovery; rosservice list",
            ),
            Cause(
                _offline,
                "{observer} has known {target}, and no longer hears it",
                "see on {target}: systemctl status multimaster-discovery",
            ),
            Cause(
                _translated,
                "{observer} sees {target} from another address: addresses are translated on the way (NAT)",
                "connect {target} by a bridge or the host's network, so that it is seen as {address}",
            ),
            Cause(
                _listed_otherwise,
                "the roscore of {target} calls itself otherwise than planned",
                "run site.yml on {target}; a roscore of your own needs the collection's ROS_HOSTNAME or ROS_IP",
            ),
            Cause(
                _port_open,
                "the TCP port of {target} opens, but its heartbeats do not reach the discovery node of {observer}",
                "run site.yml, so that both use one group and port; see: journalctl -b -u multimaster-discovery",
            ),
            Cause(
                _always,
                "the discovery nodes of {observer} and {target} do not find each other",
                "allow UDP port {port} and the discovery node's TCP port between them",
            ),
        ),
    ),
    Check(
        "topic_heard",
        "rostopic echo hears the other's talker",
        MASTER,
        _topic_heard,
        (
            "target:reachable",
            "target:measured",
            "observer:services",
            "target:services",
            "observer:master_uri",
            "list_masters",
            "name",
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
                _not_registered,
                "the sync node of {observer} has not registered the topics of {target}",
                "see on {observer}: journalctl -b -u multimaster-sync; rosservice call /master_sync/get_sync_info",
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
        MASTER,
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
