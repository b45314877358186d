# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The plan of a fleet: only here its layout becomes the configuration of its computers."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from ipaddress import IPv4Network

from .._base.features import load_hooks
from .._inventory.model import Computer, Fleet, Robot, Router
from . import membership, model, parameters, providers
from .hooks import PlanHooks

# The parts of multimaster_info that preflight needs: of every computer, and of those with ROS.
LOOKED_AT = ("system", "owned", "interfaces", "ways", "routing", "forwarding", "filters")
LOOKED_AT_WITH_ROS = ("ros", "packages", "ports", "exports", "sshd", "environment")


def fleet_plan(fleet: Fleet) -> model.FleetPlan:
    """Return the plan of the fleet; the router has an entry among the computers, too."""
    computers = {
        computer.name: _plan_computer(fleet, robot, computer) for robot in fleet.robots for computer in robot.computers
    }
    if fleet.router and fleet.router.name:
        computers[fleet.router.name] = _plan_router(fleet, fleet.router)
    members = tuple(_make_member(fleet, robot, computer) for robot in fleet.robots for computer in robot.computers)
    belonging = membership.make_membership(fleet)
    return model.FleetPlan(
        hosts_entries=tuple(
            model.HostsEntry(computer.address, (computer.name, *computer.variables.aliases))
            for computer in fleet.computers
        ),
        masters=tuple(_make_master(fleet, robot) for robot in fleet.robots),
        flows=_flows(fleet),
        common_network=fleet.variables.common_network,
        networks=tuple(
            model.RobotNetwork(
                robot=robot.name,
                network=robot.network,
                gateway=robot.gateway.address,
                common_address=robot.gateway.common_address,
                device=not robot.gateway.name,
            )
            for robot in fleet.robots
            if robot.gateway
        ),
        router=fleet.router,
        transport=fleet.variables.transport,
        multicast_group=fleet.variables.multicast_group,
        multicast_port=fleet.variables.multicast_port,
        multicast_routing=fleet.multicast_routing,
        members=members,
        listeners=_listeners(members),
        let_in=_let_in(fleet, belonging),
        belonging=belonging,
        computers=computers,
    )


# The common values of all computers


def _make_master(fleet: Fleet, robot: Robot) -> model.Master:
    address, port = robot.companion.discovery_address, robot.variables.rpc_port
    return model.Master(
        robot=robot.name,
        computer=robot.companion.name,
        address=address,
        name=robot.master_name,
        uri=membership.master_uri(fleet, robot),
        monitor_uri=f"http://{address}:{port}",
        rpc_port=port,
        declared=robot.variables.exports is not None,
        roscore=robot.master.address if robot.master.sealed else None,
    )


def _flows(fleet: Fleet) -> tuple[model.PlannedFlow, ...]:
    """Return the declared flows, the receivers by name."""
    robots = [robot.name for robot in fleet.robots]
    return tuple(
        model.PlannedFlow(
            givers=flow.givers,
            to=flow.to or tuple(robot for robot in robots if robot not in flow.givers),
            topics=flow.topics,
            services=flow.services,
            parameters=tuple(flow.namespace + name for name in flow.parameters) or None,  # as the receivers have them
        )
        for flow in fleet.flows
    )


def _make_member(fleet: Fleet, robot: Robot, computer: Computer) -> model.Member:
    is_master = computer == robot.companion
    routed = fleet.multicast_routing != "none" and robot.gateway is not None and bool(robot.gateway.name)
    in_common_network = computer.common_address is not None
    return model.Member(
        name=computer.name,
        robot=robot.name,
        address=computer.address,
        network=robot.network,
        discovery_address=computer.discovery_address,
        discovery=not computer.sealed and (is_master or in_common_network),
        multicast=not computer.sealed and fleet.overlay is None and (in_common_network or (is_master and routed)),
    )


def _listeners(members: Iterable[model.Member]) -> tuple[model.Listener, ...]:
    """Return the computers that measure datagrams: those of discovery, first those that hear the group."""
    listeners = (
        model.Listener(member.name, member.discovery_address, member.multicast)
        for member in members
        if member.discovery
    )
    return tuple(sorted(listeners, key=lambda listener: not listener.multicast))


# The values of one computer


