# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The one table of faults: (kind, mode) -> its row, in the order of the areas. Ids are stable: released ones keep their meaning."""

from __future__ import annotations

from collections.abc import Mapping

from .._base.features import load_hooks
from .computer import COMPUTER
from .fault import ComponentHooks, Fault, Key, change, on, site_of_all
from .filters import FILTERS, GATEWAYS
from .foreseen import LOSSES, PREDICTIONS, SUMMARIES
from .network import INTERFACES, LINKS, NAMES
from .people import NODES, REGISTRATIONS
from .routing import ROUTING
from .services import SERVICES

CLOCKS: Mapping[Key, Fault] = {
    ("clock", "off"): Fault(
        "RF-601",
        "the clock of {place} is {what}",
        do=(
            on("chronyc makestep", "if chrony keeps its clock"),
            change("set multimaster_clock to the name of a computer", "the clocks of all others follow its clock then"),
            site_of_all(),
        ),
        look=(on("chronyc tracking; chronyc -n sources; date --utc +%T.%N"),),
        what="wrong",
        why="both clocks were compared",
    ),
}

#: The additions of the features.
HOOKS = tuple(load_hooks("components", ComponentHooks).values())
#: The faults that verify can find.
FAULTS: Mapping[Key, Fault] = {
    **COMPUTER,
    **NAMES,
    **INTERFACES,
    **LINKS,
    **ROUTING,
    **GATEWAYS,
    **FILTERS,
    **SERVICES,
    **NODES,
    **REGISTRATIONS,
    **CLOCKS,
    **{key: fault for hooks in HOOKS for key, fault in hooks.faults.items()},
}
#: The faults that verify, predict and watch can find.
TABLE: Mapping[Key, Fault] = {**FAULTS, **PREDICTIONS, **LOSSES, **SUMMARIES}
#: hundreds of an id -> the area
AREAS: Mapping[str, str] = {
    "1": "the computer and its settings",
    "2": "names, links, networks and routes",
    "3": "packet filters",
    "4": "roscore, discovery, sync and relay",
    "5": "people's nodes, topics and shells",
    "6": "the clock and the tunnel",
    "7": "predict: after site.yml",
    "8": "watch: the losses",
}
