# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Since when a part is broken, where a machine tells: pure, a part and what was seen at its place in, a text out."""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import Probe, Service
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.parts import Part

SERVICES = ("roscore", "discovery", "sync")
NAMES = ("/etc/hosts", "/etc/nsswitch.conf")


def since(part: Part, probe: Probe | None) -> str:
    """Say since when; empty where nobody knows."""
    if probe is None:
        return ""
    if part.kind in SERVICES:
        return _of_service([entry for entry in probe.services if entry.name == part.kind], part.mode)
    if part.kind == "service":
        return _of_service([entry for entry in probe.services if entry.unit == part.what], "dead")
    if (part.kind, part.mode) == ("environment", "service"):
        return _of_service([entry for entry in probe.services if entry.differing], "runs")
    if part.kind == "names":
        return "; ".join(f"{entry.path} was changed {entry.when}" for entry in probe.name_files if entry.path in NAMES)
    return ""


def _of_service(services: list[Service], mode: str) -> str:
    """A service that has ended is so since it changed its state; one that runs with something wrong has it since its start."""
    times = [entry.since for entry in services if entry.since]
    if not times:
        return ""
    return f"it ended {times[0]}" if mode == "dead" else f"it was started {times[0]}"
