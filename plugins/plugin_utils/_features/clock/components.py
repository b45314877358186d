# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The faults of the clocks of a fleet, if one computer is the source of its time."""

from __future__ import annotations

from ..._faults.fault import READ, ComponentHooks, Fault, hand, on, site

HOOKS = ComponentHooks(
    kinds={"time_source": "The clocks of the fleet drift apart, some seconds in a day."},
    faults={
        ("time_source", "none"): Fault(
            "RF-602",
            "no time service of {place} answers, so its clock is nobody's",
            do=(site("starts chrony"),),
            look=(on("systemctl status chrony; chronyc -n sources"),),
            cost=2.0,
            why="programs end, and are switched off",
            hard=False,
            read=READ,
        ),
        ("time_source", "wrong"): Fault(
            "RF-603",
            "the clock of {place} follows {what}, not the source of the fleet's time",
            do=(site("gives it the source; preflight names a user-managed time service there, which stays as it is"),),
            look=(on("chronyc -n sources; systemctl list-units '*ntp*' '*timesyncd*' '*chrony*'"),),
            cost=2.0,
            why="distributions bring a time service with sources of their own",
            hard=False,
            what="another one",
            read=READ,
        ),
        ("time_source", "mute"): Fault(
            "RF-604",
            "{place}, the source of the fleet's time, gives it to nobody",
            do=(
                site("lets it answer the fleet"),
                hand("accept UDP port 123 there, in the program that makes its packet filter"),
            ),
            look=(on("chronyc -n tracking; chronyc serverstats; nft list ruleset"),),
            why="one computer that hears nothing is more frequent",
            hard=False,
        ),
    },
)
