# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The agreement of the predicted reachability with the one measured under a fault: of the ways that both know. Pure.

The prediction is that of playbooks/predict.yml for now, from what the verification has read of the machines beside it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from ansible_collections.rosfleet.multimaster.plugins.action.fleet_predict import machines
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import from_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import FleetPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._predict import prediction

Way = tuple[str, str, str]  # traffic, observer, target


@dataclass(frozen=True)
class Agreement:
    """The number of ways known to both, and the ways of which the prediction says something else: (way, predicted)."""

    ways: int = 0
    wrong: Sequence[tuple[Way, str]] = ()

    @property
    def share(self) -> float:
        """The share of the ways that agree."""
        return 1 - len(self.wrong) / self.ways if self.ways else 1.0


def agreement(recorded: Mapping[str, Any]) -> Agreement:
    """Compare the prediction for now with what was measured; `recorded` is what callbacks/observations.py keeps."""
    fleet = from_plain(FleetPlan, recorded["fleet"])
    predicted = prediction.predict(fleet, machines(fleet, recorded["registered"], "verify_started.machine"))
    found = dict(measured(recorded["registered"]))
    states = {(pair.traffic, pair.observer, pair.target): pair.now for pair in predicted.pairs}
    known = [way for way in states if way in found and not _another_filter(way, states)]
    wrong = [(way, states[way]) for way in known if states[way] != (prediction.FAILS, prediction.REACHES)[found[way]]]
    return Agreement(len(known), tuple(wrong))


def _another_filter(way: Way, states: Mapping[Way, str]) -> bool:
    """Return True if a packet filter counts: large packets are predicted as those of nodes, and measured as pings."""
    traffic, one, other = way
    return traffic == prediction.LARGE and states[prediction.CONNECTIONS, one, other] != states["ping", one, other]


def measured(registered: Mapping[str, Any]) -> Iterator[tuple[Way, bool]]:
    """List what each computer has measured to the others."""
    for observer, results in registered.items():
        probe = results.get("verify_probe") or {}
        members = {entry["name"]: entry for entry in probe.get("members") or () if entry["name"] != observer}
        for target, member in members.items():
            for name, traffic in (("ping_address", "ping"), ("ping_large", prediction.LARGE)):
                if member.get(name):
                    yield (traffic, observer, target), member[name]["ok"]
        for entry in (probe.get("multicast") or {}).get("udp") or ():
            if entry["unicast"] is not None:
                yield ("heartbeats", observer, entry["name"]), entry["unicast"]
        for topic in probe.get("topics") or ():
            member = members.get(topic["computer"])
            if member and _by_its_address(topic, member):
                yield (prediction.CONNECTIONS, observer, topic["computer"]), topic["heard"]


def _by_its_address(topic: Mapping[str, Any], member: Mapping[str, Any]) -> bool:
    """Return True if a connection was tried to the computer's own address: its talker is registered, and its name is right."""
    hosts = {urlsplit(publisher["uri"]).hostname for publisher in topic["publishers"] if publisher["uri"]}
    return bool(hosts) and hosts <= {member["name"], member["address"]} and member["addresses"] == [member["address"]]
