# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The values that the plan and the answers of the computers give to the words of an advice, so that its commands can be pasted. Pure."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import NamedTuple

from ..._base import advice
from ..._plan.model import COMMON
from ..components.component import Component
from .check_context import FleetState


def name_values(component: Component, state: FleetState) -> Mapping[str, str]:
    """Return the known values, by the words of `_faults.fault.UNREAD`; an advice keeps the placeholder of a word that is left out."""
    found: Mapping[str, str] = {**_name_members(component.place, state), **_name_registrations(component, state)}
    if component.place in state.run:
        group = str(state.fleet.multicast_group)
        found = {**found, **_name_neighbour(component, state), "beyond": _find_beyond(component, state), "group": group}
    return {word: text for word, text in found.items() if text}


def _name_neighbour(component: Component, state: FleetState) -> Mapping[str, str]:
    """Name the address of a computer, and another computer of its network with the interface there. Alone, its own interface."""
    own = state.run[component.place]
    network = state.ways.network_of(own.name)
    values = {
        "address": str(own.plan.address),
        "device": _find_device(component.place, component.what or network, state),
        "target": state.ways.addresses.get(component.what, ""),
    }
    if (component.kind, component.mode) != ("interface", "duplicate"):
        return values
    others = (name for name in state.run if name != own.name and state.ways.is_in(name, network))
    seen = ((name, _find_device(name, network, state)) for name in others)
    return {
        **values,
        **next(({"neighbour": name, "device": device} for name, device in seen if device), {"device": ""}),
    }


def _find_device(name: str, network: str, state: FleetState) -> str:
    interface = state.run[name].interface_on.get(network)
    return advice.format_value("device", interface.interface) if interface else ""


def _find_beyond(component: Component, state: FleetState) -> str:
    """Find the address of a computer in the network to which packets go; that of any other robot if the network is not known."""
    robot = state.ways.robot_of(component.place)
    network = component.what if component.kind == "route" else ""
    return next(
        (
            state.ways.addresses[name]
            for name in state.ways.members
            if state.ways.robot_of(name) != robot and network in ("", state.ways.network_of(name))
        ),
        "",
    )


def _name_members(network: str, state: FleetState) -> Mapping[str, str]:
    """Name a computer in a network, and the address there of another one."""
    names = [name for name in state.ways.members if state.ways.is_in(name, network)]
    if not names:
        return {}
    addresses = state.ways.discovery_addresses if network == COMMON else state.ways.addresses
    return {"there": names[0], "other": addresses[names[1]] if len(names) > 1 else ""}


class _Names(NamedTuple):
    """A word of an advice for names that roscores hold, and the names for it: the first few that have the form."""

    word: str
    form: str  # of advice.FORMS
    find: Callable[[Component, Sequence[str], FleetState], Iterable[str]]  # also of robots whose roscores were read
    most: int = 1  # as many as the command takes
    between: str = " "  # our words between two names, as where a command takes one


def _list_topics(component: Component, _robots: Sequence[str], _state: FleetState) -> Iterable[str]:
    """List the first topic of a component, whose text is a topic, or a list of topics, or of sentences that begin with one."""
    return [component.what.partition(" ")[0].rstrip(",")]


def _list_differing(component: Component, robots: Sequence[str], state: FleetState) -> Iterable[str]:
    """List the names of the first topic with two types: a relay may give it another name on the other side."""
    return ALIKE.findall(component.what)[:2] or _list_topics(component, robots, state)


def _list_types(component: Component, robots: Sequence[str], state: FleetState) -> Iterable[str]:
    topics = _list_differing(component, robots, state)
    return (state.exchanges.robots[robot].sums.get(topic, ("", ""))[0] for topic in topics for robot in robots)


def _list_linked_nodes(component: Component, robots: Sequence[str], state: FleetState) -> Iterator[str]:
    """List the nodes at both ends of connections between the robots. For an end that no roscore knows there is a URI."""
    for one in state.run.values():
        if one.is_probed and one.plan.is_master and one.plan.robot in robots:
            for other in set(component.places) - {one.plan.robot}:
                for link in state.exchanges.find_crossing_links(one.probe.exchange.connections, one.plan.robot, other):
                    yield from (link.node, link.peer)


def _list_bridges(_component: Component, robots: Sequence[str], state: FleetState) -> Iterable[str]:
    return state.exchanges.find_bridges(robots)


def _list_parameters(component: Component, _robots: Sequence[str], state: FleetState) -> Iterator[str]:
    """List the parameters with another value, by their names on the robot that gets them."""
    for its_name, own in OTHER_VALUE.findall(component.what):
        for one in state.run.values():
            if one.plan.is_master and one.plan.robot == own:
                for entry in one.plan.sync.get("sync_parameters", ()):
                    yield from (entry.get("as", "") + name for name in entry["names"] if name == its_name)


MOST_NODES, MOST_PARAMETERS = 4, 4
OTHER_VALUE = re.compile(
    r"(?<!\S)(/\S+) of \S+ has another value on ([^\s,]+)"
)  # in the sentences of the check of copies
ALIKE = re.compile(
    r"(?<![A-Za-z0-9_/])(/[A-Za-z0-9_/]+) of "
)  # a topic of a robot, in the sentences of the check of types
TOPIC = _Names("topic", "graph", _list_topics)
#: kind and mode of a fault between roscores -> the names for its commands
NAMES: Mapping[tuple[str, str], tuple[_Names, ...]] = {
    ("messages", "differ"): (
        _Names("topic", "graph", _list_differing, 2, "; rostopic type "),
        _Names("type", "type", _list_types),
    ),
    ("parameter", "copy"): (_Names("parameter", "graph", _list_parameters, MOST_PARAMETERS),),
    ("registration", "link"): (_Names("nodes", "graph", _list_linked_nodes, MOST_NODES),),
    ("topic", "shared"): (TOPIC,),
    ("topic", "circle"): (_Names("nodes", "graph", _list_bridges, MOST_NODES),),
}


def _name_registrations(component: Component, state: FleetState) -> Mapping[str, str]:
    """Name what the roscores hold of a fault between them. Any program may have chosen these names, so each has its form."""
    robots = [robot for robot in component.places if robot in state.exchanges.robots]
    values = {}
    for names in NAMES.get((component.kind, component.mode), ()):
        found = dict.fromkeys(names.find(component, robots, state))
        texts = filter(None, (advice.format_value(names.form, name) for name in found))
        values[names.word] = names.between.join(islice(texts, names.most))
    return values
