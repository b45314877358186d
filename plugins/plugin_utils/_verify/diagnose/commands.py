# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The command that repairs a component, if it needs more than the component's name. Pure: components and the values read there in, words out.

A text of a machine is in them only if it has the form of its place: advice.py makes each command.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from ipaddress import IPv4Network

from ..._base import advice
from ..._faults.fault import HANDS, Advice, Advices
from ..._faults.filters import DROPPED, RULED, Dropped
from ..._network.model import ACCEPT, DROP, MASQUERADE, REJECT
from ..checks.programs import describe_full
from ..components.component import Component
from ..context.check_context import FleetState, Participant
from ..observe.observations import FilterChain, FilterChains
from .node_remedies import list_remedies
from .onset import MAKERS

ROS = ("roscore", "discovery", "sync")  # services


UNTIL = "until the program that makes the rules loads them again: write it there, too"
Commands = Iterator[str]


def _switch_on(computer: Participant, components: Sequence[Component], _state: FleetState) -> Commands:
    for component in components:
        if interface := computer.interface_on.get(component.what):
            yield advice.command("ip link set dev {} up", ("device", interface.interface))


def _set_mtu(computer: Participant, components: Sequence[Component], state: FleetState) -> Commands:
    for component in components:
        interface, usual = computer.interface_on.get(component.what), state.usual.get(component.what)
        if interface and usual and interface.mtu != usual:
            yield advice.command("ip link set dev {} mtu {}", ("device", interface.interface), ("number", usual))


def _correct_prefix(computer: Participant, _components: Sequence[Component], _state: FleetState) -> Commands:
    for interface, text, found, planned in computer.find_wrong_prefixes():
        address, device = ("address", text), ("device", interface)
        yield advice.command("ip address add {}/{} dev {}", address, ("number", planned), device)
        yield advice.command("ip address del {}/{} dev {}", address, ("number", found), device)


def _delete_default_routes(computer: Participant, _components: Sequence[Component], _state: FleetState) -> Commands:
    """Delete those that are not planned, if the planned one is there."""
    routes = computer.probe.default_routes
    planned = {str(route.gateway) for route in computer.plan.routes if not route.destination.prefixlen}
    others = [route for route in routes if route.gateway not in planned]
    for route in others if len(others) < len(routes) else ():
        yield advice.command(
            "ip route del default via {} dev {} metric {}",
            ("address", route.gateway),
            ("device", route.device),
            ("number", route.metric or "0"),
        )


def _delete_closed_routes(_computer: Participant, components: Sequence[Component], _state: FleetState) -> Commands:
    return (advice.command("ip route del {}", ("route", component.what)) for component in components)


def _delete_rules(_computer: Participant, components: Sequence[Component], _state: FleetState) -> Commands:
    return (advice.command("ip rule del {}", ("rule", component.what)) for component in components)


def _comment_out_lines(_computer: Participant, components: Sequence[Component], _state: FleetState) -> Commands:
    """Lines with one of the names that are not the collection's become comments."""
    names = "|".join("{}" for _component in components)
    line = f"s/^[^#].*[[:space:]]({names})([[:space:]]|$)/# &/"
    yield advice.command(
        f"sed -i -E '/rosfleet.multimaster/! {line}' /etc/hosts",
        *(("name", component.what) for component in components),
    )


def _comment_out_settings(computer: Participant, components: Sequence[Component], _state: FleetState) -> Commands:
    """The line that decides at the next boot becomes a comment; nothing of a package is changed."""
    for entry in computer.probe.next_boot:
        if entry.kind == "sysctl" and entry.name in {component.what for component in components}:
            file = entry.file.partition(" line ")[0]
            words = "sed -i -E 's,^[[:space:]]*-?{}[[:space:]]*=,# &,' {}"
            yield advice.command(words, ("setting", entry.name), ("file", file))