def _plan_computer(fleet: Fleet, robot: Robot, computer: Computer) -> model.ComputerPlan:
    """Return the plan of a computer: of a sealed one its addresses, and the user-managed routes there."""
    plan = model.ComputerPlan(
        computer=computer.name,
        robot=robot.name,
        address=computer.address,
        common_address=computer.common_address,
        network=robot.network,
        networks=_interfaces(fleet, robot, computer),
        roscore_port=robot.variables.roscore_port,
    )
    if computer.sealed:
        expected = _list_expected_routes(fleet, robot, computer)
        return replace(plan, roscore="existing", routes_expected=expected, sealed=True)
    return _configure_computer(fleet, robot, computer, plan)


def _configure_computer(fleet: Fleet, robot: Robot, computer: Computer, plan: model.ComputerPlan) -> model.ComputerPlan:
    is_master = computer == robot.companion
    is_gateway = bool(list_behind(robot, computer))
    features = _list_features(fleet, robot, computer)
    existing = robot.variables.routes == "existing" or _is_carried(features.values())
    expected = _list_expected_routes(fleet, robot, computer) if existing else ()
    metrics = parameters.writes_metrics(robot) and is_master
    relay = parameters.relay(fleet, robot) if is_master else None
    return replace(
        plan,
        is_master=is_master,
        is_gateway=is_gateway,
        roscore=_roscore(robot),
        ros_setup=computer.variables.ros_setup,
        shells=computer.variables.shells,
        sysctl=_sysctl(fleet, is_gateway, _is_hub(fleet, computer)),
        routes=() if existing else _routes(fleet, robot, computer),
        routes_expected=expected,
        look_at=_look_at(fleet, robot, is_master, expected, metrics),
        firewall=_firewall(fleet, robot, computer, features.values()),
        features=features,
        environment=_environment(fleet, robot, computer),
        ports=_ports(fleet, robot, relay) if is_master else (),
        services=_services(robot, is_master, features.values(), relay),
        metrics_folder=robot.variables.metrics_folder if metrics else None,
        provider=robot.variables.provider,
        discovery=parameters.discovery(fleet, robot) if is_master else {},
        sync=parameters.sync(fleet, robot) if is_master else {},
        relay=relay,
        crossing=(parameters.list_own_crossing(fleet, robot) or None) if is_master else None,
        limits=tuple(parameters.list_limits(fleet, robot)) if is_master else (),
        listens=is_master or computer.common_address is not None,
    )


def _list_features(fleet: Fleet, robot: Robot, computer: Computer) -> dict[str, model.PlanPart]:
    """Return the plans of the optional features for a computer."""
    parts = {name: hooks.make_part(fleet, robot, computer) for name, hooks in load_hooks("plan", PlanHooks).items()}
    return {name: part for name, part in parts.items() if part is not None}


def _is_carried(features: Iterable[model.PlanPart]) -> bool:
    """Return True if a feature makes the common network: its program makes the routes there, each time that it starts."""
    return any(part.carries for part in features)


def _environment(fleet: Fleet, robot: Robot, computer: Computer) -> dict[str, str]:
    """Return the names of the master and of the computer (section 3.2 of the report)."""
    return {
        "ROS_MASTER_URI": membership.master_uri(fleet, robot).rstrip("/"),
        "ROS_HOSTNAME" if fleet.variables.advertise == "name" else "ROS_IP": membership.ros_host(fleet, computer),
    }


def _roscore(robot: Robot) -> str:
    """Return who starts the roscore: the collection, something else on this computer, or a sealed computer."""
    return "sealed" if robot.master.sealed else robot.variables.roscore


def _look_at(
    fleet: Fleet, robot: Robot, is_master: bool, expected: Iterable[model.ExpectedRoute], metrics: bool
) -> model.LookAt:
    also = ["folders"] if metrics else []
    also += [part for hooks in load_hooks("plan", PlanHooks).values() for part in hooks.list_facts(fleet)]
    return model.LookAt(
        parts=(*LOOKED_AT, *LOOKED_AT_WITH_ROS, *also),
        folders=(robot.variables.metrics_folder,) if metrics else None,
        destinations=tuple(route.destination[1] for route in expected),
        packages=providers.packages_to_look_for(robot.variables.provider, is_master),
        nodes=providers.nodes_to_look_for(robot.variables.provider),
    )


