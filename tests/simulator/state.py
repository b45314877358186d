# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The state of a simulated fleet: the world of packets, and what runs on it. A fault is another state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from ipaddress import IPv4Address
from itertools import pairwise
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.multicast_routing.model import (
    MulticastRouting,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import (
    Interface,
    Link,
    Machine,
    World,
    kernel_routes,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.packets import Echo, Trace
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.plan_world import make_world
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import FleetPlan

RUNS, DEAD, HUNG = "runs", "dead", "hung"  # hung: it has its port, and answers nothing


@dataclass(frozen=True)
class Node:
    """A node that a person has started."""

    name: str
    computer: str
    host: str  # that it announces
    source: str = "ROS_IP"  # what has decided that
    starter: str = "shell"
    apart: bool = False  # in a network of its own, which nothing outside reaches
    services: str = ""  # the host of its services, where that is another one
    master: str = ""  # its roscore, where that is not the one of its robot
    registered: bool = True
    hung: bool = False
    fenced: bool = False  # a packet filter drops what other computers send to its ports


@dataclass(frozen=True)
class RobotState:
    """The programs on the computer of a robot's master."""

    roscore: str = RUNS
    calls_itself: str = ""  # the host in the roscore's own URI
    discovery: str = RUNS
    group: str = ""  # that its discovery node uses
    port: int = 0
    sync: str = RUNS
    stale: bool = False  # its sync node has not followed since the talkers started
    takes: bool = True  # its sync node has the planned filters; else it leaves odometry out
    gives: bool = True  # its discovery node serves what is planned; else it keeps odometry to itself
    ghosts: tuple[str, ...] = ()  # registered nodes that were killed
    node: str = ""  # the name of a node of its own that another robot has too
    people: tuple[Node, ...] = ()  # nodes of people at its roscore
    sums: Mapping[str, str] = field(default_factory=dict)  # type -> md5 sum, where it is another one


@dataclass(frozen=True)
class Port(Interface):
    """An interface that may lose packets."""

    loss: float = 0.0  # the share of packets that is lost here, coming in and going out, 0 to 1


@dataclass(frozen=True)
class Wire(Link):
    """A link that may lose packets."""

    loss: float = 0.0  # the share of packets that is lost, 0 to 1
    pruned: frozenset[IPv4Address] = frozenset()  # groups that it does not carry, as by IGMP snooping without a querier


@dataclass(frozen=True)
class Computer(Machine):
    """A machine with what does not concern the packets of the product's model."""

    groups: frozenset[IPv4Address] = frozenset()  # that it passes on between its interfaces
    names: Mapping[str, tuple[IPv4Address, ...]] = field(default_factory=dict)  # what each name means here
    environment: Mapping[str, str] = field(default_factory=dict)  # of its services
    clock: float = 0.0  # seconds ahead of the true time


def replace_interface(machine: Machine, changed: Interface) -> Machine:
    """The machine with another state of one interface, and with the kernel's routes of its addresses."""
    before = kernel_routes(machine.interface(changed.name))
    others = [route for route in machine.routes if route not in before]
    interfaces = tuple(changed if one.name == changed.name else one for one in machine.interfaces)
    return replace(machine, interfaces=interfaces, routes=(*kernel_routes(changed), *others))


def replace_link(world: World, changed: Link) -> World:
    """The world with another state of one link."""
    return replace(world, links={**world.links, changed.name: changed})


@dataclass(frozen=True)
class State:
    """A fleet."""

    fleet: FleetPlan
    world: World
    robots: Mapping[str, RobotState]
    without_ros: frozenset[str] = frozenset()
    shut: frozenset[str] = frozenset()  # the controller cannot log in
    differing: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # variables of services that differ
    down: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # further services that do not run
    unplugged: frozenset[str] = frozenset()  # links without power: nobody's interface has a carrier
    hidden: frozenset[str] = frozenset()  # computers where root alone may read /etc/hosts
    undisciplined: frozenset[str] = frozenset()  # computers whose clocks nothing keeps right
    bare: frozenset[str] = frozenset()  # computers on which site.yml has not run
    full: frozenset[str] = frozenset()  # computers without room where services write
    strangers: tuple[str, ...] = ()  # addresses on the common network from which others send to the group

    def replace_machine(self, changed: Machine) -> State:
        """The state with another machine."""
        return replace(self, world=self.world.replace_machine(changed))

    def with_robot(self, robot: str, **changes: object) -> State:
        """The state with other programs of a robot's master."""
        return replace(self, robots={**self.robots, robot: replace(self.robots[robot], **changes)})

    def master(self, robot: str) -> str:
        """The computer of a robot's master."""
        return self.fleet.master_of[robot].computer


def _fields(of: Machine | Interface | Link) -> dict[str, Any]:
    return {one.name: getattr(of, one.name) for one in fields(of)}


def make_computer(machine: Machine) -> Computer:
    """The machine with what the simulator knows beside packets."""
    ports = tuple(Port(**_fields(one)) for one in machine.interfaces)
    return Computer(**{**_fields(machine), "interfaces": ports})


def simulate(fleet: FleetPlan) -> World:
    """The world of a plan, in which packets may be lost and groups are passed on."""
    planned = make_world(fleet)
    machines = {}
    for name, machine in planned.machines.items():
        plan = fleet.computers.get(name)
        routing = MulticastRouting.find(plan) if plan else None
        machines[name] = replace(make_computer(machine), groups=frozenset({routing.group} if routing else ()))
    return World(machines, {name: Wire(**_fields(link)) for name, link in planned.links.items()})


def ports(world: World) -> dict[str, list[tuple[Machine, Interface]]]:
    """The machines with their interfaces on each link."""
    found: dict[str, list[tuple[Machine, Interface]]] = {name: [] for name in world.links}
    for machine in world.machines.values():
        for interface in machine.interfaces:
            if interface.link in found:
                found[interface.link].append((machine, interface))
    return found


def loss(world: World, way: Trace | Echo) -> float:
    """The share of such packets that is lost on a way, or there and back."""
    kept = 1.0
    for one in (way.there, way.back) if isinstance(way, Echo) else (way,):
        for hop, following in pairwise(one.hops if one else ()):
            leaves = world.machines[hop.machine].interface(hop.device)
            comes = {machine.name: port for machine, port in world.holders(leaves.link, hop.to)}
            kept *= (1 - leaves.loss) * (1 - world.links[leaves.link].loss) * (1 - comes[following.machine].loss)
    return 1 - kept


def healthy(random, fleet: FleetPlan) -> State:
    """A fleet in which everything is as planned. Some second computers have no ROS, and some packets are lost."""
    world = simulate(fleet)
    names = {name: (entry.address,) for entry in fleet.hosts_entries for name in entry.names}
    for name, plan in fleet.computers.items():
        known = names if plan.robot else {}
        world = world.replace_machine(replace(world.machines[name], names=known, environment=plan.environment))
    for link in world.links.values():
        world = replace_link(world, replace(link, loss=random.choice((0.0, 0.0, 0.002))))
    robots = {
        master.robot: RobotState(
            calls_itself=master.uri.split("//")[1].partition(":")[0],
            group=str(fleet.multicast_group),
            port=fleet.multicast_port,
        )
        for master in fleet.masters
    }
    seconds = [name for name, plan in fleet.computers.items() if plan.robot and not plan.is_master]
    without = frozenset(name for name in seconds if random.random() < 0.1)
    free = frozenset(fleet.computers) if random.random() < 0.5 else frozenset()  # many fleets have no chrony at all
    return State(fleet, world, robots, without_ros=without, undisciplined=free)