def _drop_ins(computer: Participant, _components: Sequence[Component], _state: FleetState) -> Commands:
    """Drop-in files that set the variables that differ are set aside, and their units start again.

    Nodes are registered at the roscore, so a drop-in of one of them has all of them start again.
    """
    files = {entry.unit: entry.drop_ins for entry in computer.probe.services if entry.drop_ins and entry.differing}
    nodes = ROS if any(entry.name in ROS for entry in computer.probe.services if entry.unit in files) else ()
    return _set_aside(files, [one.unit for one in computer.probe.services if one.unit in files or one.name in nodes])


def _drop_ins_of_node(computer: Participant, components: Sequence[Component], _state: FleetState) -> Commands:
    """Drop-in files of the node's own unit are set aside: one with another command gives it other parameters."""
    names = {component.kind for component in components}
    services = [entry for entry in computer.probe.services if entry.command_drop_ins and entry.name in names]
    files = {entry.unit: entry.command_drop_ins for entry in services}
    return _set_aside(files, list(files))


def _set_aside(files: Mapping[str, Sequence[str]], started: Sequence[str]) -> Commands:
    """Set drop-in files ({unit: files}) aside, and start units again."""
    paths = [("drop-in", path) for each in files.values() for path in each]
    moves = [advice.command("mv {} {}.off", path, path) for path in paths]
    units = [("unit", unit) for unit in started]
    restart = advice.command(" ".join(["systemctl restart", *("{}" for _unit in units)]), *units)
    if any(moves) and restart:
        yield from [*moves, "systemctl daemon-reload", restart]


def _limit_files(computer: Participant, components: Sequence[Component], _state: FleetState) -> Commands:
    """A drop-in file gives a unit the limit that systemd gives, if no file sets another one."""
    persons = {entry.unit: entry.person for entry in computer.probe.file_limits}
    lines = "printf '[Service]\\nLimitNOFILE=1024:524288\\n'"
    for component in components:
        unit, person = component.what, persons.get(component.what, "")
        yield advice.of_unit(
            person, f"mkdir -p {{folder}}/{{unit}}.d; {lines} > {{folder}}/{{unit}}.d/files.conf", unit
        )
        yield advice.of_unit(person, "{systemctl} daemon-reload; {systemctl} restart {unit}", unit)


#: a maker of packet filters -> its rule for a network, by the direction of its packets, now and, except of Docker, at boot.
#: A reload of firewalld empties the tables of others, such as Docker's, so firewalld gets each rule twice.
LASTING: Mapping[str, Mapping[str, str]] = {
    "ufw": {"in": "ufw allow from {}", "out": "ufw allow out to {}", "forward": "ufw route allow from {}"},
    "firewalld": dict.fromkeys(
        ("in", "forward"),
        "firewall-cmd --zone=trusted --add-source={0}; firewall-cmd --permanent --zone=trusted --add-source={0}",
    ),
    "docker": {"forward": "iptables -I DOCKER-USER -s {} -j ACCEPT"},
}


GROUPS = IPv4Network("224.0.0.0/4")  # of multicast: only the source of packets to it is of the fleet
WAYS = {"in": ("input",), "out": ("output",), "forward": ("forward",)}  # direction of packets -> the hooks of nftables
BOTH_ENDS = ("input", "output")  # the hooks if it is not known whether packets or their answers are dropped
#: direction of packets -> the chains of iptables that they pass, and the end of them that is in a network of the fleet
CHAINS: Mapping[str, tuple[tuple[str, str], ...]] = {
    "in": (("INPUT", "-s"),),
    "out": (("OUTPUT", "-d"),),
    "forward": (("FORWARD", "-s"),),
}


def _accept_packets(computer: Participant, components: Sequence[Component], state: FleetState) -> Commands:
    """A rule before the one that drops lets the packets of the fleet pass; its program gets the rule, too, if it is known."""
    networks = sorted(state.fleet.network_names)
    for component in components:
        origins, direction = state.filters.list_origins(component), component.mode.rpartition(" ")[2]
        known = [
            lasting for maker, lasting in LASTING.items() if any(re.fullmatch(MAKERS[maker], one) for one in origins)
        ]
        if known and (words := known[0].get(direction)):
            ends = (GROUPS,) if component.mode == "group out" else networks
            yield from (words.format(end) for end in ends)
        elif origins:
            yield _accept_before(component, origins[0], networks)
        else:
            yield from _accept_unread(computer.seen.filters, component, networks)


