# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Since when a part is broken, where a machine tells: pure, a part and what was seen at its place in, a text out.

A service has a time of its own. The kernel notes none for its settings, routes and filters: there the files that decide
them, and the last start of the computer, bound it.
"""

from __future__ import annotations

from collections.abc import Iterable

from .._case.parts import Part
from .._observed.observations import Probe, Service

SERVICES = ("roscore", "discovery", "sync")
# Kind of part -> which changes of the computer bound the time; a kind with a mode goes before the kind alone.
BOUNDS = {
    ("names", ""): ("names",),
    ("boot", "names"): ("names",),
    ("boot", "sysctl"): ("settings",),
    ("boot", "route"): ("network",),
    ("forwarding", "off"): ("settings", "start"),
    ("reverse_path", ""): ("settings", "start"),
    ("redirects", ""): ("settings", "start"),
    ("setting", "icmp_group"): ("settings", "start"),
    ("route", ""): ("network", "start"),
    ("interface", "address"): ("network", "start"),
    ("interface", "prefix"): ("network", "start"),
    ("interface", "mtu"): ("network", "start"),
    ("filter", ""): ("filter", "start"),
    ("translation", ""): ("filter", "start"),
    ("forwarding", "large"): ("filter", "start"),
    ("link", "down"): ("start",),
}


def describe_onset(part: Part, probe: Probe | None) -> str:
    """Say since when; empty where it is not known."""
    if probe is None:
        return ""
    if part.kind in SERVICES:
        return _service_time([entry for entry in probe.services if entry.name == part.kind], part.mode)
    if part.kind == "service":
        return _service_time([entry for entry in probe.services if entry.unit == part.what], "dead")
    if (part.kind, part.mode) == ("environment", "service"):
        return _service_time([entry for entry in probe.services if entry.differing], "runs")
    told = [*(_link_history(probe) if part.kind == "link" else ()), *_bounds(part, probe)]
    return "; ".join(told)


def _service_time(services: list[Service], mode: str) -> str:
    """A service that has ended is so since it changed its state; one that runs with something wrong has it since its start."""
    times = [entry.since for entry in services if entry.since]
    if not times:
        return ""
    return f"it ended {times[0]}" if mode == "dead" else f"it was started {times[0]}"


def _link_history(probe: Probe) -> Iterable[str]:
    """Return the last word of the journal about an interface that is down, and how often a link came and went."""
    for entry in probe.forwarding.interfaces:
        if entry.last:
            yield f"the journal's last line about {entry.interface}: {entry.last}"
        elif (entry.carrier_changes or 0) > FEW:
            yield f"the link of {entry.interface} came or went {entry.carrier_changes} times"


FEW = 4  # changes of a link that are usual: it comes when the computer starts


def _bounds(part: Part, probe: Probe) -> Iterable[str]:
    wanted = BOUNDS.get((part.kind, part.mode)) or BOUNDS.get((part.kind, ""), ())
    for about in wanted:
        yield from (f"{entry.what} {entry.how} {entry.when}" for entry in probe.changes if entry.about == about)
