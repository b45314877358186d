# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Read the registered results of the tasks of a run as observations. Pure: Ansible's variables in.

The texts of a robot come in here, and they may say anything. Behind this file a text is a planned name, or it has the form of
a name, an address or the like, or it is in quotes. So the checks need not quote, and a sentence of ours has no foreign words.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, TypeVar

from ..._base.plain import Mismatch, from_plain
from ..._base.plain_text import LINE, LONGEST, plain_data, quote
from ..._plan.model import FleetPlan
from ..._plan.preflight import MachineState
from .observations import FilterChains, FilterState, Multicast, Observation, Probe, Streams
from .outcomes import Outcome, list_outcome_keys
from .packed import unpack
from .packet_trace import SeenPackets, SentProbes, TraceObservation, TracePlan

T = TypeVar("T")
LONGEST_TEXT = 500  # characters of one text of a robot
MOST_CAPTURES = 5000  # packets of one computer: more than a listener of ours keeps, of all protocols

#: texts that are without quotes, by the key of a result: lines of `ip` for policy_routing.py, and words of our modules
FORMS = {
    "rules": re.compile(r"[0-9]+: [a-z0-9][A-Za-z0-9 _./:-]*"),
    "closed": re.compile(r"(blackhole|unreachable|prohibit) [A-Za-z0-9 _./:-]*"),
    "table": re.compile(r"[a-z0-9]+ [A-Za-z0-9_.-]+"),
    "file": re.compile(r"/[A-Za-z0-9_./@-]+ line [0-9]+"),
    "how": re.compile(r"was (changed|started)"),
    "active_state": re.compile(r"active|inactive|failed|(de)?activating|reloading|maintenance"),
    "sub_state": re.compile(r"[a-z]+(-[a-z]+)*"),
    "result": re.compile(
        r"success|watchdog|oom-kill|signal|core-dump|exit-code|timeout|protocol|resources|start-limit-hit|exec-condition"
    ),
    "load_state": re.compile(r"loaded|error|masked|not-found|bad-setting|merged|stub"),
    "state": re.compile(r"up|down|unknown|dormant|testing|lowerlayerdown|notpresent|new|answer|established"),
    "direction": re.compile(r"in|out"),
    "kind": re.compile(r"[a-z]+"),
    "about": re.compile(
        r"names|order|ufw|firewalld|docker|libvirtd|fail2ban|table (ip|ip6|inet) [A-Za-z][A-Za-z0-9_.-]*"
    ),
    "when": re.compile(r"([A-Z][a-z]{2} )?[0-9]{4}-[0-9]{2}-[0-9]{2} [0-9:]{8} [A-Z]{2,5}"),
    "chain": re.compile(r"[A-Za-z][A-Za-z0-9_.-]*"),
    "reached": re.compile(r"open"),
    "step": re.compile(r"told|answered|connected"),
    "roscore": re.compile(r"open"),
    "tcp": re.compile(r"refused"),
    **dict.fromkeys(list_outcome_keys(), re.compile("|".join(word.value for word in Outcome))),
    "name_sources": re.compile(r"files|dns|mdns|resolve|myhostname|mymachines|compat|nis|ldap|wins"),
    "name": re.compile(r"interface"),  # a parameter of master_discovery
    "type": re.compile(r"\*|None"),  # of a topic, if the master does not know it
    "destination": re.compile(r"default"),
    **dict.fromkeys(("device", "interface", "incoming", "leaving"), re.compile(r"lo")),
    **dict.fromkeys(("found", "expected"), re.compile(r"up|down|active|inactive|failed")),
    "host": re.compile(r"localhost"),
    "source": re.compile(r"hostname"),
    "starter": re.compile(r"shell|unit|launch|container"),
    "hook": re.compile(r"input|forward|output|postrouting"),
    "policy": re.compile(r"accept|drop"),
    "verdict": re.compile(r"accept|drop|reject|masquerade"),
    "service": re.compile(r"chrony|systemd-timesyncd|ntpd"),
    "protocol": re.compile(r"tcp|udp|icmp|igmp|arp"),
    "counter": re.compile(
        r"[A-Z][A-Za-z]{2,40}|conntrack [a-z_]+|drop reason [A-Z][A-Z0-9_]{1,60}|[a-z0-9]+ (errors|drops) (in|out)"
    ),
}
#: a key of a result is a word of our modules, or a foreign name
KEY = re.compile(r"[a-z][a-z_]*")


def read_observation(
    host: str, variables: Mapping[str, Any], tasks: Mapping[str, Any], names: Collection[str] = ()
) -> Observation:
    """Read the registered results of a computer; the message of the first failure is its problem.

    `tasks` has the names of the variables with the results, and `names` the names of the plan.
    """
    results = [find_result(variables, name) for name in (*tasks["earlier"], tasks["multicast"], tasks["probe"])]
    failures = [entry for entry in results if entry.get("unreachable") or entry.get("failed")]
    problem = quote(failures[0].get("msg", ""), LINE) if failures else ""
    unreachable = any(entry.get("unreachable") for entry in failures)
    try:
        return Observation(
            multicast=read_result(Multicast, variables, tasks["multicast"], "udp", names),
            probe=read_result(Probe, variables, tasks["probe"], "members", names),
            unreachable=unreachable,
            problem=problem,
            packet_filter=read_result(FilterState, variables, tasks.get("packet_filter", ""), "members", names),
            found=read_preflight(variables, tasks.get("plan", ""), names),
            services=read_services(variables, tasks.get("plan", ""), names),
            streams=read_result(Streams, variables, tasks.get("streams", ""), "streams", names),
            filters=read_result(FilterChains, variables, f"{tasks.get('machine', '')}.filters", "chains", names),
            packet_trace=read_packet_trace(host, variables, tasks, names),
        )
    except Mismatch as mismatch:  # a stranger's answer to one computer must not cost the others their report
        return Observation(
            unreachable=unreachable, problem=problem or f"its results cannot be read: {quote(mismatch, LINE)}"
        )