def _accept_unread(filters: FilterChains | None, component: Component, networks: Iterable[IPv4Network]) -> Commands:
    """A rule that was not understood drops the packets, such as one with a limit: the new one comes before all rules of its chain."""
    if filters is None:
        return
    if not filters.readable:  # without nft the rules are those of iptables
        yield from _accept_first(component, networks)
        return
    hooks = WAYS.get(component.mode.rpartition(" ")[2], BOTH_ENDS)
    chains = [one for one in filters.chains if one.hook in hooks and _may_drop(one)]
    if len(chains) == 1 and chains[0].unread:  # of several it is not known which: what one accepts another one may drop
        yield _accept_before(component, f"{chains[0].table} {chains[0].chain}", networks)


def _may_drop(chain: FilterChain) -> bool:
    return bool(chain.unread) or chain.policy != ACCEPT or any(rule.verdict in (DROP, REJECT) for rule in chain.rules)


def _find_dropped(component: Component) -> tuple[Dropped | None, str, str]:
    """Find the packets that a filter drops, their direction, and their port, which is empty if the rule names no valid one."""
    mode, _space, direction = component.mode.rpartition(" ")
    if direction not in CHAINS:
        mode, direction = component.mode, ""
    dropped = DROPPED.get(mode)
    what = component.what or (dropped.what if dropped else "")
    return dropped, direction, what if what.isdecimal() and what.isascii() else ""


def _accept_before(component: Component, origin: str, networks: Iterable[IPv4Network]) -> str:
    dropped, direction, port = _find_dropped(component)
    match = dropped.match if dropped else ""
    if "{what}" in match and not port:
        return ""
    end = "daddr" if direction == "out" and "daddr" not in match else "saddr"
    matches = (one.format(what=port) for one in _list_ways_of_port(match, direction))
    return "; ".join(filter(None, (advice.accept_at(end, networks, one, origin) for one in matches)))


def _list_ways_of_port(match: str, direction: str) -> tuple[str, ...]:
    """List the matches of the packets to a port, and of their answers if a filter drops both directions: these come from that port."""
    return tuple(dict.fromkeys((match, match if direction else match.replace("dport", "sport"))))


def _accept_first(component: Component, networks: Iterable[IPv4Network]) -> Commands:
    dropped, direction, port = _find_dropped(component)
    option = dropped.option if dropped else ""
    if "{what}" in option and not port:
        return
    for chain, end in CHAINS.get(direction, (*CHAINS["in"], *CHAINS["out"])):
        of_fleet = "-s" if "-d " in option else end
        for one in _list_ways_of_port(option, direction):
            words = (
                f"iptables -I {chain} {of_fleet} {','.join(map(str, networks))}",
                one.format(what=port),
                "-j ACCEPT",
            )
            yield " ".join(filter(None, words))


def _let_nodes_in(computer: Participant, _components: Sequence[Component], state: FleetState) -> Commands:
    """A rule before the one that was not understood lets the fleet reach all nodes: each start gives a node other ports."""
    networks = sorted(state.fleet.network_names)
    return _accept_unread(computer.seen.filters, Component("filter", computer.name, "nodes in"), networks)


def _free_sync(computer: Participant, _components: Sequence[Component], state: FleetState) -> Iterator[Advice]:
    """The node starts again; if a packet filter may keep it alone from the others, its packets are accepted first."""
    restart, filters = "systemctl restart multimaster-sync", computer.seen.filters
    yield Advice(computer.name, restart)
    if filters is not None and filters.readable:
        out = Component("filter", computer.name, "nodes out")
        for rule in filter(None, _accept_unread(filters, out, sorted(state.fleet.network_names))):
            yield Advice(computer.name, f"{rule}; {restart}", f"if it stays so: {KEPT_APART}; {UNTIL}")


