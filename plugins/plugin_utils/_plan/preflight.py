# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Comparison of a computer's plan with the machine as `multimaster_info` found it, before anything changes.

Plan and description in, sentences out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from ipaddress import IPv4Address
from typing import Any

from .._base import advice
from .._base.features import load_hooks
from .._base.plain_text import LINE, quote
from .._inventory.flows import RELAY_PORT
from . import environment, overlaps, providers, set_up, units
from .hooks import PlanHooks
from .model import COMMON_INTERFACE, OWN_INTERFACE, ComputerPlan, PlannedAddress, Port, RobotNetwork, Setting

# The units of the collection. They may hold the ports of the plan.
# multimaster-border.service is the former name of multimaster-relay.service: it holds the relay's port until this run stops it.
OWN_UNITS = tuple(f"multimaster-{name}.service" for name in (*units.OTHERS, *units.NODES, "border"))
# The bundled nodes need this Python (Noetic's), and so do the services on the system's Python.
NODES_PYTHON = (3, 8)
# The prefix length of an address on a point-to-point link, and the beginnings of IPv6 addresses that are more than link-local.
HOST_BITS, GLOBAL = 32, ("2", "3", "fc", "fd")
MOST_UNREAD = 20  # parts of a machine
# Services that may be left out: the function that is missing without them, and which of the two they need: CAP_NET_ADMIN, which systemd
# lacks in some containers, and the system's Python.
NEEDS = {
    "address": ("its own name leads nowhere while no interface has its address", True, False),
    "connections": ("connections with lost robots are left to TCP, which takes minutes to notice", True, True),
    "watchdog": ("a service that hangs is ended after half an hour, and not within a minute", False, True),
    "metrics": ("node_exporter has no metrics of the nodes", False, True),
}


@dataclass(frozen=True)
class MachineState:
    """The state of a machine, for a run that judges it and changes nothing."""

    set_up: bool = True  # the collection has records there
    runs: tuple[str, ...] = ()  # a sentence for each other program on the ports of the plan
    noted: tuple[str, ...] = ()  # the other problems: sentences too
    overlaps: tuple[str, ...] = ()  # each interface that leads into another robot's network, in words
    warned: tuple[str, ...] = ()  # sentences on small matters
    set_by: Mapping[str, str] = field(
        default_factory=dict
    )  # variable -> the line of a person that sets it to something else
    broken_ros: str = ""  # why nodes of the ROS that is installed cannot start; a sentence
    # Of ROS, as our file would have it. Empty if that file is there.
    environment: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Comparison:
    """The reasons against applying a plan to a machine, warnings, the plan with facts of the machine, and its state."""

    problems: tuple[str, ...]
    warnings: tuple[str, ...]
    plan: ComputerPlan
    state: MachineState


def compare(plan: ComputerPlan, info: Mapping[str, Any], networks: Sequence[RobotNetwork] = ()) -> Comparison:
    """Compare one computer's plan with its machine. `info` is the return of `multimaster_info`, `networks` are those of all robots.

    The new plan has the names of the interfaces, the nodes' programs and the packages to install.
    """
    problems, feature_warnings = _compare_features(plan, info)
    info = _add_interfaces(plan, info)
    interfaces, interface_problems = find_interfaces(plan, info)
    problems += interface_problems
    problems += _find_machine_problems(plan, info)
    missing = _explain_missing_services(plan, info)
    warnings = [*_list_unread(plan, info), *_check_hostname(plan, info), *missing.values(), *feature_warnings]
    services = tuple(name for name in plan.services if name not in missing)
    filled = replace(_fill(plan, info, interfaces), services=services)
    limits, broken_ros = list(plan.limits), ""
    holders: list[Holder] = []
    if not plan.is_router:
        if plan.shells != "none":  # else shells are user-managed, whatever they have
            warnings += [*_check_exports(plan, info), *_name_silent_shells(plan, info), *_check_sshd(plan, info)]
        ros, chosen = list(_check_ros(plan, info)), info["ros"].get("chosen")
        if _lacks_modules(chosen) or (plan.is_master and _has_lost_ros(info)):
            broken_ros = ros[0]
        if not ros:
            warnings += set_up.list_warnings(plan.computer, chosen, plan.shells)
            nodes = providers.find_nodes(plan, chosen, info)
            filled, ros = _add_programs(filled, info, nodes), list(nodes.problems)
            limits += nodes.list_limits(plan)
        if plan.is_master:
            problems += ros
            holders = _find_holders(plan, info)
            warnings += [*_find_missing_roscore(plan, info), *limits]
        else:
            warnings += ros
    overlapping = overlaps.find_overlaps(plan, networks, info)
    state = MachineState(
        set_up=bool(info.get("owned")),
        runs=_describe_holders(plan, holders),
        noted=tuple(problems),
        overlaps=tuple(map(str, overlapping[: overlaps.MOST])),
        warned=tuple(warnings),
        set_by=_list_lines(plan, info),
        broken_ros=broken_ros,
        environment=_list_environment(plan, info),
    )
    problems += [_refuse_port(plan, holder) for holder in holders]
    problems += overlaps.describe_overlaps(plan, overlapping)
    return Comparison(tuple(problems), tuple(warnings), filled, state)


