# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Data flows from robot to robot: declarations in, flows out.

The nodes' parameters on both sides are made of this one list, so the two sides agree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.exports import (
    FROM_CLIENT,
    FROM_SERVER,
    Export,
    topics_of,
)

# The topics that the verification publishes while it runs: they cross wherever anything does.
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
        """Return True if somebody gives this to the robot."""
        return robot in self.to if self.to else self.givers != (robot,)


def flows(exports: Mapping[str, Sequence[Export] | None]) -> tuple[Flow, ...]:
    """Return the flows of a fleet, from the declaration of each robot; None: nothing declared.

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


def givers(of_fleet: Sequence[Flow], robot: str) -> list[str]:
    """Return the declaring robots that give a robot something."""
    return list(dict.fromkeys(giver for flow in of_fleet if flow.reaches(robot) for giver in flow.givers))
