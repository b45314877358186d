# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Machines to a proposal of an inventory: which robots they are, and the variables that say so. Every guess has its reason."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from ipaddress import IPv4Address, IPv4Network

from .._base.features import load_hooks
from .._base.sentences import shorten_list
from .._inventory import kinds
from . import facts, groups, names
from .hooks import AdoptHooks
from .proposal import Choice, Choices, Proposal, ProposedComputer, ProposedRobot
from .scene import AdoptionScene

# Nodes that can be kept -> their names for people.
MAKERS = {"fkie_mas": "fkie_mas", "upstream": "multimaster_fkie"}
# The defaults of discovery nodes, if no parameter sets another value.
GROUP, PORT, ROSCORE_PORT = "226.0.0.0", 11511, 11311


def propose(machines: Iterable[facts.FoundMachine], left_out: Mapping[str, str]) -> Proposal:
    """Return the inventory of these machines. `left_out` are those that were not read, and why."""
    kept, twice = _drop_duplicates(machines)
    missing = {**left_out, **twice}
    everything = groups.Machines(kept)
    found = groups.find_groups(everything)
    if found is None or not found.groups:
        return Proposal(left_out={**missing, **dict.fromkeys(kept, _explain_nothing(everything, found))})
    scene = AdoptionScene(everything, found, names.name_computers(kept))
    parts = [_robot(scene, group) for group in found.groups]
    outside = {name: why for _robot, of_robot in parts for name, why in of_robot.items()}
    unnamed = [robot for robot, _outside in parts if robot.computers]
    called = names.name_robots(
        [[computer.name for computer in robot.computers] for robot in unnamed],
        [name for name, _why in scene.names.values()],
    )
    robots = [replace(robot, name=name) for name, robot in zip(called, unnamed, strict=True)]
    router, device, rest = _router(scene, {**found.rest, **outside})
    return Proposal(
        choices=_fleet(scene, device),
        robots=tuple(sorted(robots, key=lambda robot: robot.name)),
        router=router,
        left_out={**missing, **rest},
        notes=tuple(_fleet_notes(scene)),
    )


def _explain_nothing(machines: groups.Machines, found: groups.FleetGroups | None) -> str:
    """Return why no robot was found on any machine."""
    if not machines.masters:
        named = sorted({uri.host for machine in machines.by_name.values() for uri in machine.masters})
        if named:
            return (
                f"no roscore runs on any machine, and none of them is {shorten_list(named)}, which ROS_MASTER_URI names"
            )
        return f"no roscore runs on any machine, and {groups.NO_URI}"
    where = f"the roscore of {shorten_list(sorted(machines.masters))}"
    if found is None:
        return f"no machine has an address in a network in which others could reach {where}"
    return f"no two machines share a network in which they could reach {where}"


def _drop_duplicates(machines: Iterable[facts.FoundMachine]) -> tuple[dict[str, facts.FoundMachine], dict[str, str]]:
    """Return the machines without those that the list has twice."""
    kept: dict[str, facts.FoundMachine] = {}
    twice: dict[str, str] = {}
    seen: dict[tuple[str, frozenset[IPv4Address]], str] = {}
    for machine in machines:
        mark = machine.hostname, frozenset([*(address.ip for address in machine.addresses), *machine.singles])
        first = seen.setdefault(mark, machine.name) if mark[1] else machine.name
        if first == machine.name:
            kept[machine.name] = machine
        else:
            twice[machine.name] = f"it is the same machine as {first}"
    return kept, twice


# A robot


def _robot(scene: AdoptionScene, group: groups.Group) -> tuple[ProposedRobot, dict[str, str]]:
    """Return a robot without its name, and its machines that cannot be in it."""
    network = _network(scene, group)
    inside = network or scene.found.common
    members = [name for name in sorted(group.members) if name in scene.addresses(inside)]
    outside = {
        name: f"it belongs to the roscore on {scene.name(group.master)}, and has no address in {inside}"
        for name in sorted(group.members - set(members))
    }
    choices: dict[str, Choice] = {}
    if network:
        choices["network"] = Choice(str(network))
        choices.update(_gateway(scene, members, network))
    choices["master"] = _master(scene, group, members)
    roscore, doubt = _roscore(scene, group)
    choices.update(_ports(roscore, doubt))
    members_in_order = sorted(members, key=lambda name: scene.addresses(inside)[name])
    robot = ProposedRobot(
        name="",
        choices=choices,
        computers=tuple(_computer(scene, name, inside) for name in members_in_order),
        notes=(
            *group.notes,
            *_find_gaps(choices),
            *_network_notes(scene, group, network),
            *_describe_services(scene, group, roscore),
        ),
    )
    return robot, outside