def list_plan_names(fleet: FleetPlan) -> frozenset[str]:
    """List the names in the plan: of computers, masters, robots and services."""
    robots = {plan.robot for plan in fleet.computers.values()} | {master.robot for master in fleet.masters}
    services = {name for plan in fleet.computers.values() for name in plan.all_services}
    return frozenset({*fleet.computers, *robots, *services, *(master.name for master in fleet.masters)})


def read_result(
    kind: type[T], variables: Mapping[str, Any], name: str, component: str, names: Collection[str] = ()
) -> T | None:
    """Read a registered result; None if the task gave no result, or one without this section. Raises Mismatch."""
    result = find_result(variables, name)
    return from_plain(kind, quote_texts(result, names=names)) if component in result else None


def quote_texts(value: Any, key: str = "", names: Collection[str] = ()) -> Any:
    """Return a value with its texts quoted, so that they may be in a sentence. `names` stay as they are."""
    if isinstance(value, str):
        return value if value in names else _quote_text(value, key)
    if isinstance(value, Mapping):
        return {_quote_key(str(name), names): quote_texts(component, name, names) for name, component in value.items()}
    if isinstance(value, (list, tuple)):
        return [quote_texts(component, key, names) for component in value]
    return value


def _quote_key(name: str, names: Collection[str]) -> str:
    return name if name in names or KEY.fullmatch(name) else _quote_text(name, "")


@lru_cache(1 << 16)  # the same texts come from many computers
def _quote_text(text: str, key: str) -> str:
    form = FORMS.get(key)
    return text if form and len(text) <= LONGEST and form.fullmatch(text) else quote(text, LONGEST_TEXT)


class Registered(Mapping[str, Any]):
    """The variables of a host, with registered results as they are.

    Ansible computes a whole variable each time that one asks for it, and the result of a verification has thousands of texts. A result
    has no templates; a variable that is something else, such as a template, is computed.
    """

    def __init__(self, hostvars: Any, host: str) -> None:
        self._host, self._hostvars = host, hostvars
        self._raw: Mapping[str, Any] = getattr(hostvars, "raw_get", hostvars.__getitem__)(host)

    def __getitem__(self, name: str) -> Any:
        """Return a variable."""
        value = self._raw[name]
        return value if isinstance(value, Mapping) else self._hostvars[self._host][name]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names."""
        return iter(self._raw)

    def __len__(self) -> int:
        """Return the number of variables."""
        return len(self._raw)

    def __contains__(self, name: object) -> bool:
        """Return True if the host has this variable; nothing is computed."""
        return name in self._raw


def find_result(variables: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Find a registered result, or with a dot in the name a part of it, also in a packed one; empty if it is missing."""
    first, *others = name.split(".")
    result: Any = variables[first] if first in variables else {}
    result = unpack(result) if isinstance(result, Mapping) else {}  # only the whole: its parts are words of a robot
    for key in others:
        result = result[key] if isinstance(result, Mapping) and key in result else {}
    return result if isinstance(result, Mapping) else {}


def read_packet_trace(
    host: str, variables: Mapping[str, Any], tasks: Mapping[str, Any], names: Collection[str] = ()
) -> TraceObservation | None:
    """Read the packets that a computer sent and saw in the packet trace; None if there was none. Raises Mismatch."""
    plan = from_plain(TracePlan, find_result(variables, tasks.get("follow", "")))  # of the controller: nothing to quote
    if not plan.probes:
        return None
    sent = read_result(SentProbes, variables, tasks.get("sent", ""), "sent", names) or SentProbes()
    packets = read_result(SeenPackets, variables, tasks.get("followed", ""), "seen", names)
    if packets and len(packets.seen) > MOST_CAPTURES:  # no listener of ours keeps so many
        packets = replace(packets, seen=packets.seen[:MOST_CAPTURES], missed=len(packets.seen))
    return TraceObservation(tuple(probe for probe in plan.probes if probe.sender == host), sent.sent, packets)


def read_services(variables: Mapping[str, Any], name: str, names: Collection[str] = ()) -> tuple[str, ...] | None:
    """Read the services that can run there by preflight; None if preflight did not look."""
    values = find_result(variables, name).get("services")
    return tuple(quote_texts(values, names=names)) if isinstance(values, (list, tuple)) else None


def read_preflight(variables: Mapping[str, Any], name: str, names: Collection[str] = ()) -> MachineState | None:
    """Read the findings of preflight from the variable with the computer's plan; None if preflight did not look. Raises Mismatch."""
    plan = find_result(variables, name)
    if "found" not in plan:
        return None
    state = plan["found"]
    # These are sentences of fleet_check, which has quoted the robot's texts in them.
    sentences = {
        component: plain_data(state[component], LINE)
        for component in ("runs", "noted", "overlaps", "warned", "broken_ros")
        if component in state
    }
    lines = {"set_by": plain_data(state["set_by"], LINE)} if "set_by" in state else {}
    return from_plain(MachineState, {**quote_texts(state, names=names), **sentences, **lines})