def _lacks_modules(chosen: Mapping[str, Any] | None) -> bool:
    """Return True if modules of a ROS are missing. An empty version means that the interpreter which was to import them gave no answer."""
    return bool(chosen and chosen["missing"] and chosen["python_version"])


def _has_lost_ros(info: Mapping[str, Any]) -> bool:
    """Return True if no ROS 1 is left where site.yml has run, since it refuses a master without one.

    A ROS that could not be looked for has no sentence about its problem.
    """
    ros = info["ros"]
    is_lost = ros.get("problem") and not ros.get("chosen")
    return bool(info.get("owned") and is_lost and all(one["version"] == "2" for one in ros.get("found", ())))


def _fill(plan: ComputerPlan, info: Mapping[str, Any], interfaces: Mapping[IPv4Address, str]) -> ComputerPlan:
    """Return the plan with values that only the machine knows: interfaces, packages, and leftovers of an earlier plan."""
    common = interfaces.get(plan.common_address, "") if plan.common_address else ""
    sysctl = tuple(
        replace(setting, name=setting.name.replace("{common}", common.replace(".", "/"))) for setting in plan.sysctl
    )
    sysctl += tuple(_mute_below(info, interfaces.values()))
    names = {COMMON_INTERFACE: common, OWN_INTERFACE: interfaces.get(plan.address, "")}
    planned = plan.firewall.guards if plan.firewall else ()
    guards = tuple(replace(guard, interface=names[guard.interface]) for guard in planned)
    plan = _fill_features(plan, info)
    features = load_hooks("plan", PlanHooks).values()
    return replace(
        plan,
        sysctl=sysctl,
        programs=units.NO_PROGRAMS,
        packages=(
            *(name for hooks in features for name in hooks.list_packages(plan, info)),
            *(("nftables",) if guards else ()),
        ),
        firewall=replace(plan.firewall, guards=guards) if plan.firewall else None,
        # Without the name of an interface, which a verification may have, there is nothing to compare.
        firewall_due=_is_due(plan.firewall, "firewall", info) and all(of.interface for of in guards),
        nft_missing=bool(guards) and not info["filters"]["readable"],
    )


