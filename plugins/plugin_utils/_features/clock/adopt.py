# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The source of time of machines that people set up by hand."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from ipaddress import IPv4Address
from typing import Any

from ..._adopt.facts import MOST
from ..._adopt.hooks import AdoptHooks
from ..._adopt.proposal import Choice, Choices
from ..._adopt.scene import AdoptionScene


def read_time_sources(info: Mapping[str, Any]) -> Iterable[IPv4Address]:
    """Yield the addresses that the clock of a machine follows."""
    for entry in ((info.get("clock") or {}).get("sources") or ())[:MOST]:
        address = str(entry["address"])
        if entry["selected"] and ":" not in address:
            yield IPv4Address(address)


def choose_source(scene: AdoptionScene) -> Choices:
    """Return the machine of a robot that most others follow in time, if there is one."""
    members = [name for group in scene.found.groups for name in sorted(group.members)]
    followed = {
        name: [scene.machines.machine_at(one) for one in scene.machine(name).features.get("clock", ())]
        for name in members
    }
    counted = Counter(at for name, places in followed.items() for at in {*places} if at in members and at != name)
    if not counted:
        return {}
    best = max(counted, key=lambda at: (counted[at], at or ""))
    why = f"{counted[best]} of {len(members)} computers follow its time"
    return {"clock": Choice(scene.name(best or ""), why)}


HOOKS = AdoptHooks(read=lambda info: tuple(read_time_sources(info)), choose=choose_source)
