# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What flows from robot to robot, and the nodes' parameters on both sides of it.

Pure: declarations in, flows and parameters out. One list of flows is the source of both sides, so they agree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.exports import (
    FROM_CLIENT,
    FROM_SERVER,
    Export,
    topics_of,
)

# What the verification publishes while it runs: it crosses wherever anything does.
VERIFICATION_TOPICS = "/multimaster_verify/*"


@dataclass(frozen=True)
class Flow:
    """Each of the givers gives these names to each of `to`; the flows of two robots add up.

    Only declaring robots are givers: without a declaration a robot gives everything to everybody, and has no flows.
    """

    givers: tuple[str, ...]
    to: tuple[str, ...]  # empty: everybody else
    topics: tuple[str, ...]
    services: tuple[str, ...]

    def reaches(self, robot: str) -> bool:
        """Whether the robot is given this by somebody."""
        return robot in self.to if self.to else self.givers != (robot,)


def flows(exports: Mapping[str, Sequence[Export] | None]) -> tuple[Flow, ...]:
    """The flows of a fleet, from what each robot declares; None: nothing declared.

    An action is two of them: its server's topics to the clients, and the clients' to the server.
    """
    found = []
    for robot, entries in exports.items():
        for entry in entries or ():
            topics = entry.topics + topics_of(entry.actions, FROM_SERVER)
            found.append(Flow((robot,), entry.to, topics, entry.services))
            clients = tuple(other for other in entry.to or exports if other != robot and exports.get(other) is not None)
            if entry.actions and clients:
                found.append(Flow(clients, (robot,), topics_of(entry.actions, FROM_CLIENT), ()))
    return tuple(found)


def received(of_fleet: Sequence[Flow], robot: str) -> dict[str, dict[str, list[str]]]:
    """What a robot takes from each declaring robot that gives it something, as the parameters of its master_sync."""
    found: dict[str, dict[str, dict[str, None]]] = {}
    for flow in of_fleet:
        if flow.reaches(robot):
            for giver in flow.givers:
                lists = found.setdefault(giver, {"sync_topics": {}, "sync_services": {}})
                lists["sync_topics"].update(dict.fromkeys(flow.topics))
                lists["sync_services"].update(dict.fromkeys(flow.services))
    return {
        giver: {"sync_topics": [*lists["sync_topics"], VERIFICATION_TOPICS], "sync_services": [*lists["sync_services"]]}
        for giver, lists in found.items()
    }


def served(of_fleet: Sequence[Flow], robot: str, addresses: Mapping[str, Sequence[str]]) -> list[dict[str, Any]]:
    """What a declaring robot gives to which addresses ("*": any), as the parameter `exports` of its master_discovery."""
    return [
        {
            "to": [address for other in flow.to for address in addresses[other]] or ["*"],
            "topics": [*flow.topics, VERIFICATION_TOPICS],
            "services": [*flow.services],
        }
        for flow in of_fleet
        if robot in flow.givers
    ]


def listed(of_fleet: Sequence[Flow], robots: Sequence[str]) -> list[dict[str, list[str]]]:
    """The flows as plain data, the receivers by name."""
    return [
        {
            "from": [*flow.givers],
            "to": [*flow.to] or [robot for robot in robots if robot not in flow.givers],
            "topics": [*flow.topics],
            "services": [*flow.services],
        }
        for flow in of_fleet
    ]
