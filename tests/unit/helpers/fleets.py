# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Fleets for the tests of the verification: plans by the planner itself, and what computers see where everything works.

A test changes some observations with `update` and looks at the findings that are not ok.
"""

import zlib
from dataclasses import replace

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import read as fleet_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import plan as plan_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.preflight import MachineState
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks import engine
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import OK
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context import registrations
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context import ways as ways_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose import diagnosis
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    Claim,
    ClockState,
    DatagramCounts,
    DefaultRoute,
    Disk,
    Exchange,
    FilterState,
    ForwardingInterface,
    ForwardingSettings,
    GivenTopics,
    GroupMembership,
    HeardTopic,
    Icmp,
    IcmpRound,
    Import,
    ListedMaster,
    LocalCaller,
    MasterList,
    Multicast,
    NodeConnection,
    NodeParameters,
    Observation,
    Ping,
    Probe,
    RegisteredService,
    RegisteredTopic,
    RoscoreAnswer,
    SeenMaster,
    SeenMember,
    SendErrors,
    ServiceState,
    Talker,
    TargetRoute,
    TopicPublisher,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome

ONE, TWO = "kobuki1computer", "kobuki2computer"


def plan(robots=2, computers=1, exports=None, **variables):
    """The plan of a fleet of robots kobuki1, kobuki2, ... with addresses from 192.168.1.1 on; `exports` by robot."""
    hosts = {
        f"kobuki{n}": [f"kobuki{n}computer" + (f"-{c}" if c else "") for c in range(computers)]
        for n in range(1, robots + 1)
    }
    names = [host for of_robot in hosts.values() for host in of_robot]
    shared = {"multimaster_common_network": "192.168.0.0/16", "multimaster_multicast_group": "226.0.0.0", **variables}
    values = {
        host: {
            **shared,
            "multimaster_address": f"192.168.{1 + n // 200}.{1 + n % 200}",
            "multimaster_master": f"{host.partition('computer')[0]}computer",
            **({"multimaster_endpoint": f"172.16.0.{1 + n}"} if "multimaster_tunnel" in variables else {}),
            **({} if exports is None else {"multimaster_exports": exports.get(host.partition("computer")[0], [])}),
        }
        for n, host in enumerate(names)
    }
    return plan_module.fleet_plan(fleet_module.read_fleet(fleet_module.Inventory(robots=hosts, variables=values)))


def behind_gateways(computers):
    """The inventory of so many computers: robots of four, each with a network of its own behind the first one, and packet filters."""
    robots, values = {}, {}
    for number in range(computers):
        robot, place = divmod(number, 4)
        gateway, name = f"robot{robot}-0", f"robot{robot}-{place}"
        robots.setdefault(f"robot{robot}", []).append(name)
        values[name] = {
            "multimaster_common_network": "10.1.0.0/16",
            "multimaster_firewall": "fleet",
            "multimaster_network": f"10.2.{robot}.0/24",
            "multimaster_gateway": gateway,
            "multimaster_common_address": f"10.1.{robot // 200}.{1 + robot % 200}",
            "multimaster_master": gateway,
            "multimaster_address": f"10.2.{robot}.{1 + place}",
        }
    return fleet_module.Inventory(robots=robots, variables=values)


# Section 4 of the report: Fig. 10 and 12, with a router that is a computer.
ROBOTS = {
    "tibi": (11, 201, "tibi-visio", {"tibi-nav": 100, "tibi-visio": 101, "tibi-monitor": 202}),
    "dabo": (10, 202, "dabo-nav", {"dabo-nav": 100, "dabo-visio": 101, "dabo-monitor": 202}),
    "car": (12, 203, "car-visio", {"car-nav": 100, "car-visio": 101, "car-ext": 102}),
}
INNER_TIBI, INNER_CAR = ["tibi-nav", "tibi-monitor"], ["car-nav", "car-ext"]


def fig12(**variables):
    """The plan of the three robots; one robot may have only some of its computers in the tests' interest."""
    values = {
        host: {
            "multimaster_common_network": "192.168.1.0/24",
            "multimaster_multicast_group": "239.255.0.1",
            "multimaster_network": f"192.168.{network}.0/24",
            "multimaster_gateway": f"{robot}-visio",
            "multimaster_common_address": f"192.168.1.{common}",
            "multimaster_master": master,
            "multimaster_address": f"192.168.{network}.{address}",
            **variables,
        }
        for robot, (network, common, master, hosts) in ROBOTS.items()
        for host, address in hosts.items()
    }
    return plan_module.fleet_plan(
        fleet_module.read_fleet(
            fleet_module.Inventory(
                robots={robot: list(hosts) for robot, (*_numbers, hosts) in ROBOTS.items()},
                variables={**values, "router": {"multimaster_address": "192.168.1.1"}},
                routers=["router"],
            )
        )
    )