def _compare_features(plan: ComputerPlan, info: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """Return the problems of the optional features on this machine, and their warnings."""
    features = load_hooks("plan", PlanHooks).values()
    problems = [sentence for hooks in features for sentence in hooks.find_problems(plan, info)]
    return problems, [sentence for hooks in features for sentence in hooks.list_warnings(plan, info)]


def _add_interfaces(plan: ComputerPlan, info: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the facts of multimaster_info, with the interfaces that optional features make, as they will be."""
    there = [entry["name"] for entry in info["interfaces"]]
    planned = [
        {
            "name": interface.name,
            "up": True,
            "loopback": False,
            "multicast": False,
            "point_to_point": True,
            "addresses": [{"address": str(interface.address), "prefix": interface.network.prefixlen, "family": "inet"}],
        }
        for interface in plan.interfaces_to_come
        if interface.name not in there
    ]
    return {**info, "interfaces": [*info["interfaces"], *planned]} if planned else info


def _fill_features(plan: ComputerPlan, info: Mapping[str, Any]) -> ComputerPlan:
    """Return the plan with the values that only the machine knows of its optional features, and the due ones of these."""
    known = load_hooks("plan", PlanHooks)
    return replace(
        plan,
        features={name: known[name].fill(plan, part, info) for name, part in plan.features.items()},
        features_due={f"{name}_due": _is_due(plan.features.get(name), f"-{name}", info) for name in known},
    )


def _mute_below(info: Mapping[str, Any], names: Collection[str]) -> Iterator[Setting]:
    """Yield a setting for each interface without an address below a planned macvlan: it answers no ARP.

    It would answer for the address above it, so others send to it. With a reverse-path filter, also a loose one, the kernel
    takes nothing at an interface that has no address (net/ipv4/fib_frontend.c, __fib_validate_source).
    """
    planned = [entry for entry in info["interfaces"] if entry["name"] in names]
    below = {entry["macvlan_of"] for entry in planned if entry.get("macvlan_of")}
    for entry in info["interfaces"]:
        if entry["name"] in below and all(":" in one["address"] for one in entry["addresses"]):
            yield Setting(f"net.ipv4.conf.{entry['name'].replace('.', '/')}.arp_ignore", "8")


def explain_failure(computer: str, failed: Mapping[str, Any], version: str) -> str:
    """Name the needs of a look at a machine. `failed` is the result of the module, `version` that of ansible-core.

    If a module cannot start, the cause is in its last line.
    """
    output = str(failed.get("module_stderr") or failed.get("msg") or "no reason is known")
    last = (output.strip().splitlines() or [""])[-1].strip()
    if last.startswith(f"{computer}: "):  # our own action refused the answer of the module
        return f"{computer}: {quote(last.partition(': ')[2], LINE)}"
    return (
        f"{computer}: the machine could not be looked at ({quote(last, LINE)}); expected a user who may become root (--ask-become-pass if "
        f"sudo takes a password), and Python 3.6 or later that ansible-core {version} can manage: compare the table in "
        "docs/start/machines.md, set ansible_python_interpreter, or use a later release of the system."
    )


def explain_strange_answer(computer: str, problem: Exception) -> str:
    """Say that an answer has the documented types, and still no facts of a machine."""
    found = f"no {quote(problem.args[0])}" if isinstance(problem, KeyError) and problem.args else quote(problem, LINE)
    return (
        f"{computer}: what its machine has answered to multimaster_info cannot be compared with the plan: found {found}; expected the facts that the "
        "documentation of this module says. Something else than the module answers there: look at this computer before you trust it."
    )


def _list_environment(plan: ComputerPlan, info: Mapping[str, Any]) -> Mapping[str, str]:
    """Return the variables of ROS for a computer without our file of them, nothing if it has that file or no ROS."""
    chosen = (info.get("ros") or {}).get("chosen")
    if info.get("owned") or not chosen:
        return {}
    return environment.list_for_services(environment.merge(chosen["environment"], plan.environment))


def _add_programs(plan: ComputerPlan, info: Mapping[str, Any], nodes: providers.Installation) -> ComputerPlan:
    """Return the plan with the nodes' programs and the packages to install."""
    if nodes.problems:
        return plan
    python = info["ros"]["chosen"]["python"]
    programs = (
        units.render_programs(plan.provider, python, nodes.paths, plan.roscore_port, nodes.release.environment)
        if plan.is_master
        else plan.programs
    )
    return replace(plan, programs=programs, packages=(*nodes.packages, *(plan.packages or ())))


def _is_due(planned: object, record: str, info: Mapping[str, Any]) -> bool:
    """Return True if a thing is planned, or an earlier plan left it behind: there is a record of it."""
    return planned is not None or any(record in name for name in info.get("owned", ()))


def find_interfaces(plan: ComputerPlan, info: Mapping[str, Any]) -> tuple[dict[IPv4Address, str], list[str]]:
    """Return the name of the interface with each address of the plan, and the problems of these interfaces."""
    names: dict[IPv4Address, str] = {}
    problems = []
    for wanted in plan.networks:
        names[wanted.address], found = _find_interface(plan, info, wanted)
        problems += found
    return names, problems


def _find_interface(plan: ComputerPlan, info: Mapping[str, Any], wanted: PlannedAddress) -> tuple[str, list[str]]:
    """Return the name of the interface with an address of the plan, and its problems. Of several, one without problems counts."""
    places = [(interface, entry) for interface in info["interfaces"] for entry in interface["addresses"]]
    # An address that a feature makes is its own interface's, whoever else has it; the feature refuses the others.
    made = _list_made(plan, wanted)
    here = [(one, entry["prefix"]) for one, entry in places if entry["address"] == str(wanted.address)]
    found = {
        interface["name"]: list(_check_interface(plan, wanted, interface, prefix))
        for interface, prefix in here
        if interface["name"] in (made or [interface["name"]])
    }
    good = [name for name, problems in found.items() if not problems]
    if len(good) > 1 and _has_guards(plan):
        return "", [_describe_several(plan, good, wanted)]
    if not found:
        return "", [_describe_absence(plan, places, wanted)]
    name = next(iter(good or found))
    return name, found[name]


def _list_made(plan: ComputerPlan, wanted: PlannedAddress) -> list[str]:
    return [one.name for one in plan.interfaces_to_come if one.address == wanted.address]


def _has_guards(plan: ComputerPlan) -> bool:
    return bool(plan.firewall and plan.firewall.guards)


def _describe_several(plan: ComputerPlan, names: Sequence[str], wanted: PlannedAddress) -> str:
    """Say that several interfaces have an address of the plan, if a guard needs one."""
    return (
        f"{plan.computer}: {_variable(plan, wanted)} {wanted.address} is on {' and on '.join(map(quote, names))}; expected it on only one interface, "
        "since the packet filter takes packets for a network from its interface and drops it from each other one: take the address "
        "from the others."
    )


def _describe_absence(
    plan: ComputerPlan, places: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]], wanted: PlannedAddress
) -> str:
    """Say that no interface has an address of the plan, and the addresses that the machine has instead."""
    outer = [(interface["name"], entry["address"]) for interface, entry in places if not interface["loopback"]]
    others = [f"{quote(address)} on {quote(name)}" for name, address in outer if ":" not in address]
    if not others and any(address.lower().startswith(GLOBAL) for _name, address in outer):
        return (
            f"{plan.computer}: {_variable(plan, wanted)} is {wanted.address}, but the machine has only addresses of IPv6; expected an IPv4 "
            "address, since the nodes of ROS 1 are reached only by IPv4 here: give it one, as by a VPN that has IPv4 (WireGuard, Tailscale)."
        )
    return (
        f"{plan.computer}: {_variable(plan, wanted)} is {wanted.address}, but the machine has {', '.join(others) or 'no address'}; expected that address "
        "on one of its interfaces: correct the inventory, or give the machine the address."
    )


