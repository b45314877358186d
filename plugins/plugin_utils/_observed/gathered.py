# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads what the tasks of a run have registered on each computer, as observations. Pure: Ansible's variables in.

This is the door for the texts of a robot, which may be anybody's: behind it each text is a planned name, has the form of a
name, an address or the like, or it stands in quotes. So no check has to think of it, and no sentence holds words of others as
its own.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache
from typing import Any, TypeVar

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._data.plain import Mismatch, from_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.plain_text import (
    LINE,
    LONGEST,
    plain_data,
    quote,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._observed.observations import (
    Filters,
    Multicast,
    Observation,
    PacketFilter,
    Probe,
    Streams,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import AsFound, FleetPlan

T = TypeVar("T")
MOST = 500  # characters of one text of a robot

#: what may stand without quotes beside names, by the key of a result: lines of `ip` for policy.py, and words of our modules
FORMS = {
    "rules": re.compile(r"[0-9]+: [a-z0-9][A-Za-z0-9 _./:-]*"),
    "closed": re.compile(r"(blackhole|unreachable|prohibit) [A-Za-z0-9 _./:-]*"),
    "table": re.compile(r"[a-z0-9]+ [A-Za-z0-9_.-]+"),
    "file": re.compile(r"/[A-Za-z0-9_./@-]+ line [0-9]+"),
    "what": re.compile(r"the computer"),
    "how": re.compile(r"was (changed|started)"),
    "active_state": re.compile(r"active|inactive|failed|(de)?activating|reloading|maintenance"),
    "sub_state": re.compile(r"[a-z]+(-[a-z]+)*"),
    "load_state": re.compile(r"loaded|error|masked|not-found|bad-setting|merged|stub"),
    "state": re.compile(r"up|down|unknown|dormant|testing|lowerlayerdown|notpresent|new|established"),
    "direction": re.compile(r"in|out"),
    "kind": re.compile(r"[a-z]+"),
    "about": re.compile(r"names|settings|network|filter|start"),
    "reached": re.compile(r"open"),
    "roscore": re.compile(r"open"),
    "tcp": re.compile(r"refused"),
    "name_sources": re.compile(r"files|dns|resolve|myhostname|mymachines|compat|nis|wins"),
    "destination": re.compile(r"default"),
    **dict.fromkeys(("device", "interface", "incoming", "leaving"), re.compile(r"lo")),
    **dict.fromkeys(("found", "expected"), re.compile(r"up|down|active|inactive|failed")),
    "hook": re.compile(r"input|forward|output"),
    "policy": re.compile(r"accept|drop"),
    "verdict": re.compile(r"accept|drop|reject"),
    "protocol": re.compile(r"tcp|udp|icmp|igmp"),
}
#: a key of a result is a word of our modules, or a name of others
KEY = re.compile(r"[a-z][a-z_]*")


def observation(
    variables: Mapping[str, Any],
    multicast: str,
    probe: str,
    earlier: Sequence[str],
    packet_filter: str = "",
    plan: str = "",
    streams: str = "",
    machine: str = "",
    names: Collection[str] = (),
) -> Observation:
    """Read the registered results of one computer; the message of the first one that failed is its problem. `names`: the planned ones."""
    results = [registered(variables, name) for name in (*earlier, multicast, probe)]
    bad = [entry for entry in results if entry.get("unreachable") or entry.get("failed")]
    problem = quote(bad[0].get("msg", ""), LINE) if bad else ""
    unreachable = any(entry.get("unreachable") for entry in bad)
    try:
        return Observation(
            multicast=complete(Multicast, variables, multicast, "udp", names),
            probe=complete(Probe, variables, probe, "members", names),
            unreachable=unreachable,
            problem=problem,
            packet_filter=complete(PacketFilter, variables, packet_filter, "members", names),
            found=as_found(variables, plan, names),
            services=services(variables, plan, names),
            streams=complete(Streams, variables, streams, "streams", names),
            filters=complete(Filters, variables, f"{machine}.filters", "chains", names),
        )
    except Mismatch as found:  # what one computer was told by strangers must not cost the others their report
        return Observation(
            unreachable=unreachable, problem=problem or f"its results cannot be read: {quote(found, LINE)}"
        )


def planned_names(fleet: FleetPlan) -> frozenset[str]:
    """Return the names that the plan gives: of computers, robots and services."""
    robots = {plan.robot for plan in fleet.computers.values()} | {master.robot for master in fleet.masters}
    services = {name for plan in fleet.computers.values() for name in plan.services}
    return frozenset({*fleet.computers, *robots, *services, *(master.name for master in fleet.masters)})


def complete(
    kind: type[T], variables: Mapping[str, Any], name: str, part: str, names: Collection[str] = ()
) -> T | None:
    """Read a registered result; None where the task gave none, or not this part. Raises Mismatch."""
    result = registered(variables, name)
    return from_plain(kind, told(result, names=names)) if part in result else None


def told(value: Any, key: str = "", names: Collection[str] = ()) -> Any:
    """The same value with each of its texts as it may stand in a sentence. `names`: the planned ones, which stay as they are."""
    if isinstance(value, str):
        return value if value in names else _text(value, key)
    if isinstance(value, Mapping):
        return {_key(str(name), names): told(part, name, names) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [told(part, key, names) for part in value]
    return value


def _key(name: str, names: Collection[str]) -> str:
    return name if name in names or KEY.fullmatch(name) else _text(name, "")


@lru_cache(1 << 16)  # a fleet says the same again and again
def _text(text: str, key: str) -> str:
    form = FORMS.get(key)
    return text if form and len(text) <= LONGEST and form.fullmatch(text) else quote(text, MOST)


def registered(variables: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return a registered result, or with a dot in the name a part of one; empty where there is none."""
    found: Any = variables
    for key in name.split("."):
        found = found[key] if isinstance(found, Mapping) and key in found else {}
    return found if isinstance(found, Mapping) else {}


def services(variables: Mapping[str, Any], name: str, names: Collection[str] = ()) -> tuple[str, ...] | None:
    """Read which services can run there, as preflight found; None where it did not look."""
    found = registered(variables, name).get("services")
    return tuple(told(found, names=names)) if isinstance(found, (list, tuple)) else None


def as_found(variables: Mapping[str, Any], name: str, names: Collection[str] = ()) -> AsFound | None:
    """Read what preflight found, out of the variable with the computer's plan; None where there is none. Raises Mismatch."""
    plan = registered(variables, name)
    if "found" not in plan:
        return None
    found = plan["found"]
    # These are sentences of fleet_check, in which what a robot has said is quoted.
    ours = {part: plain_data(found[part], LINE) for part in ("runs", "noted") if part in found}
    return from_plain(AsFound, {**told(found, names=names), **ours})