def _plan_router(fleet: Fleet, router: Router) -> model.ComputerPlan:
    """Return the plan of the router (section 4.2 of the report). It is no computer of a robot, so it has no ROS."""
    return model.ComputerPlan(
        computer=router.name,
        address=router.address,
        common_address=router.address,
        network=fleet.variables.common_network,
        networks=(model.PlannedAddress(fleet.variables.common_network, router.address),),
        is_router=True,
        roscore="existing",
        sysctl=FORWARDING + NO_REDIRECTS,
        routes=tuple(
            model.PlannedRoute(robot.network, robot.gateway.common_address) for robot in fleet.robots if robot.gateway
        ),
        firewall=model.Firewall(_networks_behind_router(fleet)) if fleet.variables.firewall == "fleet" else None,
        look_at=model.LookAt(parts=LOOKED_AT),
    )


def _interfaces(fleet: Fleet, robot: Robot, computer: Computer) -> tuple[model.PlannedAddress, ...]:
    own = model.PlannedAddress(robot.network, computer.address)
    if robot.gateway is None or computer.common_address is None:
        return (own,)
    return own, model.PlannedAddress(fleet.variables.common_network, computer.common_address)


def _routes(fleet: Fleet, robot: Robot, computer: Computer) -> tuple[model.PlannedRoute, ...]:
    """Return the routes of a computer: behind a gateway the report's default route, unless the robot wants networks."""
    if robot.gateway and not computer.common_address and robot.variables.routes == "default":
        return (model.PlannedRoute(model.DEFAULT_ROUTE, robot.gateway.address),)
    return list_network_routes(fleet, robot, computer)


def list_network_routes(fleet: Fleet, robot: Robot, computer: Computer) -> tuple[model.PlannedRoute, ...]:
    """Return a route to each other network.

    On the common network it leads to the other robot's gateway itself. The router would send the packets back on the
    same interface.
    """
    others = [(other.network, other.gateway) for other in fleet.robots if other.gateway and other != robot]
    if computer.common_address:
        return tuple(model.PlannedRoute(network, gateway.common_address) for network, gateway in others)
    networks = [fleet.variables.common_network, *(network for network, _gateway in others)]
    return tuple(model.PlannedRoute(network, robot.gateway.address) for network in networks if robot.gateway)


def _list_expected_routes(fleet: Fleet, robot: Robot, computer: Computer) -> tuple[model.ExpectedRoute, ...]:
    """Return the routes that something else makes. On the common network they may also lead to its router."""
    also = (fleet.router.address,) if computer.common_address and fleet.router else ()
    return tuple(
        model.ExpectedRoute(route.destination, (route.gateway, *also))
        for route in list_network_routes(fleet, robot, computer)
    )


def _is_hub(fleet: Fleet, computer: Computer) -> bool:
    return fleet.overlay is not None and computer == fleet.overlay.hub


def list_behind(robot: Robot, computer: Computer) -> tuple[IPv4Network, ...]:
    """Return the network of its robot on a gateway, nothing on other computers."""
    return (robot.network,) if robot.gateway and robot.gateway.name == computer.name else ()


# The packet filter


def _firewall(
    fleet: Fleet, robot: Robot, computer: Computer, features: Collection[model.PlanPart]
) -> model.Firewall | None:
    """Return the packet filter of a computer. None: no packet filter is wanted. A hub passes packets on for the whole fleet, as a router."""
    if fleet.variables.firewall != "fleet":
        return None
    networks = _networks_behind_router(fleet) if _is_hub(fleet, computer) else list_behind(robot, computer)
    ports = [port for part in features for port in part.open_ports]
    return model.Firewall(
        networks,
        tuple(_list_guards(fleet, robot, computer)),
        computer.variables.firewall_also,
        (*computer.variables.firewall_ports, *ports),
    )


def _list_guards(fleet: Fleet, robot: Robot, computer: Computer) -> Iterator[model.PlannedGuard]:
    """Yield the networks whose addresses come in at one interface of the computer only.

    The own network of a robot is at the interface there. Packets of an overlay come by it, and behind a gateway from the gateway.
    Without an overlay, the addresses of other robots are those of an ordinary network, which may lead to a computer in several ways.
    """
    own = (robot.network,) if robot.gateway else ()
    common: list[IPv4Network] = []
    if fleet.overlay:
        others = [other.network for other in fleet.robots if other.gateway and other != robot]
        common = [fleet.variables.common_network, *others]
    if computer.common_address is None:
        own, common = (*own, *common), []
    if common:
        yield model.PlannedGuard(tuple(common), model.COMMON_INTERFACE)
    if own:
        yield model.PlannedGuard(own, model.OWN_INTERFACE)


