# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Contradictions between declarations of data flow and filters, and between variables of the fleet.

Declarations and filters of each robot in, one sentence for each contradiction out.
"""

from __future__ import annotations

import itertools
import re
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence

from .._base.sentences import nearest, shorten_list
from .exports import (
    DIAGNOSTICS,
    EXTERNAL,
    FILTERS,
    FROM_CLIENT,
    FROM_SERVER,
    KINDS,
    Export,
    is_within,
    make_node_filters,
    topics_of,
)
from .filters import BUILT_IN, SYNC, WHITE_LISTS, Filters, matches, usable
from .flows import RELAY_PORT, PlannedChannel, gives, list_givers, make_flows
from .model import Fleet, Inventory, Robot, Values
from .variables import FleetVariables


def find_contradictions(fleet: Fleet, inventory: Inventory) -> Iterator[str]:
    """Yield one sentence for each contradiction. A robot without hosts declares nothing, and may be meant by others."""
    parties = {robot.name: robot for robot in fleet.robots if robot.hosts}
    declarers, robots = list(parties.values()), inventory.robots
    computers = {host: robot for robot, hosts in robots.items() for host in hosts}
    for party in declarers:
        yield from (*_find_wrong_receivers(party, robots, computers), *_find_built_in_names(party))
    yield from _find_parameter_names(declarers)
    yield from _find_collisions(parties, list(robots))
    yield from _find_crossing_parameters(parties, list(robots))
    yield from _find_meeting_names(declarers, list(robots))
    yield from _find_wrong_ways_back(parties)
    yield from _find_lost_ways_back(parties)
    yield from _find_second_white_lists(declarers)
    yield from _find_filtered_exports(parties)
    yield from find_excluded_strangers(fleet.variables)
    yield from _find_local_diagnostics(declarers, fleet.variables)
    yield from _find_wrong_seals(declarers, inventory, fleet.variables)


def find_excluded_strangers(shared: FleetVariables) -> list[str]:
    """Return a sentence if strangers are allowed, and the packet filter keeps them out."""
    if shared.firewall != "fleet" or shared.strangers != "allow":
        return []
    return [
        "multimaster_firewall is 'fleet' and multimaster_strangers is 'allow', but the packet filter lets no stranger in; expected "
        "one of the two: name who else belongs to the fleet in multimaster_allow and set multimaster_strangers to 'ignore', or set "
        "multimaster_firewall to 'none', in group_vars/robots.yml."
    ]


def find_wrong_relay_ports(fleet: Fleet) -> Iterator[str]:
    """Yield a sentence for each robot whose relay would have the port of its discovery node, or a port above 65535."""
    ends = {name for channel in fleet.channels for name in (channel.robot, channel.other)}
    for robot in (robot for robot in fleet.robots if robot.name in ends):
        own, port = robot.variables, robot.variables.roscore_port + RELAY_PORT
        why = "which it needs, since multimaster_exports renames or slows the crossing topics"
        if port > 65535:
            yield (
                f"{robot.host}: multimaster_roscore_port is {own.roscore_port}, and the port of the relay is {RELAY_PORT} above it, {why}; expected at "
                f"most {65535 - RELAY_PORT}: set another one in {robot.file}."
            )
        elif port == own.rpc_port:
            yield (
                f"{robot.host}: multimaster_rpc_port is {port}, which is also the port of its relay, {why}; expected another port: leave it out "
                "for the port of the roscore + 300."
            )


_TREE = ("/tf", "/tf_static")


def find_wrong_frames(fleet: Fleet) -> list[str]:
    """Return a sentence for each robot whose frames are not connected with those of other robots, or have the same names."""
    problems = {}
    for robot, channels in _list_renamed(fleet):
        crossing = [name for name in _TREE if any(matches(channel.entry.given_topics, name) for channel in channels)]
        prefixes = list(dict.fromkeys(channel.entry.frames for channel in channels))
        other = channels[0].other
        if crossing and robot.variables.frames is None:
            problems[robot.name, "tree"] = (
                f"{robot.master.name}: multimaster_exports gives {' and '.join(crossing)} to {other} with 'frames', but multimaster_frames does not "
                "say how the robots' frames hang together; expected a frame of all and the root of this robot's tree: set multimaster_frames to "
                f"{{world: map}} in group_vars/{robot.name}.yml, or to '{EXTERNAL}', if something else publishes it."
            )
        elif crossing == ["/tf"]:
            problems[robot.name, "tree"] = (
                f"{robot.master.name}: multimaster_exports gives /tf to {other} with 'frames', but not /tf_static; expected both, since a tree "
                f"without its fixed transforms falls apart: add /tf_static, too, in group_vars/{robot.name}.yml."
            )
        if len(prefixes) > 1:
            problems[robot.name, "prefix"] = (
                f"{robot.master.name}: multimaster_exports gives frames to {other} with '{prefixes[0]}' and with '{prefixes[1]}'; expected one "
                f"prefix of this robot there, or its frames are in no tree: correct 'frames' in group_vars/{robot.name}.yml."
            )
    return list(problems.values()) + _find_ambiguous_prefixes(fleet)


def _list_renamed(fleet: Fleet) -> Iterator[tuple[Robot, list[PlannedChannel]]]:
    """Yield each robot with its channels to one other robot that has its frames by other names."""
    found: dict[tuple[str, str], list[PlannedChannel]] = defaultdict(list)
    for channel in fleet.channels:
        if channel.entry.frames:
            found[channel.robot, channel.other].append(channel)
    robots = {robot.name: robot for robot in fleet.robots}
    return ((robots[name], channels) for (name, _other), channels in found.items())


def _find_ambiguous_prefixes(fleet: Fleet) -> list[str]:
    """Return a sentence for each two robots of which the frames of one could be those of the other, at a third."""
    problems = {}
    for receiver in dict.fromkeys(channel.other for channel in fleet.channels):
        renamed = sorted({(c.entry.frames, c.robot) for c in fleet.channels if c.other == receiver and c.entry.frames})
        for (first, one), (second, other) in itertools.pairwise(renamed):
            if second.startswith(first) and one != other:
                problems[one, other] = (
                    f"multimaster_exports gives frames of {one} with '{first}' to {receiver}, and those of {other} with '{second}', which begins "
                    f"with it; expected a prefix of its own for each robot: choose another one at 'frames' in group_vars/{other}.yml."
                )
    return list(problems.values())


def _find_local_diagnostics(parties: Sequence[Robot], shared: FleetVariables) -> Iterator[str]:
    """Yield a sentence for each robot that names /diagnostics, if that topic stays on each robot."""
    for party in parties if shared.diagnostics == "local" else ():
        topics = {
            "multimaster_exports": [name for entry in party.inner_entries for name in entry.topics],
            "multimaster_filters": party.filters.get("sync_topics", ()),
        }
        yield from (
            f"{party.host}: {variable} has {DIAGNOSTICS}, but multimaster_diagnostics is 'local', which keeps that topic on each "
            f"robot; expected one of the two: set multimaster_diagnostics to 'exchanged' in group_vars/robots.yml, or remove it in "
            f"{party.file}."
            for variable, names in topics.items()
            if DIAGNOSTICS in names
        )


def _find_wrong_receivers(
    party: Robot, robots: Mapping[str, Sequence[str]], computers: Mapping[str, str]
) -> Iterator[str]:
    """Yield a sentence for each receiver that is no other robot; `computers` has the robot of each."""
    for name in dict.fromkeys(robot for entry in party.entries for robot in entry.to):
        if name == party.name:
            what, do = "the robot itself", "remove it"
        elif name in robots:
            continue
        elif name in computers:
            what, do = f"a computer of the robot {computers[name]}", "name the robot"
        else:
            what, do = f"no robot{nearest(name, robots)}", "correct it"
        yield (
            f"{party.host}: multimaster_exports is for '{name}', which is {what}; expected other robots, groups below 'robots': "
            f"{do} in {party.file}."
        )


def _find_built_in_names(party: Robot) -> list[str]:
    return [
        f"{party.host}: multimaster_exports has the {KINDS[key]} {name}, which is never exchanged, since it belongs to the "
        f"roscore or to the exchange itself; expected names of the robot's own nodes: remove it in {party.file}."
        for key, name in dict.fromkeys(item for entry in party.entries for item in entry.names())
        if matches(BUILT_IN.get(f"ignore_{'topics' if key == 'back' else key}", ()), name)
    ]


def _find_parameter_names(parties: Sequence[Robot]) -> list[str]:
    """Return a sentence for a master that is called like a parameter of master_sync, which has white lists below the names of masters."""
    return [
        f"{party.host}: multimaster_exports is declared, but the name of its master, {party.master_name}, is that of a parameter of "
        f"master_sync; expected another name, since the others have a white list below it: rename the computer, or remove "
        f"multimaster_exports in {party.file}."
        for party in parties
        if party.variables.exports is not None and party.master_name in SYNC
    ]


# A pattern that begins with a name means certain nodes. `*` or `/*/reset` means everything that the robot has.
_CERTAIN_NODES = re.compile(r"/[A-Za-z0-9_].*\*")

_ONE_GIVER = {
    "services": "since a roscore keeps one provider of a service",
    "actions": "since each goal would reach both",
}


def _find_collisions(parties: Mapping[str, Robot], robots: Sequence[str]) -> list[str]:
    """Return a sentence for two robots that give the same service or action to a third, by its name or by a pattern."""
    return sorted(
        f"{parties[first].host}: multimaster_exports gives the {KINDS[key]} {name} to {shorten_list(receivers)}, and so does "
        f"that of {second}; expected one of the two, {why}: rename it on one of them, or choose the receivers of each with 'to'."
        for key, why in _ONE_GIVER.items()
        for name, givers in _match_givers(parties.values(), key)
        for (first, second), receivers in _pair_givers(givers, parties, robots)
    )


Giver = tuple[Robot, Export]


def _find_meeting_names(parties: Sequence[Robot], robots: Sequence[str]) -> list[str]:
    """Return a sentence for a topic that comes to a robot by one name from two robots, or twice from one, if a relay renames or slows it.

    Two patterns that only overlap, such as /*/x and /y/*, are not compared.
    """
    by_name = {party.name: party for party in parties}
    meetings: dict[tuple[str, str, str], list[str]] = {}  # both givers and the name -> receivers
    relaying = any(entry.is_relayed for party in parties for entry in party.entries)
    for receiver in robots if relaying else ():
        for (party, entry), (other, its) in _pair_renamed(parties, receiver):
            same = _list_meeting(entry, its) if party == other or entry.namespace or its.namespace else []
            if same:
                receivers = meetings.setdefault((party.name, other.name, same[0]), [])
                receivers += [receiver] if receiver not in receivers else []
    return [
        f"{by_name[giver].host}: multimaster_exports gives {name} to {shorten_list(receivers)}, and so does "
        f"{'another entry' if giver == other else f'that of {other}'}; expected one of the two, since their messages would be mixed: "
        f"choose another namespace with 'as', or the receivers of each with 'to', in {by_name[giver].file}."
        for (giver, other, name), receivers in meetings.items()
    ]


def _pair_renamed(parties: Sequence[Robot], receiver: str) -> Iterator[tuple[Giver, Giver]]:
    """Yield each two entries for a robot of which one is relayed, the later one first."""
    given = [
        (party, entry)
        for party in parties
        for entry in party.entries
        if receiver in party.receivers(entry, (receiver,))
    ]
    for number, one in enumerate(given):
        for other in given[:number]:
            if one[1].is_relayed or other[1].is_relayed:
                yield one, other


def _list_meeting(one: Export, other: Export) -> list[str]:
    """Return the names on the receiver that two entries have in common."""
    names, others = ([entry.rename(name) for name in (*entry.given_topics, *entry.services)] for entry in (one, other))
    return [name for name in names if any(matches([name], second) or matches([second], name) for second in others)]


def _find_wrong_ways_back(parties: Mapping[str, Robot]) -> Iterator[str]:
    """Yield a sentence for a topic that is to come back from a robot that does not give it, and for one that would come by two ways."""
    for party in parties.values():
        for other in (
            parties[name] for name in dict.fromkeys(_list_receivers(party)) if name in parties.keys() - {party.name}
        ):
            ways = [(entry, name) for entry in party.entries for name in entry.back if other.name in entry.to]
            for entry, name in ways:
                outer = entry.rename(name)
                if not gives(other.variables.exports, party.name, outer):
                    yield (
                        f"{party.host}: multimaster_exports has {name} at 'back' for {other.name}, but that of {other.name} does not give {outer} "
                        f"to {party.name}; expected a robot that gives it: add {{topics: [{outer}], to: [{party.name}]}} to multimaster_exports "
                        f"in {other.file}, or take it out of 'back' in {party.file}."
                    )
            for (_entry, name), (_other, second) in itertools.combinations(ways, 2):
                if matches([name], second) or matches([second], name):
                    yield (
                        f"{party.host}: multimaster_exports has {second} at 'back' for {other.name} in two entries; expected it in one, since "
                        f"one name of {other.name} would be lost: take it out of the other in {party.file}."
                    )


def _find_lost_ways_back(parties: Mapping[str, Robot]) -> Iterator[str]:
    """Yield a sentence for a topic that goes to a robot by the relay, and comes back from it only by its own declaration.

    Topics that a relay takes across are left out of the ordinary exchange, so they would be lost without a word. A pattern names no topic: all
    that a station has for a robot, `/kobuki1/*`, has its incoming topics in it.
    """
    for party, other in _pair_relaying(parties.values()):
        returned = _list_ordinary_topics(other, party.name)
        ways = [entry for entry in party.entries if entry.is_relayed and party.receivers(entry, (other.name,))]
        named = [entry.rename(name) for entry in ways for name in entry.back + topics_of(entry.actions, FROM_CLIENT)]
        for name in (name for name in returned if not matches(named, name)):
            given = (entry.rename(topic) for entry in ways for topic in entry.given_topics)
            meeting = next((topic for topic in given if matches([topic], name)), "")
            if meeting:
                yield (
                    f"{party.host}: multimaster_exports gives {meeting} to {other.name} by the relay, and that of {other.name} gives {name} to "
                    f"{party.name}, which is lost, since it is not at 'back'; expected it there, or another name: add it to 'back' of the "
                    f"entry in {party.file}, or take it out of multimaster_exports in {other.file}."
                )


def _pair_relaying(parties: Collection[Robot]) -> Iterator[tuple[Robot, Robot]]:
    """Yield each robot with a relay together with each other robot."""
    relaying = [party for party in parties if any(entry.is_relayed for entry in party.entries)]
    return ((party, other) for party in relaying for other in parties if other is not party)


def _list_ordinary_topics(giver: Robot, receiver: str) -> list[str]:
    """List the topics that a robot gives to another one past the relay, each once."""
    return list(
        dict.fromkeys(
            name
            for entry in giver.entries
            if not entry.is_relayed and receiver in giver.receivers(entry, (receiver,))
            for name in entry.given_topics
            if "*" not in name
        )
    )


def _list_receivers(party: Robot) -> Iterator[str]:
    return (name for entry in party.entries for name in entry.to)


def _find_crossing_parameters(parties: Mapping[str, Robot], robots: Sequence[str]) -> list[str]:
    """Return a sentence for two robots that give the same parameter to a third, or one in the namespace of the other."""
    entries = [
        (party.name, entry, [entry.rename(name) for name in entry.parameters])  # as the receivers have them
        for party in parties.values()
        for entry in party.entries
    ]
    problems = []
    for name in sorted({name for _robot, _entry, names in entries for name in names}):
        givers: dict[str, list[Export]] = defaultdict(list)
        given: dict[str, str] = {}  # robot -> this name, or the one that it is in
        for robot, entry, names in entries:
            for other in (other for other in names if is_within(name, other)):
                givers[robot].append(entry)
                given[robot] = other
        for (first, second), receivers in _pair_givers(givers, parties, robots):
            also = "so does that of" if given[first] == given[second] else f"{given[second]} is given by that of"
            problems.append(
                f"{parties[first].host}: multimaster_exports gives the parameter {given[first]} to {shorten_list(receivers)}, and {also} "
                f"{second}; expected one of the two, since a roscore keeps one value: put it into a namespace of its robot, or choose "
                "the receivers of each with 'to'."
            )
    return problems


def _match_givers(parties: Collection[Robot], key: str) -> Iterator[tuple[str, dict[str, list[Export]]]]:
    """Yield each exported name of a kind, with robot -> its entries for this name or for a pattern of it."""
    givers: dict[str, dict[str, list[Export]]] = defaultdict(lambda: defaultdict(list))  # by name or pattern, by robot
    for party in parties:
        for entry in party.inner_entries:
            for name in getattr(entry, key):
                givers[name][party.name].append(entry)
    patterns = [name for name in givers if _CERTAIN_NODES.match(name)]
    for name in (name for name in givers if "*" not in name):
        by_robot = {robot: list(entries) for robot, entries in givers[name].items()}
        for pattern in (pattern for pattern in patterns if matches([pattern], name)):
            for robot, entries in givers[pattern].items():
                by_robot.setdefault(robot, []).extend(entries)
        yield name, by_robot


def _pair_givers(
    givers: Mapping[str, Sequence[Export]], parties: Mapping[str, Robot], robots: Sequence[str]
) -> list[tuple[tuple[str, str], list[str]]]:
    """Return pairs of robots that give the same to a third, with the receivers. Each receiver is in one pair."""
    if len(givers) < 2:
        return []
    reached = {
        giver: {robot for entry in entries for robot in parties[giver].receivers(entry, robots)}
        for giver, entries in givers.items()
    }
    pairs: dict[tuple[str, str], list[str]] = {}
    for robot in robots:
        rivals = [giver for giver in reached if robot in reached[giver]]
        if len(rivals) > 1 and not any(robot in receivers for receivers in pairs.values()):
            both = reached[rivals[0]] & reached[rivals[1]]
            pairs[rivals[0], rivals[1]] = [other for other in robots if other in both]
    return list(pairs.items())


# The filters that are white lists of names. sync_hosts does not count: it leaves whole masters out.
_WHITE_LISTS = sorted(name for name, parameter in FILTERS.items() if parameter in WHITE_LISTS)


def _find_second_white_lists(parties: Sequence[Robot]) -> Iterator[str]:
    """Yield a sentence for each robot with both a white list of its own and a flow to it, since that would widen the flow."""
    flows = make_flows({party.name: party.variables.exports for party in parties})
    for party in parties:
        lists = ", ".join(name for name in _WHITE_LISTS if party.filters.get(name))
        givers = list_givers(flows, party.name) if lists else []
        if givers:
            yield (
                f"{party.host}: multimaster_filters has {lists}, but multimaster_exports of {shorten_list(givers)} says already what "
                f"{party.name} gets; expected filters named ignore_* or sync_hosts there: remove {lists}, and have "
                "multimaster_exports of the others name the wanted topics."
            )


def _find_filtered_exports(parties: Mapping[str, Robot]) -> Iterator[str]:
    """Yield a sentence for names that an entry gives to a certain robot, and that filters leave out."""
    for party, entry in [(declarer, entry) for declarer in parties.values() for entry in declarer.inner_entries]:
        for receiver in (parties[name] for name in dict.fromkeys(entry.to) if name in parties.keys() - {party.name}):
            actions = [("actions", name) for name in entry.actions]
            for taker, giver, names, parts, what in (
                (receiver, party, entry.names(), FROM_SERVER, ""),
                (party, receiver, actions, FROM_CLIENT, "the goals of "),
            ):
                lost = [
                    f"{what}the {KINDS[key]} {name}"
                    for key, name in names
                    if _is_master_ignored(taker.filters, giver.master_name)
                    or _is_ignored(taker.filters, key, name, parts)
                ]
                if lost:
                    yield (
                        f"{taker.host}: multimaster_filters leaves out {shorten_list(lost)}, which multimaster_exports of {party.name} "
                        f"has for {receiver.name}; expected filters that take it: correct them in {taker.file}, "
                        f"or 'to' in {party.file}."
                    )


def _is_ignored(filters: Mapping[str, Sequence[str]], key: str, name: str, parts: Sequence[str]) -> bool:
    """Return True if filters surely ignore this name. Of an action the topics `parts` count."""
    if "*" in name or key == "parameters":  # filters are about registrations
        return False
    parameters = make_node_filters(filters)
    if key == "services":
        return usable(parameters.get("ignore_services", ())).matches(name)
    topics = topics_of([name], parts) if key == "actions" else (name,)
    return any(
        usable(parameters.get(ignored, ())).matches(topic)
        for ignored in ("ignore_topics", "ignore_publishers")
        for topic in topics
    )


def _is_master_ignored(filters: Mapping[str, Sequence[str]], master: str) -> bool:
    return bool(master) and not Filters(make_node_filters(filters)).wants_host(master)


# Sealed computers


def _find_wrong_seals(robots: Sequence[Robot], inventory: Inventory, shared: FleetVariables) -> Iterator[str]:
    """Yield a sentence for each thing that cannot be done with a sealed computer."""
    owner: dict[str, str] = {}
    for robot in robots:
        for name in robot.seals:
            if name in inventory.hosts:
                yield (
                    f"{name}: is a host of the inventory, and in multimaster_sealed of the robot {robot.name}; expected one of the two, "
                    f"since Ansible logs in to each host: take it out of its group, or out of multimaster_sealed in {robot.file}."
                )
            elif owner.setdefault(name, robot.name) != robot.name:
                yield (
                    f"{name}: is in multimaster_sealed of the robots {owner[name]} and {robot.name}; expected one robot: remove it from "
                    "the other."
                )
        yield from _find_wrong_companion(robot)
        yield from _find_tasks_of_sealed(robot, inventory.variables.get(robot.hosts[0], {}))
        if robot.seals and shared.advertise == "name":
            yield (
                f"{shorten_list(robot.seals)}: is in multimaster_sealed, but multimaster_advertise is 'name'; expected 'address', since "
                "nobody writes the names of the other computers into its /etc/hosts: set it in group_vars/robots.yml."
            )


def _find_wrong_companion(robot: Robot) -> Iterator[str]:
    """Yield a sentence if no computer, or the wrong one, is to run the nodes for a sealed roscore."""
    host, companion, choices = robot.hosts[0], robot.variables.companion, ", ".join(robot.hosts)
    if companion is None:
        if robot.has_sealed_master and len(robot.hosts) > 1:
            yield (
                f"{host}: multimaster_companion is not set, but the master of the robot {robot.name}, {robot.variables.master}, is sealed; expected "
                f"the computer that runs discovery and sync for it, one of {choices}: set it in {robot.file}."
            )
    elif companion in robot.seals:
        yield (
            f"{host}: multimaster_companion is {companion}, which is sealed; expected a computer at which Ansible may log in, one of "
            f"{choices}: correct it in {robot.file}."
        )
    elif companion not in robot.hosts:
        yield (
            f"{host}: multimaster_companion is '{companion}', which is no computer of the robot {robot.name}; expected one of "
            f"{choices}{nearest(companion, robot.hosts)}: correct it in {robot.file}."
        )
    elif not robot.has_sealed_master:
        yield (
            f"{host}: multimaster_companion is {companion}, but multimaster_master of the robot {robot.name} is no sealed computer; "
            f"expected one of multimaster_sealed, since any other master runs its nodes itself: correct multimaster_master, or "
            f"remove multimaster_companion in {robot.file}."
        )


def _find_tasks_of_sealed(robot: Robot, raw: Values) -> Iterator[str]:
    """Yield a sentence for each task that would need a login on a sealed computer."""
    gateways = [name for name, entry in robot.seals.items() if robot.variables.gateway in (name, entry.address)]
    if gateways:
        yield (
            f"{gateways[0]}: is sealed, and multimaster_gateway of the robot {robot.name}; expected a gateway that can be set up: a computer "
            f"of the inventory, or a device for which playbooks/router_config.yml writes the commands to paste: correct it in {robot.file}."
        )
    if not robot.has_sealed_master:
        return
    if raw.get("multimaster_roscore") == "managed":
        yield (
            f"{robot.variables.master}: is sealed, but multimaster_roscore of the robot {robot.name} is 'managed'; expected 'existing', since its own "
            f"system starts the roscore there: correct it in {robot.file}."
        )
    if robot.variables.provider not in (None, "bundled"):
        yield (
            f"{robot.variables.master}: is sealed, but multimaster_provider of the robot {robot.name} is '{robot.variables.provider}', whose nodes run only on "
            f"the computer of their roscore; expected 'bundled', whose nodes can run on another computer: correct it in {robot.file}."
        )
