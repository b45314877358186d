# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The faults that are injected, one row each: how the state changes, and the part that is expected to be named first.

A function takes a state and a source of chance, and returns the new state and the place, or None where the fleet has no
such part. Places are computers, robots, and links.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from ipaddress import IPv4Address, IPv4Interface, IPv4Network
from typing import NamedTuple

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import (
    DROP,
    FORWARD,
    IN,
    MASQUERADE,
    NAT,
    OUT,
    STRICT,
    Route,
    Rule,
    kernel_routes,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import COMMON
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.registrations import (
    Flows,
    RegisteredItem,
)

from tests.simulator.ros import TALKS
from tests.simulator.state import DEAD, HUNG, Computer, Node, Port, ports, replace_interface, replace_link

NODE_PORTS = (32768, 60999)
ANYWHERE = "*"  # a place that is not compared
NOBODY = IPv4Address("192.168.1.99")


class Fault(NamedTuple):
    """A row: its name, the injection, and the parts, as (kind, mode), of which one is to be named at the place."""

    name: str
    inject: Callable
    components: tuple


# Whom a fault may hit


def computers(state):
    return [name for name, plan in state.fleet.computers.items() if plan.robot]


def gateways(state):
    return [name for name, plan in state.fleet.computers.items() if plan.is_gateway]


def masters(state):
    return [master.computer for master in state.fleet.masters]


def masters_of_several(state):
    """The masters of robots that have other computers with ROS."""
    with_ros = [name for name in computers(state) if name not in state.without_ros]
    robots = [state.fleet.computers[name].robot for name in with_ros]
    return [name for name in masters(state) if robots.count(state.fleet.computers[name].robot) > 1]


def with_ros(state):
    return [name for name in computers(state) if name not in state.without_ros]


def with_discovery(state):
    return [member.name for member in state.fleet.members if member.discovery]


def routed(state):
    """The computers that have routes of the plan."""
    return [name for name in computers(state) if _planned_routes(state.world.machines[name])]


def links(state):
    """The links with more than one computer."""
    return [name for name, found in ports(state.world).items() if len(found) > 1]


def on(whom, change):
    """A fault of one of these computers: `change(state, random, machine)` returns the new state."""

    def inject(state, random):
        names = whom(state)
        if not names:
            return None
        name = random.choice(names)
        changed = change(state, random, state.world.machines[name])
        return None if changed is None else (changed, name)

    return inject


def machine(**fields):
    """Other fields of a machine."""
    return lambda state, random, one: state.replace_machine(replace(one, **fields))


def program(**fields):
    """Other programs beside a roscore."""
    return lambda state, random, one: state.with_robot(state.fleet.computers[one.name].robot, **fields)


def link(choose=links, **fields):
    """Another state of a link."""

    def inject(state, random):
        names = choose(state)
        if not names:
            return None
        name = random.choice(names)
        return replace(state, world=replace_link(state.world, replace(state.world.links[name], **fields))), name

    return inject


def losing(state, random):
    """A link that loses a third more than it does."""
    names = links(state)
    if not names:
        return None
    name = random.choice(names)
    before = state.world.links[name]
    return replace(state, world=replace_link(state.world, replace(before, loss=1 - (1 - before.loss) * 0.7))), name


# Interfaces


def _one_interface(random, one):
    return random.choice([interface for interface in one.interfaces if interface.addresses])


def _readdressed(state, one, interface, address):
    """The machine with another address. Its routes by gateways that it does not reach any more are gone with it."""
    changed = replace_interface(one, replace(interface, addresses=(address,)))
    near = [
        route
        for route in changed.routes
        if route.gateway is None
        or any(route.gateway in own.destination for own in kernel_routes(changed.interface(route.device)))
    ]
    return state.replace_machine(replace(changed, routes=tuple(near)))


def address(state, random, one):
    interface = _one_interface(random, one)
    before = interface.addresses[0]
    return _readdressed(
        state, one, interface, IPv4Interface((before.ip + 50 - int(before.ip) % 10, before.network.prefixlen))
    )


def prefix(state, random, one):
    interface = _one_interface(random, one)
    return _readdressed(
        state, one, interface, IPv4Interface((interface.addresses[0].ip, random.choice((16, 22, 25, 28))))
    )


def mtu(state, random, one):
    return state.replace_machine(
        replace_interface(one, replace(_one_interface(random, one), mtu=random.choice((600, 1400))))
    )


def lossy(state, random, one):
    return state.replace_machine(replace_interface(one, replace(_one_interface(random, one), loss=0.3)))


def down(state, random, one):
    return state.replace_machine(replace_interface(one, replace(_one_interface(random, one), up=False)))


def cable_out(state, random, one):
    return state.replace_machine(replace_interface(one, replace(_one_interface(random, one), link="")))


def duplicate(state, random, one):
    interface = _one_interface(random, one)
    twin = Port("eth0", interface.addresses, interface.link)
    return state.replace_machine(Computer(f"twin of {one.name}", (twin,), kernel_routes(twin)))


# Names


def name(*addresses):
    """One name means something else on a computer; None is the planned address."""

    def change(state, random, one):
        if not one.names:
            return None
        known = random.choice([member.name for member in state.fleet.members])
        meant = tuple(one.names[known][0] if entry is None else IPv4Address(entry) for entry in addresses)
        return state.replace_machine(replace(one, names={**one.names, known: meant}))

    return change


# Routes


def _planned_routes(one):
    return [route for route in one.routes if route.gateway is not None]


def no_route(state, random, one):
    gone = random.choice(_planned_routes(one))
    return state.replace_machine(replace(one, routes=tuple(route for route in one.routes if route is not gone)))


def other_route(state, random, one):
    """Something by hand that is more special than the planned route, or stands in its place."""
    route = random.choice(_planned_routes(one))
    wrong = next(iter(entry.network.broadcast_address - 1 for entry in one.interface(route.device).addresses))
    if route.destination.prefixlen:
        another = replace(route, gateway=wrong)
    else:
        others = [
            entry.network
            for entry in state.fleet.networks
            if all(entry.network != own.destination for own in one.routes)
        ]
        another = Route(random.choice([state.fleet.common_network, *others]), wrong, route.device)
    routes = tuple(entry for entry in one.routes if entry.destination != another.destination)
    return state.replace_machine(replace(one, routes=(*routes, another)))


def second_default(state, random, one):
    defaults = [route for route in one.routes if route.destination.prefixlen == 0]
    device = one.interfaces[0]
    wrong = device.addresses[0].network.broadcast_address - 1
    more = [Route(IPv4Network("0.0.0.0/0"), wrong, device.name, metric) for metric in (100, 200)[: 2 - len(defaults)]]
    return state.replace_machine(replace(one, routes=(*one.routes, *more)))


# What passes through


def settings(**fields):
    """Another setting of all interfaces."""
    return lambda state, random, one: state.replace_machine(
        replace(one, interfaces=tuple(replace(interface, **fields) for interface in one.interfaces))
    )


def rule(chain, protocol="", **fields):
    """A rule of somebody else's packet filter, before all others."""

    def change(state, random, one):
        ports = _ports(state, one, fields.get("ports"))
        if ports is None or (fields.get("group") and state.fleet.transport == "unicast"):
            return None
        group = (IPv4Network(state.fleet.multicast_group),) if fields.get("group") else ()
        made = Rule(
            chain,
            DROP,
            protocol,
            ports,
            destinations=group,
            state="new" if fields.get("new") else "",
            above=fields.get("above", 0),
        )
        return state.replace_machine(replace(one, rules=(made, *one.rules)))

    return change


def _ports(state, one, which):
    """The ports of a word: those of discovery, of its RPC, of the roscore or of nodes."""
    if which is None:
        return 0, 65535
    plan = state.fleet.computers[one.name]
    rpc = [master.rpc_port for master in state.fleet.masters if master.computer == one.name]
    port = {
        "nodes": NODE_PORTS,
        "udp": state.fleet.multicast_port,
        "rpc": rpc[0] if rpc else None,
        "roscore": plan.roscore_port,
    }[which]
    return port if isinstance(port, tuple) or port is None else (port, port)


def masquerade(state, random, one):
    there = [entry for entry in one.interfaces if any(at.ip in state.fleet.common_network for at in entry.addresses)]
    common = there[0]
    return state.replace_machine(replace(one, rules=(Rule(NAT, MASQUERADE, leaving=common.name), *one.rules)))


# Programs and what they were started with


def variable(name, *values):
    """Another value of a variable in the environment file."""

    def change(state, random, one):
        value = random.choice(values)
        variables = {key: kept for key, kept in one.environment.items() if key != name}
        if name != "ROS_MASTER_URI":
            variables = {key: kept for key, kept in variables.items() if key not in ("ROS_HOSTNAME", "ROS_IP")}
        if value is not None:
            variables[name] = value
        return state.replace_machine(replace(one, environment=variables))

    return change


def differing(state, random, one):
    return replace(state, differing={**state.differing, one.name: ("ROS_HOSTNAME",)})


def service_down(state, random, one):
    services = [
        service for service in state.fleet.computers[one.name].services if service in ("address", "connections")
    ]
    return replace(state, down={**state.down, one.name: (random.choice(services),)}) if services else None


def never_set_up(state, random, one):
    """A computer on which site.yml has not run: no names, no routes, no settings, no environment, no services."""
    plan = state.fleet.computers[one.name]
    bare = replace(
        one,
        names={},
        environment={},
        interfaces=tuple(replace(interface, forwarding=False) for interface in one.interfaces),
        routes=tuple(route for route in one.routes if route.gateway is None),
    )
    changed = replace(state.replace_machine(bare), bare=state.bare | {one.name})
    return changed.with_robot(plan.robot, roscore=DEAD, discovery=DEAD, sync=DEAD) if plan.is_master else changed


def group_not_passed_on(state, random, one):
    """The service that passes the group on between the networks of a gateway does not run."""
    if not one.groups:
        return None
    down = {**state.down, one.name: (*state.down.get(one.name, ()), "multicast-routing")}
    return replace(state.replace_machine(replace(one, groups=frozenset())), down=down)


def without_login(state, random, one):
    return replace(state, shut=state.shut | {one.name})


def hidden(state, random, one):
    return replace(state, hidden=state.hidden | {one.name})


def full(state, random, one):
    return replace(state, full=state.full | {one.name})


def clock(state, random, one):
    """Its time server is gone, and it runs away."""
    return replace(
        state.replace_machine(replace(one, clock=random.choice((2.0, -2.0)))),
        undisciplined=state.undisciplined | {one.name},
    )


def switched_off(state, random):
    found = link(up=False)(state, random)
    return found and (replace(found[0], unplugged=found[0].unplugged | {found[1]}), found[1])


def ghost(state, random, one):
    return state.with_robot(state.fleet.computers[one.name].robot, ghosts=("/killed",))


STARTERS = ("shell", "unit", "launch", "container")


def _node_name(state):
    return f"/odom_pub{sum(len(its.people) for its in state.robots.values())}"


def start(choose, whom=with_ros, **more):
    """A node of a person: `choose(state, random, plan)` returns what is not usual of it, or None where nothing can be."""

    def change(state, random, one):
        plan = state.fleet.computers[one.name]
        own = choose(state, random, plan)
        if own is None:
            return None
        at = own.pop("at", plan.robot)
        node = Node(**{"name": _node_name(state), "computer": one.name, "host": one.name, **more, **own})
        return state.with_robot(at, people=(*state.robots[at].people, node))

    return on(whom, change)


def wrong_host(*hosts):
    def choose(state, random, plan):
        host = random.choice(hosts)
        source = "ROS_IP" if host[0].isdigit() else "ROS_HOSTNAME"
        return {"host": host, "source": source, "starter": random.choice(STARTERS)}

    return choose


def other_computer(state, random, plan):
    """The name or address of a computer of another robot, as of a shell that was copied."""
    others = [one for one in state.fleet.members if one.robot != plan.robot]
    if not others:
        return None
    one = random.choice(others)
    host, source = random.choice(((one.name, "ROS_HOSTNAME"), (str(one.address), "ROS_IP")))
    return {"host": host, "source": source}


def other_roscore(state, random, plan):
    """A node on a computer of one robot, at the roscore of another."""
    others = [robot for robot in state.robots if robot != plan.robot]
    if not others or len(state.fleet.computers) > 12:
        return None
    robot = random.choice(others)
    return {"at": robot, "master": f"http://{state.master(robot)}:11311/"}


def docker(state, random, one):
    """A node that announces the address of a bridge of containers."""
    bridge = Port("docker0", (IPv4Interface("172.17.0.1/16"),), "")
    plan = state.fleet.computers[one.name]
    node = Node(_node_name(state), one.name, random.choice(("172.17.0.1", "172.17.0.2")))
    changed = state.replace_machine(replace(one, interfaces=(*one.interfaces, bridge)))
    return changed.with_robot(plan.robot, people=(*state.robots[plan.robot].people, node))


def twin(state, random):
    """A node name that two robots have."""
    first, second = random.sample(sorted(state.robots), 2)
    if not _crosses(state, first, second, "/chatter", "/twin"):
        return None
    return state.with_robot(first, node="/twin").with_robot(second, node="/twin"), f"{first}|{second}"


def _crosses(state, one, other, topic, node):
    """Return True if a publisher is exchanged between two robots; else it concerns nobody what it is."""
    flows, item = Flows(state.fleet), RegisteredItem("publisher", topic, node)
    return any(flows.rules(*way).passes(item, TALKS) for way in ((one, other), (other, one)))


def definitions(state, random):
    """Another definition of a message on one robot."""
    robot = random.choice(sorted(state.robots))
    others = [other for other in state.robots if other != robot]
    if not any(_crosses(state, robot, other, "/chatter", f"/{robot}/talker") for other in others):
        return None
    return state.with_robot(robot, sums={TALKS: "0" * 32}), robot


def stranger(state, random):
    if state.fleet.belonging.strangers == "allow":
        return None
    return replace(state, strangers=("192.168.1.240",)), ANYWHERE


def other_group(state, random, one):
    robot = state.fleet.computers[one.name].robot
    return state.with_robot(robot, group="239.1.2.3")


def other_port(state, random, one):
    robot = state.fleet.computers[one.name].robot
    return state.with_robot(robot, port=state.robots[robot].port + 1)


def pruned(state, random):
    if state.fleet.transport == "unicast":
        return None
    return link(lambda state: [COMMON], pruned=frozenset({state.fleet.multicast_group}))(state, random)


# Without the talker of that computer, all its nodes look the same.
FENCES = (("filter", "nodes in"), ("filter", "nodes"))
FAULTS = (
    Fault("computer off", on(computers, machine(on=False)), (("computer", "off"),)),
    Fault("no login", on(computers, without_login), (("computer", "login"), ("computer", "off"))),
    Fault("another address", on(computers, address), (("interface", "address"),)),
    Fault("another prefix length", on(computers, prefix), (("interface", "prefix"),)),
    Fault("small MTU", on(computers, mtu), (("interface", "mtu"),)),
    Fault("interface down", on(computers, down), (("link", "down"),)),
    Fault("cable out", on(computers, cable_out), (("link", "down"),)),
    Fault("duplicate address", on(computers, duplicate), (("interface", "duplicate"),)),
    Fault("name on loopback", on(computers, name("127.0.1.1")), (("names", "loopback"),)),
    Fault("name with an old address", on(computers, name("192.168.1.77")), (("names", "old"),)),
    Fault(
        "name with two addresses", on(computers, name(None, "192.168.1.77")), (("names", "several"), ("names", "own"))
    ),
    Fault("name unknown", on(computers, name()), (("names", "unknown"),)),
    Fault("no route", on(routed, no_route), (("route", "missing"),)),
    Fault("another route", on(routed, other_route), (("route", "other"),)),
    Fault("two default routes", on(computers, second_default), (("route", "defaults"),)),
    Fault("forwarding off", on(gateways, settings(forwarding=False)), (("forwarding", "off"),)),
    Fault(
        "large packets not forwarded",
        on(gateways, rule(FORWARD, above=1000)),
        (("forwarding", "large"), ("filter", "forward")),  # the latter if the rules were read
    ),
    Fault("strict reverse path", on(gateways, settings(rp_filter=STRICT)), (("reverse_path", "strict"),)),
    Fault("filter of what is forwarded", on(gateways, rule(FORWARD)), (("filter", "forward"),)),
    Fault("masquerading", on(gateways, masquerade), (("translation", "on"),)),
    Fault("filter of all", on(computers, rule(IN, new=True)), (("filter", "all in"), ("filter", "all"))),
    Fault("filter of ICMP", on(computers, rule(IN, "icmp")), (("filter", "icmp in"), ("filter", "icmp"))),
    Fault("filter of UDP", on(with_discovery, rule(IN, "udp", ports="udp")), (("filter", "udp in"), ("filter", "udp"))),
    Fault(
        "filter of UDP out",
        on(with_discovery, rule(OUT, "udp", ports="udp")),
        (("filter", "udp out"), ("filter", "udp")),
    ),
    Fault(
        "filter of the group",
        on(with_discovery, rule(IN, "udp", group=True)),
        (("filter", "group in"), ("filter", "group")),
    ),
    Fault(
        "filter of RPC", on(masters, rule(IN, "tcp", ports="rpc", new=True)), (("filter", "rpc in"), ("filter", "rpc"))
    ),
    Fault(
        "filter of the roscore",
        on(masters_of_several, rule(IN, "tcp", ports="roscore", new=True)),
        (("filter", "roscore in"), ("filter", "roscore")),
    ),
    Fault(
        "filter of nodes",
        on(with_ros, rule(IN, "tcp", ports="nodes", new=True)),
        (("filter", "nodes in"), ("filter", "nodes")),
    ),
    Fault(
        "filter of nodes out",
        on(with_ros, rule(OUT, "tcp", ports="nodes", new=True)),
        (("filter", "nodes out"), ("filter", "nodes")),
    ),
    Fault("network dead", link(up=False), (("network", "dead"),)),
    Fault("switch off", switched_off, (("network", "dead"),)),
    Fault("clients kept apart", link(apart=True), (("network", "dead"),)),
    Fault("group pruned", pruned, (("network", "multicast"),)),
    Fault("large packets lost", link(largest=1000), (("network", "large"),)),
    Fault("a third lost", losing, (("network", "loss"),)),
    Fault("a third lost at a computer", on(computers, lossy), (("link", "loss"),)),
    Fault("clock off", on(masters, clock), (("clock", "off"),)),
    Fault("environment not the file's", on(masters, differing), (("environment", "service"),)),
    Fault("ROS_HOSTNAME localhost", on(with_ros, variable("ROS_HOSTNAME", "localhost")), (("environment", "shell"),)),
    Fault("ROS_IP wrong", on(with_ros, variable("ROS_IP", "192.168.1.77", "127.0.0.1")), (("environment", "shell"),)),
    Fault(
        "ROS_MASTER_URI wrong",
        on(with_ros, variable("ROS_MASTER_URI", "http://192.168.1.77:11311", "http://elsewhere:11311")),
        (("environment", "shell"), ("environment", "service")),
    ),
    Fault("roscore dead", on(masters, program(roscore=DEAD)), (("roscore", "dead"),)),
    Fault("roscore hung", on(masters, program(roscore=HUNG)), (("roscore", "hung"),)),
    Fault("roscore on localhost", on(masters, program(calls_itself="localhost")), (("roscore", "name"),)),
    Fault("discovery dead", on(masters, program(discovery=DEAD)), (("discovery", "dead"),)),
    Fault("discovery hung", on(masters, program(discovery=HUNG)), (("discovery", "hung"),)),
    Fault("discovery on another group", on(masters, other_group), (("discovery", "group"),)),
    Fault("discovery on another port", on(masters, other_port), (("discovery", "group"),)),
    Fault("sync dead", on(masters, program(sync=DEAD)), (("sync", "dead"),)),
    # One that hangs and one that does not follow leave the same behind.
    Fault("sync hung", on(masters, program(sync=HUNG)), (("sync", "hung"), ("sync", "stale"))),
    Fault("sync stale", on(masters, program(stale=True)), (("sync", "stale"), ("sync", "hung"))),
    Fault(
        "sync with other filters",
        on(masters, program(takes=False)),
        (("sync", "configuration"),),
    ),
    Fault("discovery with another declaration", on(masters, program(gives=False)), (("discovery", "configuration"),)),
    Fault("names for root alone", on(computers, hidden), (("names", "rights"),)),
    Fault("disk full", on(computers, full), (("computer", "disk"),)),
    Fault("a service down", on(computers, service_down), (("service", "down"),)),
    Fault("group not passed on", on(gateways, group_not_passed_on), (("service", "down"),)),
    Fault("ghosts", on(masters, ghost), (("registration", "ghost"),)),
    Fault("a node at loopback", start(wrong_host("127.0.0.1", "127.0.1.1", "localhost")), (("node", "loopback"),)),
    Fault("a node with another name", start(wrong_host("laptop7", "ubuntu-2")), (("node", "name"),)),
    Fault("a node with another address", start(wrong_host("10.9.8.7", "192.168.77.3")), (("node", "address"),)),
    Fault(
        "a node without a registration",
        start(lambda _state, random, _plan: {"starter": random.choice(STARTERS)}, registered=False),
        (("node", "unregistered"),),
    ),
    Fault("a node with the place of another robot", start(other_computer), (("node", "name"), ("node", "address"))),
    Fault("a node at docker0", on(with_ros, docker), (("node", "interface"),)),
    Fault("a node at the roscore of another robot", start(other_roscore), (("node", "robot"),)),
    Fault(
        "a node without a roscore",
        start(lambda *_all: {}, master="http://old-pc:11311/", registered=False),
        (("node", "master"),),
    ),
    Fault(
        "a node in a network of its own",
        start(lambda *_all: {}, starter="container", apart=True),
        (("node", "network"),),
    ),
    Fault("services elsewhere", start(lambda *_all: {}, services="127.0.0.1"), (("node", "services"),)),
    Fault("a node that hangs", start(lambda *_all: {}, hung=True), (("node", "hung"),)),
    Fault("a node behind a packet filter", start(lambda *_all: {}, fenced=True), (("node", "fenced"), *FENCES)),
    Fault("node names twice", twin, (("registration", "twin"),)),
    Fault("other message definitions", definitions, (("messages", "differ"),)),
    Fault("a stranger", stranger, (("stranger", "present"),)),
    Fault("site.yml never ran", on(computers, never_set_up), (("set_up", "never"),)),
)
BY_NAME = {fault.name: fault for fault in FAULTS}
