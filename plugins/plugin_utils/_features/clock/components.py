# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The faults of the clocks of a fleet, where one computer is the source of its time."""

from __future__ import annotations

from ..._verify.components.fault import READ, SITE, ComponentHooks, Fault

HOOKS = ComponentHooks(
    faults={
        ("time_source", "none"): Fault(
            "no time service of {place} answers, so its clock is nobody's",
            f"{SITE}, which starts chrony; see",
            "on {place}: systemctl status chrony; chronyc sources",
            cost=2.0,
            hard=False,
            read=READ,
        ),
        ("time_source", "wrong"): Fault(
            "the clock of {place} follows {what}, not the source of the fleet's time",
            f"{SITE} on it; preflight names a time service that somebody has configured there, which stays as it is",
            "on {place}: chronyc -n sources",
            cost=2.0,
            hard=False,
            what="another one",
            read=READ,
        ),
        ("time_source", "mute"): Fault(
            "{place}, the source of the fleet's time, gives it to nobody",
            f"{SITE} on it; let UDP port 123 pass there; see",
            "on {place}: chronyc -n tracking; chronyc serverstats; nft list ruleset",
            hard=False,
        ),
    }
)