def _check_interface(
    plan: ComputerPlan, wanted: PlannedAddress, interface: Mapping[str, Any], prefix: int
) -> Iterator[str]:
    name = quote(interface["name"])
    place = f"{name} with {_variable(plan, wanted)} {wanted.address}"
    sends = plan.is_master and plan.discovery["send_mcast"] and str(plan.discovery["interface"]) == str(wanted.address)
    if not interface["up"]:
        up = advice.command(" (ip link set {} up)", ("device", interface["name"]))
        yield (
            f"{plan.computer}: the interface {place} is down; expected it to be up: "
            f"bring it up{up} and find out why it was not."
        )
    elif interface.get("port_of"):
        above = quote(interface["port_of"])
        yield (
            f"{plan.computer}: the interface {place} is a port of {above}; expected the address on {above} itself, since a packet that comes in at a "
            "port belongs to the interface above it: give the address to that one, with the routes, or take the port out."
        )
    elif interface["loopback"]:
        yield (
            f"{plan.computer}: the interface {place} is the loopback, on which no other computer is; expected the address on an interface "
            f"that is in {wanted.network}, since packets of a multicast group go by it: give the address to that one."
        )
    elif sends and not interface["multicast"]:
        multicast = advice.command(" (ip link set {} multicast on)", ("device", interface["name"]))
        yield (
            f"{plan.computer}: the interface {place} does not do multicast; expected the flag MULTICAST: "
            f"set it{multicast}, or set multimaster_transport to unicast."
        )
    elif prefix == HOST_BITS and interface.get("point_to_point"):
        # No network, but a route to each of the others: the shape of Tailscale. Nothing on it is for a group.
        if sends:
            yield (
                f"{plan.computer}: the interface {place} is a point-to-point link with a single address, which carries no multicast; expected "
                "discovery by datagrams to each master: set multimaster_transport to 'unicast' in group_vars/robots.yml."
            )
        if any(route.gateway in wanted.network for route in plan.routes):
            yield (
                f"{plan.computer}: the interface {place} is a point-to-point link with a single address, on which no route has a gateway; "
                f"expected the VPN to lead to the networks of other robots itself, or a tunnel with the prefix length "
                f"{wanted.network.prefixlen}: take one such as WireGuard, or give these robots no network of their own."
            )
    elif prefix != wanted.network.prefixlen:
        yield (
            f"{plan.computer}: {_variable(plan, wanted)} is {wanted.address}, on {name} with the prefix length {prefix}; expected "
            f"{wanted.network.prefixlen}, as the network {wanted.network} of the inventory has it, since packets to other networks "
            "take another way otherwise: correct one of the two."
        )