SEALED, COMPANION = "hsrb", "hsr-pc"


def sealed(**variables):
    """The plan of two robots, of which one has its roscore on a sealed computer; `variables` are of that robot."""
    shared = {"multimaster_common_network": "192.168.1.0/24", "multimaster_advertise": "address"}
    own = {
        "multimaster_address": "192.168.1.41",
        "multimaster_master": SEALED,
        "multimaster_sealed": {SEALED: {"address": "192.168.1.40", "aliases": ["hsrb.local"]}},
    }
    values = {COMPANION: {**shared, **own, **variables}, ONE: {**shared, "multimaster_address": "192.168.1.229"}}
    robots = {"hsr": [COMPANION], "kobuki1": [ONE]}
    return plan_module.fleet_plan(fleet_module.read_fleet(fleet_module.Inventory(robots=robots, variables=values)))


def outside(robot):
    return [host for name, (*_numbers, hosts) in ROBOTS.items() if name != robot for host in hosts]


# Good observations


def good(fleet, name):
    """Make the observation of a computer in a fleet in which everything works."""
    own = fleet.computers[name]
    me = next((member for member in fleet.members if member.name == name), None)
    return Observation(
        multicast=good_multicast(fleet, me, own) if me and me.discovery else None,
        probe=router_probe(fleet, own) if own.is_router else good_probe(fleet, me, own),
        packet_filter=FilterState(msg="The rules of nftables were right."),
        found=MachineState(),
    )


def mac(computer):
    """A hardware address for each name."""
    return "02:" + ":".join(f"{byte:02x}" for byte in zlib.crc32(computer.encode()).to_bytes(5, "big"))


def others_of(fleet, name):
    return [member for member in fleet.members if member.name != name]


def network_part(fleet, own):
    """The parts of multimaster_verify that the router has, too."""
    layout = ways_module.Ways(fleet)
    members = []
    for other in others_of(fleet, own.computer):
        way = layout.way(own, other.name)
        members.append(
            SeenMember(
                other.name,
                str(other.address),
                addresses=(str(other.address),),
                route=TargetRoute("eth0", source=str(way.source), gateway=str(way.next_hop) if way.next_hop else None),
                discovery_route=_outer_route(fleet, own, other),
                ping_address=Ping(True, 0.4, outcome=Outcome.ANSWERED),
                ping_name=Ping(True, 0.4, outcome=Outcome.ANSWERED),
                ping_large=Ping(True, 0.5, outcome=Outcome.ANSWERED),
                loss=0.0,
                user_addresses=(str(other.address),),
                neighbour="" if way.next_hop else mac(other.name),
            )
        )
    interfaces = [
        ForwardingInterface(
            f"eth{number}",
            (str(entry.address),),
            forwarding=1,
            rp_filter=2,
            send_redirects=int(not own.is_router),
            prefixes=(entry.network.prefixlen,),
            mtu=1500,
            mac=mac(own.computer),
        )
        for number, entry in enumerate(own.networks)
    ]
    return {
        "members": (SeenMember(own.computer, str(own.address), addresses=(str(own.address),)), *members),
        "claims": tuple(_claims(fleet, own)),
        "default_routes": (DefaultRoute("eth0", gateway="192.168.1.254"),),
        "forwarding": ForwardingSettings(int(own.is_gateway or own.is_router), tuple(interfaces), 0),
    }


def _claims(fleet, own):
    """Nobody answers for the own addresses, and the others on each network for theirs."""
    for number, entry in enumerate(own.networks):
        yield Claim(str(entry.address), f"eth{number}")
        for other in others_of(fleet, own.computer):
            near = {other.address, other.discovery_address}
            yield from (
                Claim(str(address), f"eth{number}", (mac(other.name),)) for address in near if address in entry.network
            )


