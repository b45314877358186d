# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads what the tasks of a run have registered on each computer, as observations. Pure: Ansible's variables in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.plain_text import LINE, plain, plain_data
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import AsFound
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plain import Mismatch, from_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import (
    Filters,
    Multicast,
    Observation,
    PacketFilter,
    Probe,
    Streams,
)

T = TypeVar("T")


def observation(
    variables: Mapping[str, Any],
    multicast: str,
    probe: str,
    earlier: Sequence[str],
    packet_filter: str = "",
    plan: str = "",
    streams: str = "",
    machine: str = "",
) -> Observation:
    """Read the registered results of one computer; the message of the first one that failed is its problem."""
    results = [registered(variables, name) for name in (*earlier, multicast, probe)]
    bad = [entry for entry in results if entry.get("unreachable") or entry.get("failed")]
    problem = plain(" ".join(str(bad[0].get("msg", "")).split()), LINE) if bad else ""
    unreachable = any(entry.get("unreachable") for entry in bad)
    try:
        return Observation(
            multicast=complete(Multicast, variables, multicast, "udp"),
            probe=complete(Probe, variables, probe, "members"),
            unreachable=unreachable,
            problem=problem,
            packet_filter=complete(PacketFilter, variables, packet_filter, "members"),
            found=as_found(variables, plan),
            services=services(variables, plan),
            streams=complete(Streams, variables, streams, "streams"),
            filters=complete(Filters, variables, f"{machine}.filters", "chains"),
        )
    except Mismatch as found:  # what one computer was told by strangers must not cost the others their report
        return Observation(
            unreachable=unreachable, problem=problem or plain(f"its results cannot be read: {found}", LINE)
        )


def complete(kind: type[T], variables: Mapping[str, Any], name: str, part: str) -> T | None:
    """Read a registered result; None where the task gave none, or not this part. Raises Mismatch."""
    result = registered(variables, name)
    return from_plain(kind, plain_data(result)) if part in result else None


def registered(variables: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return a registered result, or with a dot in the name a part of one; empty where there is none."""
    found: Any = variables
    for key in name.split("."):
        found = found[key] if isinstance(found, Mapping) and key in found else {}
    return found if isinstance(found, Mapping) else {}


def services(variables: Mapping[str, Any], name: str) -> tuple[str, ...] | None:
    """Read which services can run there, as preflight found; None where it did not look."""
    found = registered(variables, name).get("services")
    return tuple(map(str, found)) if isinstance(found, (list, tuple)) else None


def as_found(variables: Mapping[str, Any], name: str) -> AsFound | None:
    """Read what preflight found, out of the variable with the computer's plan; None where there is none. Raises Mismatch."""
    plan = registered(variables, name)
    return from_plain(AsFound, plain_data(plan["found"])) if "found" in plan else None