def _variable(plan: ComputerPlan, wanted: PlannedAddress) -> str:
    return "multimaster_address" if wanted.address == plan.address else "multimaster_common_address"


def _find_machine_problems(plan: ComputerPlan, info: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence if systemd or node_exporter's folder is missing, and for each network without a way.

    Ways are looked at with `multimaster_routes: existing`. Without a route, answers do not come back.
    """
    if not info["systemd"]["running"]:
        yield (
            f"{plan.computer}: systemd does not run the machine; expected it, since the nodes are its services: "
            "use a system with systemd."
        )
    if plan.metrics_folder and plan.metrics_folder not in info.get("folders", ()):
        yield (
            f"{plan.computer}: multimaster_metrics is 'textfile', but there is no folder {plan.metrics_folder} on the machine; expected the "
            "one that node_exporter reads: install it (apt-get install prometheus-node-exporter), name its folder in "
            "multimaster_metrics_folder, or set multimaster_metrics to 'none'."
        )
    ways = {entry["destination"]: entry for entry in info.get("ways", ())}
    for route in () if plan.carrier else plan.routes_expected:  # the program of an overlay makes them
        way = ways.get(str(route.destination[1]), {"error": "not looked at", "gateway": None})
        gateway, gateways = way["gateway"], [str(planned) for planned in route.gateways]
        if gateway not in gateways:
            state = quote(way["error"]) or (f"one by {quote(gateway)}" if gateway else "a way without a gateway")
            yield (
                f"{plan.computer}: multimaster_routes is 'existing', but towards {route.destination} there is no route by "
                f"{' or '.join(gateways)} (found: {state}); expected one, since without a route back nothing is answered: add it, "
                "name the router in multimaster_router if it leads there, or set multimaster_routes to 'default' or 'networks'."
            )


def _list_unread(plan: ComputerPlan, info: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for each part of the machine that could not be read: what depends on it was compared with nothing."""
    for problem in list(info.get("problems") or ())[:MOST_UNREAD]:
        yield f"{plan.computer}: {quote(problem, LINE)}; expected an answer, so what depends on it is unknown: run it again."


def _explain_missing_services(plan: ComputerPlan, info: Mapping[str, Any]) -> dict[str, str]:
    """Return a sentence for each service that cannot run on this machine."""
    warnings: dict[str, str] = {}
    for name in plan.services:
        without, capability, python = NEEDS.get(name, ("", False, False))
        if capability and not info["systemd"]["net_admin"]:
            warnings[name] = (
                f"{plan.computer}: systemd has no CAP_NET_ADMIN, as in some containers; expected it for "
                f"multimaster-{name}.service, which is left out: {without}; give the container this capability."
            )
        elif python and _is_too_old(info["python"]):
            warnings[name] = (
                f"{plan.computer}: its Python is {quote(info['python'])}; expected 3.8 or later for multimaster-{name}.service, which is "
                f"left out: {without}; use such a system."
            )
    return warnings


def _is_too_old(python: str) -> bool:
    return tuple(int(part) for part in python.split(".")[:2]) < NODES_PYTHON


def _check_ros(plan: ComputerPlan, info: Mapping[str, Any]) -> list[str]:
    host, ros = plan.computer, info["ros"]
    if ros["problem"]:
        return [f"{host}: {quote(ros['problem'], LINE)}", *_explain_containers(plan, ros)]
    chosen = ros["chosen"]
    if not chosen:
        return [
            f"{host}: multimaster_ros_setup is '{plan.ros_setup}', but no ROS was found on the machine; expected ROS 1 below "
            "/opt/ros, as Debian's packages, or in a workspace: install it, or name its set-up file in multimaster_ros_setup."
        ]
    where = quote(chosen["setup"]) or "Debian's packages"
    if chosen["missing"]:
        return [
            f"{host}: the ROS of {where} lacks the Python modules {', '.join(map(quote, chosen['missing']))}; expected them for the "
            f"nodes: install them{_suggest_packages(chosen)}."
        ]
    if plan.is_master and plan.roscore == "managed":
        roscore = chosen["commands"].get("roscore")
        if not roscore:
            return [
                f"{host}: the ROS of {where} has no roscore; expected it, since multimaster_roscore is 'managed': install it, or set "
                "multimaster_roscore to 'existing' if something else starts a roscore."
            ]
    programs = [chosen["python"], chosen["commands"].get("roscore") if plan.roscore == "managed" else ""]
    problems = list(providers.check_paths(plan, filter(None, programs))) if plan.is_master else []
    if problems:
        return problems
    if plan.provider == "bundled" and _is_too_old(chosen["python_version"]):
        return [
            f"{host}: the ROS of {where} has Python {quote(chosen['python_version'])}; expected 3.8 or later for the bundled nodes (Ubuntu 20.04, Debian 11 "
            "or later): use such a system, or set multimaster_provider to 'fkie_apt' or 'fkie_existing'."
        ]
    return []


def _explain_containers(plan: ComputerPlan, ros: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for a robot whose ROS may be only in a container: its roscore is user-managed, and its computer has no ROS."""
    if plan.is_master and plan.roscore == "existing" and not ros.get("found"):
        yield (
            f"{plan.computer}: its roscore is user-managed (multimaster_roscore is 'existing'), and may be in a container; expected rospy outside of "
            "it, on the computer itself, since the nodes of the collection run there: install it "
            "(apt-get install python3-rospy python3-std-srvs python3-rostopic python3-rosservice), as docs/start/containers.md says."
        )


def _suggest_packages(chosen: Mapping[str, Any]) -> str:
    names = [module.replace("_", "-") for module in chosen["missing"]]
    prefix = "python3-" if chosen["kind"] == "debian" else f"ros-{chosen['distro'] or 'DISTRO'}-"
    tool = "conda install" if "CONDA_PREFIX" in chosen["environment"] else "apt-get install"
    words = " ".join([tool, *("{}" for _name in names)])
    return advice.command(f" ({words})", *(("what", prefix + name) for name in names))


# A foreign process on a port of the plan: the port in words, the service that the plan has there, and the process.
Holder = tuple[str, str, str]

_REMEDIES = {
    "roscore": "stop it, or set multimaster_roscore to 'existing' to use it",
    "discovery": "stop it: only one discovery node can answer for a master",
    "relay": "stop it: only one relay can answer for a robot",
}


def _refuse_port(plan: ComputerPlan, holder: Holder) -> str:
    """Return the sentence for a run that would start the service of the plan."""
    port, use, process = holder
    return f"{plan.computer}: {port} is held by {process}; expected it to be free for the {use} of the collection: {_REMEDIES[use]}."


def _describe_holders(plan: ComputerPlan, holders: Sequence[Holder]) -> tuple[str, ...]:
    """Return a sentence for each process, for a run that changes nothing."""
    ports: dict[tuple[str, str], list[str]] = {}
    for port, use, process in holders:
        ports.setdefault((process, use), []).append(port)
    return tuple(
        f"{plan.computer}: {' and '.join(titles)}: {process}, but the plan has multimaster-{use}.service."
        for (process, use), titles in ports.items()
    )


def _find_holders(plan: ComputerPlan, info: Mapping[str, Any]) -> list[Holder]:
    """List the other processes on the ports of the plan, each once. A process may hold a port on several addresses."""
    holders = []
    for port in plan.ports:
        uses = {Port("tcp", plan.roscore_port): "roscore", Port("tcp", plan.roscore_port + RELAY_PORT): "relay"}
        use = uses.get(port, "discovery")
        if use == "roscore" and plan.roscore == "existing":
            continue
        for holder in info["ports"]:
            if (holder["protocol"], holder["port"]) == (port.protocol, port.port) and holder["unit"] not in OWN_UNITS:
                unit = f", {quote(holder['unit'])}" if holder["unit"] else ""
                unit += f" of {quote(holder['person'])}" if holder.get("person") else ""
                process = f"{quote(holder['command']) or 'a process'} (pid {holder['pid']}, user {quote(holder['user'])}{unit})"
                holders.append((f"{port.protocol.upper()} port {port.port}", use, process))
    return list(dict.fromkeys(holders))


def _find_missing_roscore(plan: ComputerPlan, info: Mapping[str, Any]) -> Iterator[str]:
    listening = {(holder["protocol"], holder["port"]) for holder in info["ports"]}
    if plan.roscore == "existing" and ("tcp", plan.roscore_port) not in listening:
        yield (
            f"{plan.computer}: nothing listens on TCP port {plan.roscore_port}; expected the roscore that something else starts, "
            "since multimaster_roscore is 'existing': start it now, for the discovery node waits for it."
        )


def _check_hostname(plan: ComputerPlan, info: Mapping[str, Any]) -> Iterator[str]:
    if info["hostname"].split(".")[0].lower() != plan.computer.split(".")[0].lower():
        yield (
            f"{plan.computer}: the machine calls itself {quote(info['hostname'])}; expected its name in the inventory: nodes that are "
            "started without the environment of the collection advertise that other name; rename one of the two."
        )


def _check_exports(plan: ComputerPlan, info: Mapping[str, Any]) -> Iterator[str]:
    for export in info["exports"]:
        if plan.environment.get(export["variable"]) != export["value"].rstrip("/"):
            yield (
                f"{plan.computer}: {_describe_export(export)}; expected "
                "that only the collection sets it: shells that read this file differ from the services; remove the line."
            )


def _name_silent_shells(plan: ComputerPlan, info: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for each person of whom something gave no answer: a question without an answer is no "nothing is set"."""
    silent: dict[str, list[str]] = {}
    for one in info.get("silent_shells") or ():
        silent.setdefault(one["person"], []).append(one["shell"])
    for person, shells in silent.items():
        what = " and ".join("the files" if shell == "files" else f"the {quote(shell)} shell" for shell in shells)
        yield (
            f"{plan.computer}: {what} of {quote(person)} gave no answer, so the variables of ROS that they may set are unknown; "
            "expected an answer: run it again; if it stays so, open such a shell, and see whether its files wait, or end it."
        )


def _list_lines(plan: ComputerPlan, info: Mapping[str, Any]) -> Mapping[str, str]:
    """Return the line of a person for each variable of the plan's that it sets to another value; of several the last."""
    return {
        quote(export["variable"]): f"{quote(export['file'])}, line {export['line']}"
        for export in info.get("exports") or ()
        if export["line"] and plan.environment.get(export["variable"]) != export["value"].rstrip("/")
    }


def _describe_export(export: Mapping[str, Any]) -> str:
    """Name the line that sets a variable, and the value in the shell that was asked."""
    variable, person = quote(export["variable"]), export.get("person", "")
    has = (
        f"the {quote(export.get('shell', ''))} shell of {quote(person)} has {variable}={quote(export['value'])}"
        if person
        else ""
    )
    if not export["line"]:
        return f"{has}, by a line that was not found"
    line = f"{quote(export['file'])}, line {export['line']} sets {variable} ({quote(export['text'])})"
    return f"{line}, and {has}" if has else line


def _check_sshd(plan: ComputerPlan, info: Mapping[str, Any]) -> Iterator[str]:
    sshd = info["sshd"]
    if not sshd["installed"]:
        return
    if not sshd["includes_drop_ins"]:
        yield (
            f"{plan.computer}: sshd does not read /etc/ssh/sshd_config.d; expected it, so that commands by ssh have the ROS "
            "environment: add 'Include /etc/ssh/sshd_config.d/*.conf' at the top of /etc/ssh/sshd_config, or use login shells."
        )
    for other in sshd["other_setenv"]:
        if not other["match"]:  # a SetEnv below a Match adds to ours
            yield (
                f"{plan.computer}: {quote(other['file'])}, line {other['line']} has its own SetEnv ({quote(other['text'])}), and sshd takes only "
                "one; expected none: commands by ssh get no ROS environment from the collection; move it into the users' "
                "~/.ssh/environment, or use login shells."
            )
