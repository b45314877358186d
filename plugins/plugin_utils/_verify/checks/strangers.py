# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The check of strangers: computers outside the fleet on its multicast group."""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.case import Case
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import (
    COMPUTER,
    OK,
    WARNING,
    Cause,
    Check,
    Documented,
    Judgement,
)


def _strangers(case: Case) -> Judgement | None:
    multicast = case.observer.seen.multicast
    if case.probe is None or not (multicast or case.observer.listed):
        return None
    names = {master.name for master in case.fleet.masters}
    listed = sorted(name for name in case.observer.listed if name not in names)
    heard = [f"{entry.address} on {entry.interface}" for entry in (multicast.unexpected if multicast else ())]
    found = [f"master {name}" for name in listed] + [f"datagrams from {source}" for source in heard]
    return Judgement(WARNING if found else OK, "only computers of the fleet", ", ".join(found) or "only those")


STRANGERS = Check(
    id="strangers",
    title="nobody else is on the group",
    scope=COMPUTER,
    judge=_strangers,
    documented=Documented("computer", "nobody else on the group, no other master (warning)"),
    causes=(
        Cause(
            "another fleet, or a computer that is not in the inventory, uses the same group and port",
            "add it to the inventory, or give this fleet another multimaster_multicast_group or port",
        ),
    ),
)


# In the order in which one failure can explain the next.
CHECKS = (STRANGERS,)