def _outer_route(fleet, own, other):
    """The route to the other address of a gateway; its own computers leave by it, as to everybody else outside."""
    if other.discovery_address == other.address:
        return None
    direct = any(other.discovery_address in entry.network for entry in own.networks)
    hop = None if direct else str(fleet.gateways[own.robot].address)
    return TargetRoute("eth0", source=str(own.address), gateway=hop)


def router_probe(fleet, own):
    return Probe(
        **network_part(fleet, own),
        roscore=RoscoreAnswer(error="not looked at"),
        ros_missing="not looked at",
        exchange=Exchange(error="not looked at"),
    )


def _route_to(layout, own, master):
    """The route to a discovery node, whose address may be in another network than the robot's."""
    if own.computer == master.computer or any(master.address in entry.network for entry in own.networks):
        return TargetRoute("eth0", source=str(own.address))
    behind = (
        layout.gateways[own.robot].address if own.common_address is None else layout.way(own, master.computer).next_hop
    )
    return TargetRoute("eth0", source=str(own.address), gateway=str(behind))


def heard_topics(fleet, me, flows):
    """The talkers of all others, as this computer hears them."""
    return tuple(
        HeardTopic(
            other.name,
            "/multimaster_verify/" + other.name,
            publishers=(TopicPublisher("/talker", f"http://{other.name}:41233/"),),
            heard=True,
            text="run " + other.name,
            seconds=0.1,
        )
        for other in others_of(fleet, me.name)
        if not fleet.computers[other.name].sealed
        and not (other.robot != me.robot and flows.declares_nothing(other.robot, me.robot))
    )


def good_probe(fleet, me, own):
    flows, layout = registrations.Flows(fleet), ways_module.Ways(fleet)
    uri = own.environment["ROS_MASTER_URI"]
    return Probe(
        **network_part(fleet, own),
        masters=tuple(
            SeenMaster(
                master.computer,
                str(master.address),
                master.rpc_port,
                open=True,
                connect_ms=0.3,
                clock_offset_s=0.001,
                clock_uncertainty_s=0.001,
                route=_route_to(layout, own, master),
                outcome=Outcome.OPEN,
                roscore="open",
                roscore_outcome=Outcome.OPEN,
            )
            for master in fleet.masters
        ),
        parameters=NodeParameters(("master_discovery", "master_sync")) if own.is_master else NodeParameters(),
        clock=ClockState(True),
        disks=(Disk("/var/lib", 10**9, 10**6),),
        name_sources=("files", "dns"),
        roscore=RoscoreAnswer(uri, uri + "/", outcome=Outcome.ANSWERED),
        list_masters=MasterList(
            tuple(ListedMaster(master.name, master.uri, True, master.monitor_uri) for master in fleet.masters), 0.7
        ),
        topics=heard_topics(fleet, me, flows),
        services=tuple(
            ServiceState(service, f"multimaster-{service}.service", "loaded", "active", "running")
            for service in own.all_services
        ),
        sources=(own_source(fleet, own),) if own.is_master else (),
        exchange=exchange(fleet, own.robot) if own.is_master else Exchange(error="not looked at"),
        talker=Talker(),
    )


def good_multicast(fleet, me, own):
    layout = ways_module.Ways(fleet)
    others = others_of(fleet, me.name)
    return Multicast(
        udp=tuple(
            DatagramCounts(
                other.name,
                str(other.discovery_address),
                multicast=other.multicast and me.multicast,
                heard_from=other.multicast and me.multicast,
                heard=30,
                source_address=str(other.discovery_address),
                own_source_address=str(me.discovery_address),
                loss=0.0,
                unicast=True,
            )
            for other in others
            if other.discovery
        ),
        callers=tuple(
            LocalCaller(str(layout.way(plan, me.name).source), 3)
            for caller, plan in fleet.computers.items()
            if caller != me.name and not plan.sealed
        ),
        memberships=tuple(
            GroupMembership(f"eth{number}", str(fleet.multicast_group))
            for number, entry in enumerate(own.networks)
            if entry.network == fleet.common_network
        ),
        icmp=Icmp("224.0.0.1", rounds=(IcmpRound(1, tuple(other.name for other in others)),)),
        send_errors=SendErrors(),
    )


TALKS = "diagnostic_msgs/DiagnosticStatus"  # of a topic that all robots publish: of this type it is meant
SUMS = {TALKS: "d0ce08bc6e5ba34c7754f563a9cabaf1", "nav_msgs/Odometry": "cd5e73d190d741a2f92e81eda573aca7"}