def _let_in(fleet: Fleet, belonging: model.Membership) -> tuple[IPv4Network, ...]:
    """Return the sources that pass the packet filters: all planned addresses, and the networks of multimaster_allow.

    The addresses of gateways outside the inventory are among them: such a gateway may masquerade.
    """
    if fleet.variables.firewall != "fleet":
        return ()
    gateways = [robot.gateway for robot in fleet.robots if robot.gateway]
    devices = [address for gateway in gateways for address in (gateway.address, gateway.common_address)]
    planned = dict.fromkeys([*belonging.computers, *devices])
    return (*(IPv4Network(address) for address in planned), *belonging.allow)


def _networks_behind_router(fleet: Fleet) -> tuple[IPv4Network, ...]:
    """Return the robots' networks, and the addresses of the fleet on the common network. Other computers there are no robots."""
    own = [robot.network for robot in fleet.robots if robot.gateway]
    common = [computer.common_address for computer in fleet.computers if computer.common_address]
    common += [robot.gateway.common_address for robot in fleet.robots if robot.gateway]
    return tuple(dict.fromkeys([*own, *(IPv4Network(address) for address in common)]))


# Section 4.2 of the report. The reverse-path filter is loose. A strict one drops packets that come back on another
# interface (kernel: Documentation/networking/ip-sysctl, rp_filter; the larger value of `all` and the interface counts).
FORWARDING = (
    model.Setting("net.ipv4.ip_forward", "1"),
    model.Setting("net.ipv4.conf.all.rp_filter", "2"),
)
# The router sends packets back to the common network, with an ICMP redirect for each. `ping -c1` takes that for an error.
# The kernel sends redirects if `all` or the interface has 1.
NO_REDIRECTS = (
    model.Setting("net.ipv4.conf.all.send_redirects", "0"),
    model.Setting("net.ipv4.conf.default.send_redirects", "0"),
    model.Setting("net.ipv4.conf.{common}.send_redirects", "0"),  # preflight knows the interface
)

# A computer answers ARP for the addresses only of its interfaces. In a foreign network another machine may have its planned
# address (the unit multimaster-address; kernel: Documentation/networking/ip-sysctl, arp_ignore). 1, 2 and 8 answer less.
NO_FOREIGN_ARP = model.Setting("net.ipv4.conf.all.arp_ignore", "3", enough=("1", "2", "8"))


def _sysctl(fleet: Fleet, is_gateway: bool, is_hub: bool) -> tuple[model.Setting, ...]:
    """Return the kernel settings of a computer. Answers to `ping 224.0.0.1` are of section 3.2 of the report.

    The interface of a hub is not there yet, and takes the default.
    """
    answers = fleet.variables.answer_broadcast_pings
    every = (model.Setting("net.ipv4.icmp_echo_ignore_broadcasts", "0" if answers else "1"), NO_FOREIGN_ARP)
    return every + (FORWARDING if is_gateway or is_hub else ()) + (NO_REDIRECTS[:2] if is_hub else ())


def _ports(fleet: Fleet, robot: Robot, relay: model.Parameters | None) -> tuple[model.Port, ...]:
    """Return the ports that the services of the robot's master listen on, or those of its companion."""
    roscore = () if robot.master.sealed else (model.Port("tcp", robot.variables.roscore_port),)
    return (
        *roscore,
        model.Port("udp", fleet.variables.multicast_port),
        model.Port("tcp", robot.variables.rpc_port),
        *((model.Port("tcp", relay["port"]),) if relay else ()),
    )


def _services(
    robot: Robot, is_master: bool, features: Collection[model.PlanPart], relay: model.Parameters | None
) -> tuple[str, ...]:
    """Return the services of a computer of a robot, in the order in which they start."""
    first = (*(name for part in features for name in part.services), "address")
    if not is_master:
        return first
    roscore = ("roscore",) if _roscore(robot) == "managed" else ()
    connections = ("connections",) if robot.variables.provider == "bundled" else ()
    metrics = ("metrics",) if parameters.writes_metrics(robot) else ()
    crossing = ("relay",) if relay else ()
    watchdog = ("watchdog",) if connections or crossing else ()  # only our own programs give signs of life
    return (*first, *watchdog, *roscore, "discovery", *connections, "sync", *crossing, *metrics)