def _network(scene: AdoptionScene, group: groups.Group) -> IPv4Network | None:
    """Return the robot's own network: that of most of its machines which are not in the common network."""
    inner = [name for name in group.members if name not in scene.common]
    aside = scene.found.shared | scene.machines.duplicate_networks
    own = [network for network in scene.machines.networks if network not in aside]
    counted = Counter(network for network in own for name in inner if name in scene.addresses(network))
    return max(counted, key=lambda network: (counted[network], -int(network.network_address)), default=None)


def _network_notes(scene: AdoptionScene, group: groups.Group, network: IPv4Network | None) -> list[str]:
    """Return the networks of a robot that the inventory has no place for."""
    others = [
        other
        for other, members in scene.machines.networks.items()
        if len(group.members & set(members)) > 1 and other not in (network, scene.found.common)
    ]
    return [
        f"Its computers have addresses in {other}, too, which the inventory leaves aside" for other in sorted(others)
    ]


def _find_gaps(choices: Choices) -> list[str]:
    """Return the notes on values that site.yml will ask for."""
    wanted = {
        "gateway": "the computer that connects its network",
        "common_address": "the address of its gateway in the common network",
    }
    return [
        f"multimaster_{name}, {what}, was not found: write it here"
        for name, what in wanted.items()
        if "network" in choices and name not in choices
    ]


def _master(scene: AdoptionScene, group: groups.Group, members: Sequence[str]) -> Choice:
    why = "" if scene.machine(group.master).roscores else "guessed from ROS_MASTER_URI, since no roscore ran"
    if group.master in members:
        return Choice(scene.name(group.master), why)
    return Choice(scene.name([*members, group.master][0]), "guessed, since its roscore is elsewhere")


def _gateway(scene: AdoptionScene, members: Sequence[str], network: IPv4Network) -> dict[str, Choice]:
    """Return the gateway of a network, its address in the common network, and which routes lead to it."""
    inner = [name for name in members if name not in scene.common]
    both = [name for name in members if name in scene.common]
    default = groups.count_hops(scene.machines, inner, network)
    hop = _first(default) or _first(groups.count_hops(scene.machines, inner, network, scene.found.common))
    at = scene.machines.machine_at(hop) if hop else None
    if hop and at is None and not any(scene.machine(name).forwards for name in both):
        return _device(scene, network, hop)
    if not both:
        return {}
    best = min(both, key=lambda name: (name != at, not scene.machine(name).forwards, name))
    choices = {
        "gateway": Choice(scene.name(best), _gateway_doubt(scene, best, both, at)),
        "common_address": Choice(str(scene.common[best])),
    }
    if hop and default[scene.addresses(network)[best]] * 2 < len(inner):
        choices["routes"] = Choice(
            "networks", "guessed, since the default routes of most of its computers lead elsewhere"
        )
    return choices


def _device(scene: AdoptionScene, network: IPv4Network, hop: IPv4Address) -> dict[str, Choice]:
    """Return a gateway that is no computer."""
    choices = {
        "gateway": Choice(str(hop), "guessed: the next hop of its computers, and none of the machines that were read")
    }
    outside = _first(groups.count_hops(scene.machines, scene.machines.by_name, scene.found.common, network))
    if outside:
        why = f"guessed: the next hop of other machines on their way to {network}"
        choices["common_address"] = Choice(str(outside), why)
    return choices


def _first(counted: Counter[IPv4Address]) -> IPv4Address | None:
    """Return the address that was counted most, the lowest of several."""
    return max(counted, key=lambda one: (counted[one], -int(one)), default=None)


def _gateway_doubt(scene: AdoptionScene, best: str, both: Sequence[str], at: str | None) -> str:
    why = []
    if best != at:
        why.append(f"guessed, since it is in both networks, as {', '.join(map(scene.name, both))}")
    if not scene.machine(best).forwards:
        why.append("it does not forward packets now (net.ipv4.ip_forward is 0)")
    return "; ".join(why)