def topic(name, kind, publishers=(), subscribers=()):
    return RegisteredTopic(name, kind, tuple(publishers), tuple(subscribers))


def registered(fleet, robot):
    """List the registrations of a robot's nodes: a base with a service, a talker on a topic that all have, and rosout."""
    base, talker = f"/{robot}/base", f"/{robot}/talker"
    topics = (
        topic(f"/{robot}/odom", "nav_msgs/Odometry", [base]),
        topic("/chatter", TALKS, [talker], [base]),
        topic("/rosout", "rosgraph_msgs/Log", [base, talker], ["/rosout"]),
        *(
            topic(f"/multimaster_verify/{name}", "std_msgs/String", [f"/multimaster_verify_talker_{name}"])
            for name in talkers_of(fleet, robot)
        ),
    )
    return topics, (RegisteredService(f"/{robot}/reset", base), RegisteredService(f"{base}/get_loggers", base))


def talkers_of(fleet, robot):
    return [
        member.name for member in fleet.members if member.robot == robot and not fleet.computers[member.name].sealed
    ]


def own_source(fleet, own):
    """Tell what the own discovery node has of the own talkers: all."""
    topics = tuple(f"/multimaster_verify/{name}" for name in talkers_of(fleet, own.robot))
    return GivenTopics(own.computer, topics, topics, outcome=Outcome.ANSWERED)


def imported(fleet, flows, master, robot):
    """List the registrations that a robot gets of another one, given by its master."""
    its_topics, its_services = registered(fleet, master.robot)
    rules = flows.rules(master.robot, robot)

    def passing(kind, entry, nodes):
        return [
            node for node in nodes if rules.passes(registrations.RegisteredItem(kind, entry.name, node), entry.type)
        ]

    topics = [
        topic(
            entry.name,
            entry.type,
            passing("publisher", entry, entry.publishers),
            passing("subscriber", entry, entry.subscribers),
        )
        for entry in its_topics
    ]
    services = [
        entry
        for entry in its_services
        if rules.passes(registrations.RegisteredItem("service", entry.name, entry.node), "")
    ]
    return Import(
        master.uri, tuple(entry for entry in topics if entry.publishers or entry.subscribers), tuple(services)
    )


def exchange(fleet, robot):
    """Fill the roscore of a robot where everything works: what the plan lets pass, and one connection with each robot."""
    flows = registrations.Flows(fleet)
    topics, services = registered(fleet, robot)
    imports, connections = [], []
    for master in fleet.masters:
        if master.robot == robot:
            continue
        part = imported(fleet, flows, master, robot)
        if part.topics or part.services:
            imports.append(part)
        if any(entry.name == "/chatter" and entry.publishers for entry in part.topics):
            talker = f"/{master.robot}/talker"
            connections.append(
                NodeConnection(f"/{robot}/base", "/chatter", "in", talker, master.computer, master.robot)
            )
    for entry in topics:
        update(entry, md5sum=SUMS.get(entry.type, ""))
    return Exchange(topics=topics, services=services, imports=tuple(imports), connections=tuple(connections))


# Changes, and what is found


def update(record, **values):
    """Change the fields of a frozen record in place; lists become tuples."""
    for name, value in values.items():
        getattr(record, name)  # an unknown name is an AttributeError
        object.__setattr__(record, name, tuple(value) if isinstance(value, list) else value)


def of(entries, name, key="name"):
    return next(entry for entry in entries if getattr(entry, key) == name)


def without(entries, name, key="name"):
    return tuple(entry for entry in entries if getattr(entry, key) != name)


def observed(fleet):
    """A good observation of every computer."""
    return {name: good(fleet, name) for name, of_it in fleet.computers.items() if not of_it.sealed}


def judged(fleet, seen):
    """The findings on these observations."""
    return list(engine.Verification(CHECKS, fleet, seen).rows())


def evaluate(change=None, fleet=None):
    """The findings on two good robots, or another fleet, after a change of the observations {computer: observation}."""
    fleet = fleet or plan()
    seen = observed(fleet)
    if change:
        change(seen)
    return judged(fleet, seen)


def notable(findings):
    return {(finding.check, finding.observer, finding.target): finding for finding in findings if finding.verdict != OK}


