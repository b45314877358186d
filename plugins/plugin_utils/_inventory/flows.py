# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Data flows from robot to robot: declarations in, flows out.

The nodes' parameters on both sides are made of this one list, so the two sides agree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .exports import FROM_CLIENT, FROM_SERVER, Export, topics_of
from .filters import matches

# The topics of the verification while it runs. They cross wherever any topic does.
VERIFICATION_TOPICS = "/multimaster_verify/*"
RPC_PORT = 300  # of a discovery node, above that of the roscore
RELAY_PORT = 600  # of a relay, above that of the roscore


@dataclass(frozen=True)
class Flow:
    """Each of the givers gives these names to each of `to`. The flows of two robots add up.

    A robot without a declaration gives everything to every robot, and is in no flow as a giver.
    """

    givers: tuple[str, ...]
    to: tuple[str, ...]  # empty: all others
    topics: tuple[str, ...]
    services: tuple[str, ...]
    parameters: tuple[str, ...] = ()
    namespace: str = ""  # below which the receivers have the parameters

    def reaches(self, robot: str) -> bool:
        """Return True if a giver gives this to the robot."""
        return robot in self.to if self.to else self.givers != (robot,)


def make_flows(exports: Mapping[str, Sequence[Export] | None]) -> tuple[Flow, ...]:
    """Make the flows of a fleet of the declaration of each robot. None: nothing is declared.

    An action is two flows: the topics of its server to the clients, and those of the clients to the server.
    """
    flows = []
    for robot, entries in exports.items():
        for entry in entries or ():
            if entry.namespace and entry.parameters:
                flows.append(Flow((robot,), entry.to, (), (), entry.parameters, entry.namespace))
            if entry.namespace or entry.is_relayed:
                continue
            topics = entry.topics + topics_of(entry.actions, FROM_SERVER)
            flows.append(Flow((robot,), entry.to, topics, entry.services, entry.parameters))
            clients = tuple(other for other in entry.to or exports if other != robot and exports.get(other) is not None)
            if entry.actions and clients:
                flows.append(Flow(clients, (robot,), topics_of(entry.actions, FROM_CLIENT), ()))
    return tuple(flows)


@dataclass(frozen=True)
class PlannedChannel:
    """Topics and services that go from a robot to one other by the relays of the two, and topics that come back.

    The topic /scan of the robot is /kobuki1/scan at the other one, with the namespace /kobuki1, which replaces the base.
    """

    robot: str
    other: str
    entry: Export  # of the robot's declaration
    back: tuple[str, ...]  # topics that come back: those that the other robot gives, and the goals of actions


def find_outer_name(channel: Mapping[str, Any], name: str) -> str:
    """Return the other robot's name of a name or pattern of the robot with the inner ones. `channel`: as the relay has it."""
    return str(channel["as"]) + name[len(channel["base"]) :]


def find_inner_name(channel: Mapping[str, Any], name: str) -> str | None:
    """Return the name on the robot with the inner ones; None if the channel does not carry the name."""
    rest = name[len(channel["as"]) :]
    inside = name.startswith(channel["as"]) and (not rest or rest.startswith("/"))
    return (channel["base"] + rest or None) if inside else None


def list_names(channel: Mapping[str, Any], kind: str, *, given: bool) -> list[str]:
    """Return the inner names of topics or services that the robot of a relay gives by a channel, or those that it takes."""
    if channel["inner"] == given:
        return list(channel[kind])
    return list(channel["back"]) if kind == "topics" else []


def gives(entries: Sequence[Export] | None, robot: str, topic: str) -> bool:
    """Return True if a declaration gives a topic, or all topics of a pattern, to a robot by its own name. None: nothing is declared."""
    reaching = (entry for entry in entries or () if not entry.to or robot in entry.to)
    return entries is None or any(matches(entry.topics, topic) for entry in reaching if not entry.is_relayed)


def make_channels(exports: Mapping[str, Sequence[Export] | None]) -> tuple[PlannedChannel, ...]:
    """Make the channels of a fleet of the declaration of each robot."""
    return tuple(
        PlannedChannel(robot, other, entry, _list_back(robot, entry, exports.get(other)))
        for robot, entries in exports.items()
        for entry in entries or ()
        if entry.is_relayed
        for other in entry.to or exports
        if other != robot
    )


def _list_back(robot: str, entry: Export, others: Sequence[Export] | None) -> tuple[str, ...]:
    """List the topics that come back from a robot with this declaration. Who may call an action has its goals taken."""
    return (
        *(name for name in entry.back if gives(others, robot, entry.rename(name))),
        *topics_of(entry.actions, FROM_CLIENT),
    )


def list_givers(flows: Sequence[Flow], robot: str) -> list[str]:
    """Return the robots with a flow to this one."""
    return list(dict.fromkeys(giver for flow in flows if flow.reaches(robot) for giver in flow.givers))