# Its roscore and nodes


def _roscore(scene: AdoptionScene, group: groups.Group) -> tuple[facts.FoundRoscore, str]:
    """Return the roscore of a robot, and the reason if its computer has several."""
    roscores = scene.machine(group.master).roscores
    named = Counter(uri.port for name in group.members for uri in scene.machine(name).masters[:1])
    if not roscores:
        port = max(named, key=lambda one: (named[one], -one), default=ROSCORE_PORT)
        doubt = "guessed from ROS_MASTER_URI, since no roscore ran" if port != ROSCORE_PORT else ""
        return facts.FoundRoscore(port, None, ""), doubt
    best = min(roscores, key=lambda one: (-named[one.port], not one.discovery, one.port))
    others = ", ".join(str(one.port) for one in roscores if one != best)
    return best, f"guessed, since {scene.name(group.master)} has another roscore on port {others}" if others else ""


def _ports(roscore: facts.FoundRoscore, doubt: str) -> dict[str, Choice]:
    choices = {}
    if roscore.contained:
        choices["roscore"] = Choice("existing", "it runs in a container, in which the collection starts nothing")
    if roscore.port != ROSCORE_PORT or doubt:
        choices["roscore_port"] = Choice(roscore.port, doubt)
    rpc = next((node.uri.port for node in roscore.discovery if node.uri), 0)
    if rpc not in (0, roscore.port + 300):
        choices["rpc_port"] = Choice(rpc)
    return choices


def _describe_services(scene: AdoptionScene, group: groups.Group, roscore: facts.FoundRoscore) -> list[str]:
    """Return the notes on programs there that site.yml would replace."""
    machine = scene.machine(group.master)
    if machine.ours or not machine.roscores:
        return []
    what = f"The roscore on {scene.name(group.master)} was started by {roscore.runs or 'a person'}"
    notes = [
        f"{what}: it stays, and the collection's nodes run outside of its container, as docs/start/containers.md says"
        if roscore.contained
        else f"{what}: end it and its start at boot before site.yml, which starts its own, or set multimaster_roscore: existing"
    ]
    if roscore.discovery or roscore.syncs:
        maker = next((name for make, name in MAKERS.items() if make in roscore.makes), "")
        nodes = f"The nodes of {maker}" if maker else "Discovery and sync nodes"
        kept = (
            f", or set multimaster_provider: fkie_existing, with multimaster_ros_setup: the set-up file of {maker}"
            if maker
            else ""
        )
        notes.append(
            f"{nodes} run there, which site.yml replaces: end them and their start at boot{kept}; filters of the sync node "
            "are not read: write them as multimaster_filters"
        )
    return notes


# The fleet


def _fleet(scene: AdoptionScene, router: Choice | None) -> Choices:
    choices = {"common_network": Choice(str(scene.found.common), scene.found.why)}
    if router:
        choices["router"] = router
    masters = [group for group in scene.found.groups if scene.machine(group.master).roscores]
    roscores = [(scene.name(group.master), _roscore(scene, group)[0]) for group in masters]
    nodes = [(name, node) for name, roscore in roscores for node in roscore.discovery]
    choices.update(_choose_group(nodes))
    uris = [roscore.uri for _name, roscore in roscores if roscore.uri]
    if uris and all(uri.is_address for uri in uris):
        choices["advertise"] = Choice("address")
    for hooks in load_hooks("adopt", AdoptHooks).values():
        choices.update(hooks.choose(scene))
    choices.update(_transport(scene))
    return choices


def _transport(scene: AdoptionScene) -> Choices:
    """Return unicast if the common network is a foreign tunnel, such as WireGuard, Tailscale or OpenVPN."""
    ends = {name: scene.machine(name).mute.get(address, "") for name, address in scene.common.items()}
    mute = [f"{device} of {scene.name(name)}" for name, device in sorted(ends.items()) if device]
    if not mute:
        return {}
    return {
        "transport": Choice(
            "unicast", f"no multicast passes {shorten_list(mute)}, as with the tunnel of a VPN, which stays as it is"
        )
    }