KEPT_APART = "a packet filter there has rules that are not understood, perhaps for the user of this node alone"
HANGS = "lets a stopped process go on; if it hangs, kill -9 in the place of kill -CONT ends it: then start it again"
CONNTRACK = "conntrack -D --src-nat"
GOES = "until its link comes up again; a login that comes in by that gateway ends"
PACKAGE = "conntrack is of the package of that name; it ends connections from before, which are still translated"


def _stop_translating(computer: Participant, _components: Sequence[Component], state: FleetState) -> Commands:
    """Rules before those that masquerade leave out what goes between the robots; then what they have begun to translate is ended.

    Nothing if there is a rule that was not understood: it may be the one.
    """
    filters = computer.seen.filters
    chains = [one for one in filters.chains if one.hook == "postrouting"] if filters and filters.readable else None
    if chains is None or any(one.unread for one in chains):
        return
    places = [f"{one.table} {rule.chain}" for one in chains for rule in one.rules if rule.verdict == MASQUERADE]
    inserted = [advice.accept_between(state.fleet.network_names, place) for place in dict.fromkeys(places)]
    if all(inserted):
        yield from [*inserted, CONNTRACK]


def _continue_nodes(_computer: Participant, components: Sequence[Component], state: FleetState) -> Commands:
    """Let a stopped node go on; the port that it announces tells its process."""
    ports = {row.node: row.port for other in state.run.values() for row in other.probe.exchange.silences if row.port}
    for component in components:
        port = ("number", ports.get(component.what, ""))
        yield advice.command("kill -CONT $(ss -ltnpH 'sport = :{}' | grep -o 'pid=[0-9]*' | cut -d= -f2)", port)


def _step_clock(computer: Participant, _components: Sequence[Component], _state: FleetState) -> Commands:
    """The time service that answers sets the clock at once."""
    yield STEPS.get(computer.probe.clock.service, "")


STEPS: Mapping[str, str] = {
    "chrony": "chronyc makestep",
    "systemd-timesyncd": "systemctl restart systemd-timesyncd",
}

# (kind, mode) -> the commands, from the values that were read.
COMMANDS: Mapping[tuple[str, str], Callable[[Participant, Sequence[Component], FleetState], Commands]] = {
    ("link", "down"): _switch_on,
    ("interface", "mtu"): _set_mtu,
    ("interface", "prefix"): _correct_prefix,
    ("route", "defaults"): _delete_default_routes,
    ("route", "closed"): _delete_closed_routes,
    ("route", "rule"): _delete_rules,
    ("names", "several"): _comment_out_lines,
    ("boot", "sysctl"): _comment_out_settings,
    ("environment", "service"): _drop_ins,
    **{(node, "configuration"): _drop_ins_of_node for node in ("discovery", "sync", "relay")},
    ("limit", "unit"): _limit_files,
    ("translation", "on"): _stop_translating,
    ("node", "hung"): _continue_nodes,
    ("node", "fenced"): _let_nodes_in,
    ("clock", "off"): _step_clock,
    **dict.fromkeys(RULED, _accept_packets),
}


def _name_second_holder(computer: Participant, _components: Sequence[Component], state: FleetState) -> Iterator[Advice]:
    """Name the computer that has the address, too, or the hardware address by which it is found."""
    address = str(computer.plan.address)
    known = {mac: name for name, other in state.run.items() for mac in other.hardware_addresses}
    heard = {mac.lower() for other in state.run.values() for mac in _list_answers(other, address)}
    strange = sorted(mac for mac in heard if known.get(mac) != computer.name)
    for mac in filter(MAC.fullmatch, strange if computer.hardware_addresses else ()):
        yield Advice(HANDS, _part_from_address(mac, known.get(mac, ""), address, state))