def no_answer(error="no answer to 3 requests", outcome=Outcome.NO_ANSWER, reporter=""):
    return Ping(error=error, outcome=outcome, reporter=reporter)


def silent(seen, observers, targets):
    """Nothing of an observer reaches any of the targets: ARP, pings, datagrams, connections. What is registered stays."""
    for observer in observers:
        for target in targets:
            if target != observer:
                _silent(seen, observer, target)


def no_arp(seen, target, observers=()):
    """Nobody hears an answer of the target to the question who has its addresses."""
    for name in observers or seen:
        probe = seen[name].probe
        if probe:
            claims = [replace(one, macs=tuple({*one.macs} - {mac(target)})) for one in probe.claims]
            update(probe, claims=claims)


def _silent(seen, observer, target):
    probe, multicast = seen[observer].probe, seen[observer].multicast
    member = of(probe.members, target)
    no_arp(seen, target, [observer])
    update(member, ping_address=no_answer(), ping_name=no_answer(), ping_large=None, loss=1.0)
    for entry in probe.topics:
        if entry.computer == target:
            update(entry, heard=False, error="nothing")
    for entry in probe.masters:
        if entry.computer == target:
            update(entry, open=False, error="no answer within 3 s", clock_offset_s=None, clock_error="")
    for entry in multicast.udp if multicast else ():
        if entry.name == target:
            update(entry, heard_from=False, source_address=None, unicast=None, own_source_address=None)
    its = seen[target].multicast
    if its and member.route and member.route.source:
        update(its, callers=[entry for entry in its.callers if entry.address != member.route.source])


def diagnose(fleet, seen):
    """The diagnosis of the observations of a fleet."""
    verification = engine.Verification(CHECKS, fleet, seen)
    return diagnosis.explain_rows(verification, [row for row in verification.rows() if row.verdict != OK])


def diagnosed(change=None, fleet=None):
    """The diagnosis of good observations after a change."""
    fleet = fleet or plan()
    seen = observed(fleet)
    if change:
        change(seen)
    return diagnose(fleet, seen)


def components(found):
    """The components of the findings, as (kind, place, mode)."""
    return [(entry.component.kind, entry.component.place_text, entry.component.mode) for entry in found.findings]


def assert_told(change, check, verdict, *component, fleet=None):
    """The check has rows with this verdict, and the only finding is the component (kind, place, mode)."""
    fleet = fleet or plan()
    rows = notable(evaluate(change, fleet)).values()
    assert verdict in {row.verdict for row in rows if row.check == check}
    found = diagnosed(change, fleet)
    assert components(found) == [component] and not found.unexplained, found
    entry = found.findings[0]
    assert entry.verdict == max((row.verdict for row in rows), key=["unknown", "warning", "failed"].index)
    assert "{" not in entry.sentence() and entry.look


# Faults that several tests bring about


def lost_route(seen):
    """tibi-nav has lost its default route."""
    silent(seen, ["tibi-nav"], outside("tibi"))
    silent(seen, [*outside("tibi"), "router"], ["tibi-nav"])
    for target in outside("tibi"):
        update(
            of(seen["tibi-nav"].probe.members, target).route,
            device=None,
            source=None,
            gateway=None,
            error="Network is unreachable",
        )


def wall(seen):
    """A firewall on tibi-visio drops what is forwarded."""
    silent(seen, INNER_TIBI, outside("tibi"))
    silent(seen, [*outside("tibi"), "router"], INNER_TIBI)


def second_default_route(seen):
    """A second default route of car-ext, as DHCP brings it, comes first."""
    probe = seen["car-ext"].probe
    for target in outside("car"):
        update(of(probe.members, target).route, gateway="192.168.12.1")
    update(probe, default_routes=[*probe.default_routes, DefaultRoute("eth0", gateway="192.168.12.1", metric="100")])


def drop_import(seen, computer, topic):
    """The roscore of a computer has not registered a topic of other robots."""
    for part in seen[computer].probe.exchange.imports:
        update(part, topics=without(part.topics, topic))


def unheard(seen, **values):
    """The first robot does not hear the talker of the second one, and has not registered it."""
    drop_import(seen, ONE, f"/multimaster_verify/{TWO}")
    update(of(seen[ONE].probe.topics, TWO, "computer"), heard=False, publishers=(), **values)