def _choose_group(nodes: Sequence[tuple[str, facts.FoundDiscovery]]) -> Choices:
    choices = {"multicast_group": _choose_majority(nodes, lambda node: str(node.group or GROUP), GROUP)}
    port = _choose_majority(nodes, lambda node: node.group_port or PORT, PORT)
    if port.value != PORT or (port.why and nodes):
        choices["multicast_port"] = port
    return choices


def _choose_majority(
    nodes: Sequence[tuple[str, facts.FoundDiscovery]],
    read: Callable[[facts.FoundDiscovery], str | int],
    default: str | int,
) -> Choice:
    """Return the value of most nodes. The reason names the others."""
    counted = Counter(read(node) for _name, node in nodes)
    if not counted:
        return Choice(default, "the default of the nodes, since no discovery node ran")
    best = max(counted, key=lambda value: (counted[value], str(value)))
    others = [f"{name} has {read(node)}" for name, node in nodes if read(node) != best]
    return Choice(
        best, f"the value of {counted[best]} of {len(nodes)} discovery nodes; {', '.join(others)}" if others else ""
    )


def _fleet_notes(scene: AdoptionScene) -> list[str]:
    shared = sorted(scene.found.shared - {scene.found.common})
    torn = sorted(scene.machines.duplicate_networks)
    return [f"{network} connects several robots, too, and is left aside" for network in shared] + [
        f"In {network} machines have the same address: it is taken for a network inside each of them"
        for network in torn
    ]


# Computers, and the router


def _computer(scene: AdoptionScene, machine: str, network: IPv4Network) -> ProposedComputer:
    name, why = scene.names[machine]
    found = scene.machine(machine)
    choices = {"address": Choice(str(scene.addresses(network)[machine]))}
    if _is_alias(scene, found.hostname, name):
        choices["aliases"] = Choice([found.hostname], "the name that it calls itself")
    placed = {address for network in scene.machines.networks.values() for address in network.values()}
    alone = [f"{one}/32 of {device}, in no network" for one, device in found.singles.items() if one not in placed]
    notes = [f"Left aside: {', '.join([*found.aside, *alone])}"] if found.aside or alone else []
    return ProposedComputer(name, machine, choices, (*([f"Named so, since {why}"] if why else []), *notes))


def _is_alias(scene: AdoptionScene, hostname: str, name: str) -> bool:
    """Return True if a host name is another name of only one computer."""
    known = [entry.lower() for entry, _why in scene.names.values()]
    hostnames = [machine.hostname.lower() for machine in scene.machines.by_name.values()]
    host = hostname.lower()
    return kinds.is_given_name(host) and host != "localhost" and host not in known and hostnames.count(host) == 1


def _router(
    scene: AdoptionScene, rest: Mapping[str, str]
) -> tuple[ProposedComputer | None, Choice | None, dict[str, str]]:
    """Return the router of the common network as a host or as a device, and the machines that are neither."""
    members = [name for group in scene.found.groups for name in group.members]
    gateways = [name for name in members if name in scene.common]
    if len(gateways) == len(members):
        return None, None, dict(rest)  # no computer is behind a gateway: there is nothing to route
    hop = _first(groups.count_hops(scene.machines, gateways, scene.found.common))
    at = scene.machines.machine_at(hop) if hop else None
    able = [name for name in rest if _passes(scene, name)]
    if not able:
        why = "guessed: the next hop of gateways, and none of the machines that were read"
        return None, Choice(str(hop), why) if hop and at is None else None, dict(rest)
    best = min(able, key=lambda name: (name != at, name))
    computer = _computer(scene, best, scene.found.common)
    why = "Taken for the router, since it forwards packets and is in the common network, though no default route leads to it"
    router = replace(
        computer,
        choices={"address": computer.choices["address"]},
        notes=(*computer.notes, *([] if best == at else [why])),
    )
    return router, None, {name: why for name, why in rest.items() if name != best}


def _passes(scene: AdoptionScene, name: str) -> bool:
    """Return True if a machine on the common network forwards packets, has no roscore, and is in no robot's network."""
    members = {member for group in scene.found.groups for member in group.members}
    own = {
        network
        for network, of in scene.machines.networks.items()
        if name in of and network not in scene.found.shared and members & set(of)
    }
    machine = scene.machine(name)
    return name in scene.common and machine.forwards and not machine.roscores and not own