def _list_answers(observer: Participant, address: str) -> Iterator[str]:
    """List the hardware addresses that a computer has for an address."""
    for claim in observer.probe.claims:
        yield from claim.macs if claim.address == address else ()
    yield from (member.neighbour for member in observer.probe.members if member.address == address)


def _part_from_address(mac: str, holder: str, address: str, state: FleetState) -> str:
    """Say how a computer stops answering for the address of another one; `holder` is its name, empty outside the fleet."""
    if holder and not any(address in entry.addresses for entry in state.run[holder].interfaces):
        return f"end proxy_arp on {holder}: it answers for {address}, and does not have that address"
    named = holder or f"the computer with the hardware address {mac}"
    return f"give {named} another address than {address}, in its network manager or in DHCP"


def _raise_limits(computer: Participant, components: Sequence[Component], _state: FleetState) -> Iterator[Advice]:
    """A service that has all of its files open gets more of them; of another process, say how it is started again."""
    full = {component.what for component in components}
    for entry in computer.probe.full_processes:
        if describe_full(entry) not in full:
            continue
        made = advice.of_unit(
            entry.person,
            f"mkdir -p {{folder}}/{{unit}}.d; printf '[Service]\\nLimitNOFILE={MORE_FILES}\\n' > {{folder}}/{{unit}}.d/more-files.conf; "
            "{systemctl} daemon-reload; {systemctl} restart {unit}",
            entry.unit,
        )
        if made:
            yield Advice(computer.name, made, "if it gets full again, the program never closes its files")
        else:
            words = f"end the process {entry.pid} on {computer.name}, and start the program again in a shell after: ulimit -n {MORE_FILES}"
            yield Advice(HANDS, words)


def _stop_others(computer: Participant, components: Sequence[Component], _state: FleetState) -> Iterator[Advice]:
    """A unit that runs a node of the plan is stopped, for now and the next boot."""
    units = dict.fromkeys(unit for component in components for unit in OTHER_UNIT.findall(component.what))
    for unit, person in units:
        if made := advice.of_unit(person.strip('"'), "{systemctl} disable --now {unit}", unit):
            yield Advice(
                computer.name,
                made,
                "or do nothing if it is meant; it ends all that this unit runs, and site.yml starts the nodes of the plan instead",
            )


MAC = re.compile(r"[0-9a-f]{2}(?::[0-9a-f]{2}){5}")
MORE_FILES = 65536
#: a unit as preflight names it; not one of a login, in which people work, or of all containers
OTHER_UNIT = re.compile(
    r"""user [^,()]+, "?((?!user@|ssh|cron|docker|containerd|gdm|lightdm)[A-Za-z0-9_.@:-]+\.service)"?(?: of ([^,()]+))?\)"""
)
# (kind, mode) -> advices of which some are words
STEPWISE: Mapping[tuple[str, str], Callable[[Participant, Sequence[Component], FleetState], Iterator[Advice]]] = {
    ("interface", "duplicate"): _name_second_holder,
    ("program", "full"): _raise_limits,
    ("sync", "stale"): _free_sync,
    ("set_up", "others"): _stop_others,
}


def make_commands(components: Sequence[Component], computer: Participant | None, state: FleetState) -> Advices:
    """Return the commands to paste for components that are one finding; nothing if no value that was read says it."""
    fault = components[0].kind, components[0].mode
    if components[0].kind == "node" and fault not in COMMANDS:
        return list_remedies(components, computer, state)
    if computer is not None and (list_advices := STEPWISE.get(fault)):
        return tuple(list_advices(computer, components, state))
    found = COMMANDS.get(fault)
    if found is None or computer is None:
        return ()
    words = "; ".join(filter(None, dict.fromkeys(found(computer, components, state))))
    effects = (
        UNTIL if "nft insert " in words or words.startswith("iptables ") else "",
        PACKAGE if CONNTRACK in words else "",
        GOES if words.startswith("ip route del default ") else "",
        HANGS if words.startswith("kill -CONT ") else "",
    )
    effect = "; ".join(filter(None, effects))
    return (Advice(components[0].place, words, effect),) if words else ()
