# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The fate of packets in a network with a fault: a table of changes, and the same changes before a real kernel."""

import ctypes
import json
import os
import subprocess
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from ipaddress import IPv4Address, IPv4Network

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.facts import machine as look_at
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import network
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network import facts, packets
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import (
    Interface,
    Lookup,
    Machine,
    Packet,
    Route,
    Rule,
    kernel_routes,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.packets import echo, trace
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import COMMON
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._predict.prediction import predict
from worlds import address, change, change_interface, fig12, ping, route, tcp

from tests.simulator import network as simulated
from tests.simulator.multicast import send_to_group
from tests.simulator.network import report_end
from tests.simulator.state import loss, replace_link, simulate

PLAN = fig12()
WORLD = simulate(PLAN)
INNER, GATEWAY, FAR_GATEWAY, FAR = "tibi-nav", "tibi-visio", "dabo-visio", "dabo-nav"
FAR_ADDRESS = "192.168.10.100"


def _routes(name, *routes):
    """Other routes of a machine beside those of its own networks."""
    machine = WORLD.machines[name]
    own = [entry for interface in machine.interfaces for entry in kernel_routes(interface)]
    return change(WORLD, name, routes=(*own, *routes))


def _link(name, **fields):
    return replace_link(WORLD, replace(WORLD.links[name], **fields))


def _settings(name, **fields):
    machine = WORLD.machines[name]
    return change(WORLD, name, interfaces=tuple(replace(one, **fields) for one in machine.interfaces))


def _twin():
    """A stranger with the address of the far computer."""
    twin = Interface("eth0", (address("192.168.10.100/24"),), "the network of dabo")
    return replace(WORLD, machines={"stranger": Machine("stranger", (twin,), kernel_routes(twin)), **WORLD.machines})


NARROW = address("192.168.11.100/32")
WIDE = address("192.168.11.100/16")
DROP_ICMP = (Rule("in", "drop", "icmp"),)

TO_FAR = Lookup(100, "77", destination=IPv4Network("192.168.10.0/24"))

# A change, then the end of the packet from INNER to FAR: the outcome, where, and whether it is the answer that ends.
ENDS = {
    "no route": (_routes(INNER), "no route", INNER, False),
    "no way back": (_routes(FAR), "no route", FAR, True),
    "a refusing route": (
        _routes(
            INNER,
            route("0.0.0.0/0", "192.168.11.101", metric=5),
            Route(IPv4Network("192.168.10.0/24"), kind="blackhole"),
        ),
        "closed",
        INNER,
        False,
    ),
    "a rule that leads to another way": (
        change(WORLD, INNER, lookups=(TO_FAR,), tables={"77": (route("0.0.0.0/0", "192.168.11.9", "eth0"),)}),
        "nobody",
        INNER,
        False,
    ),
    "a rule for what comes in": (
        change(
            WORLD,
            FAR_GATEWAY,
            lookups=(replace(TO_FAR, source=IPv4Network("192.168.11.0/24"), incoming="eth1"),),
            tables={"77": (Route(IPv4Network("0.0.0.0/0"), kind="prohibit"),)},
        ),
        "rejected",
        FAR_GATEWAY,
        False,
    ),
    "another default route first": (
        _routes(INNER, route("0.0.0.0/0", "192.168.11.9"), route("0.0.0.0/0", "192.168.11.101", metric=100)),
        "nobody",
        INNER,
        False,
    ),
    "forwarding off": (_settings(GATEWAY, forwarding=False), "not forwarded", GATEWAY, False),
    "forwarding off there": (_settings(FAR_GATEWAY, forwarding=False), "not forwarded", FAR_GATEWAY, False),
    "switched off": (change(WORLD, FAR, on=False), "off", FAR, False),
    "gateway switched off": (change(WORLD, GATEWAY, on=False), "off", GATEWAY, False),
    "interface down": (change_interface(WORLD, GATEWAY, "eth1", up=False), "no route", GATEWAY, False),
    "its interface down": (change_interface(WORLD, FAR, "eth0", up=False), "down", FAR, False),
    "another address": (
        change_interface(WORLD, FAR, "eth0", addresses=(address("192.168.10.7/24"),)),
        "nobody",
        FAR_GATEWAY,
        False,
    ),
    "too wide a prefix": (change_interface(WORLD, INNER, "eth0", addresses=(WIDE,)), "nobody", INNER, False),
    "filter": (change(WORLD, FAR, rules=DROP_ICMP), "filtered", FAR, False),
    "filter of answers": (change(WORLD, INNER, rules=DROP_ICMP), "filtered", INNER, True),
    "filter that follows connections": (
        change(WORLD, INNER, rules=(Rule("in", "drop", "icmp", state="new"),)),
        "delivered",
        FAR,
        False,
    ),
    "filter of what is forwarded": (
        change(WORLD, GATEWAY, rules=(Rule("forward", "reject"),)),
        "rejected",
        GATEWAY,
        False,
    ),
    "filter of what leaves": (change(WORLD, INNER, rules=(Rule("out", "drop", "icmp"),)), "filtered", INNER, False),
    "filter of another protocol": (change(WORLD, FAR, rules=(Rule("in", "drop", "udp"),)), "delivered", FAR, False),
    "strict reverse path": (
        change(
            _settings(FAR_GATEWAY, rp_filter=1),
            FAR_GATEWAY,
            interfaces=tuple(replace(one, rp_filter=1) for one in WORLD.machines[FAR_GATEWAY].interfaces),
            routes=(*WORLD.machines[FAR_GATEWAY].routes, route("192.168.11.0/25", "192.168.10.100")),
        ),
        "reverse path",
        FAR_GATEWAY,
        False,
    ),
    "a circle": (
        _routes(GATEWAY, route("0.0.0.0/0", "192.168.1.1", "eth1")).replace_machine(
            replace(
                WORLD.machines["router"],
                routes=(
                    *kernel_routes(WORLD.machines["router"].interfaces[0]),
                    route("192.168.10.0/24", "192.168.1.201"),
                    route("192.168.11.0/24", "192.168.1.201"),
                ),
            )
        ),
        "circle",
        None,
        False,
    ),
    "masquerading": (
        change(WORLD, GATEWAY, rules=(Rule("nat", "masquerade", leaving="eth1"),)),
        "delivered",
        FAR,
        False,
    ),
    "link down": (_link(COMMON, up=False), "link down", COMMON, False),
    "clients apart": (_link(COMMON, apart=True), "apart", COMMON, False),
    "duplicate address": (_twin(), "elsewhere", None, None),
}


@pytest.mark.parametrize("name", ENDS)
def test_packets_end_where_they_should(name):
    world, outcome, where, answer = ENDS[name]
    found = echo(world, INNER, ping(FAR_ADDRESS))
    if name == "duplicate address":  # a matter of who asks: half of the fleet speaks with the wrong one
        ends = {echo(world, one, ping(FAR_ADDRESS)).there.where for one in WORLD.machines if one != FAR}
        assert ends <= {FAR, "stranger"} and "stranger" in ends
        return
    end = found.failure or found.there
    assert end.outcome == outcome, found
    assert where in (None, end.where)
    assert (found.back is end) == answer


LARGE = {
    "mtu of the sender": (change_interface(WORLD, INNER, "eth0", mtu=1400), "too large", INNER),
    "mtu on the way": (change_interface(WORLD, GATEWAY, "eth1", mtu=1400), "too large", GATEWAY),
    "mtu of the target": (change_interface(WORLD, FAR, "eth0", mtu=1400), "too large", FAR),
    "lost on the way": (_link(COMMON, largest=1000), "too large", COMMON),
}


@pytest.mark.parametrize("name", LARGE)
def test_only_large_packets_end(name):
    world, outcome, where = LARGE[name]
    assert echo(world, INNER, ping(FAR_ADDRESS)).ok
    end = echo(world, INNER, ping(FAR_ADDRESS, size=1500, whole=True)).failure
    assert (end.outcome, end.where) == (outcome, where)
    assert not echo(world, INNER, ping(FAR_ADDRESS, size=1500)).ok  # in fragments: the answer comes in whole


def test_masquerading_shows_the_gateways_address():
    world = ENDS["masquerading"][0]
    found = echo(world, INNER, ping(FAR_ADDRESS))
    assert found.ok and found.there.packet.source == IPv4Address("192.168.1.201")
    assert found.back.where == INNER
    back = echo(world, FAR, ping("192.168.11.100"))
    assert back.ok and back.there.packet.source == IPv4Address(FAR_ADDRESS)


REPORTS = {
    "switched off": "192.168.1.202 reports: host unreachable",
    "no route": "",  # its own kernel says so at once
    "forwarding off": "",
    "filter of what is forwarded": "192.168.11.101 reports: communication administratively prohibited",
    "a circle": "time to live exceeded",
    "interface down": "192.168.11.101 reports: network unreachable",
}


@pytest.mark.parametrize("name", REPORTS)
def test_routers_report_what_they_cannot_pass_on(name):
    world = ENDS[name][0]
    found = report_end(world, INNER, trace(world, INNER, ping(FAR_ADDRESS)))
    assert REPORTS[name] in found
    assert bool(found) == bool(REPORTS[name])


def test_loss_adds_up_over_the_links():
    world = _link(COMMON, loss=0.3)
    found = echo(world, INNER, ping(FAR_ADDRESS))
    assert loss(world, found) == pytest.approx(1 - 0.7 * 0.7)
    assert loss(world, echo(world, INNER, ping("192.168.11.101"))) == 0


def test_the_group_is_heard_where_nothing_stands_between():
    datagram, kobuki = tcp("239.255.0.1", 11511), IPv4Address("192.168.1.229")

    def heard(world):
        return {entry.machine for entry in send_to_group(world, "kobuki", kobuki, replace(datagram, protocol="udp"))}

    assert heard(WORLD) == {GATEWAY, FAR_GATEWAY, "router"}
    assert heard(_link(COMMON, pruned=frozenset({datagram.destination}))) == set()
    assert heard(change(WORLD, GATEWAY, rules=(Rule("in", "drop", "udp", (11511, 11511)),))) == {FAR_GATEWAY, "router"}
    assert heard(change(WORLD, "kobuki", rules=(Rule("out", "drop", "udp"),))) == set()
    assert heard(change_interface(WORLD, "kobuki", "eth0", up=False)) == set()


# The same before a kernel. Each machine is a network namespace, each link a bridge in one of its own.

#: what is tried there, as the model has it; `ip` and `sysctl` make the same there
TRIED = (
    "no route", "no way back", "a refusing route", "forwarding off", "its interface down", "another address",
    "too wide a prefix", "filter", "filter of what is forwarded", "strict reverse path", "masquerading", "a circle",
    "a rule that leads to another way", "a rule for what comes in",
)  # fmt: skip


OBSERVERS = (INNER, FAR_GATEWAY, "kobuki")
CLONE_NEWNET = 0x40000000  # linux/sched.h


class Namespaces:
    """The machines of a world as network namespaces; every command runs in one of them, and they go at the end."""

    def __init__(self):
        self.begin = f"world{os.getpid()}-"
        self.names = {name: self.begin + name for name in (*WORLD.machines, "links")}

    def run(self, machine, script):
        command = ["ip", "netns", "exec", self.names[machine], "sh", "-e"]
        done = subprocess.run(command, input=script, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{script}: {done.stderr}"
        return done.stdout

    def __enter__(self):
        for name in self.names.values():
            subprocess.run(["ip", "netns", "add", name], check=True)
        for number, link in enumerate(WORLD.links):
            self.run("links", f"ip link add link{number} type bridge mcast_snooping 0; ip link set link{number} up")
        for number, machine in enumerate(WORLD.machines.values()):
            self.run(machine.name, "ip link set lo up")
            for interface in machine.interfaces:
                bridge = f"link{list(WORLD.links).index(interface.link)}"
                port = f"p{number}{interface.name}"
                self.run(
                    "links",
                    f"ip link add {port} type veth peer name {interface.name} netns {self.names[machine.name]}\n"
                    f"ip link set {port} master {bridge}; ip link set {port} up",
                )
        return self

    def __exit__(self, *unused):
        for name in self.names.values():
            subprocess.run(["ip", "netns", "delete", name], check=False)

    def become(self, world):
        """Bring every machine into the state that it has in a world."""
        for machine in world.machines.values():
            self.run(machine.name, "\n".join(_commands(machine)))

    def inside(self, machine, function, *arguments):
        """Call a function in one of the namespaces: a thread may be in another one than its process."""
        found = []

        def enter():
            with open(f"/run/netns/{self.names[machine]}") as namespace:
                assert ctypes.CDLL(None, use_errno=True).setns(namespace.fileno(), CLONE_NEWNET) == 0
            found.append(function(*arguments))

        thread = threading.Thread(target=enter)
        thread.start()
        thread.join()
        return found[0]

    def pings(self, start, others):
        """The results of the verification's probe for these addresses."""
        return self.inside(start, network.ping, others, 2, 0.7)

    def info(self, machine):
        """The answer of multimaster_info there."""
        return self.inside(machine, look_at.look, {"parts": list(facts.NEEDED)})

    def next_hop(self, start, other):
        """The gateway that its kernel takes, and the source; None for no route."""
        command = ["ip", "netns", "exec", self.names[start], "ip", "-json", "route", "get", other]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            return None
        way = json.loads(done.stdout)[0]
        return way.get("gateway"), way.get("prefsrc")


def _commands(machine):
    yield "nft flush ruleset; ip neigh flush all; ip route flush table main; echo 0 > /proc/sys/net/ipv4/icmp_ratelimit"
    for interface in machine.interfaces:
        name, conf = interface.name, f"/proc/sys/net/ipv4/conf/{interface.name}"
        yield f"ip link set {name} down; ip address flush dev {name}"
        for entry in interface.addresses:
            yield f"ip address add {entry} dev {name}"
        yield f"ip link set {name} mtu {interface.mtu} " + ("up" if interface.up else "down")
        yield f"echo {int(interface.forwarding)} > {conf}/forwarding; echo {interface.rp_filter} > {conf}/rp_filter"
        neighbours = f"/proc/sys/net/ipv4/neigh/{name}"  # so that an address which nobody has is given up soon
        yield f"echo 1 > {neighbours}/mcast_solicit; echo 100 > {neighbours}/retrans_time_ms"
    yield "echo 0 > /proc/sys/net/ipv4/conf/all/rp_filter; echo 0 > /proc/sys/net/ipv4/conf/all/send_redirects"
    own = {entry for interface in machine.interfaces for entry in kernel_routes(interface)}
    for entry in machine.routes:
        if entry not in own and (not entry.device or machine.interface(entry.device).up):
            way = f"via {entry.gateway} dev {entry.device}" if entry.gateway else ""
            kind = "" if entry.kind == "unicast" else entry.kind
            yield f"ip route replace {kind} {entry.destination} {way} metric {entry.metric}"
    yield "while ip rule del priority 100 2>/dev/null; do :; done; ip route flush table 77 2>/dev/null || true"
    for name, entries in machine.tables.items():
        for entry in entries:
            way = f"via {entry.gateway} dev {entry.device}" if entry.gateway else ""
            yield f"ip route add {'' if entry.kind == 'unicast' else entry.kind} {entry.destination} {way} table {name}"
    for rule in machine.lookups:
        iif = f"iif {rule.incoming}" if rule.incoming else ""
        ends = f"from {rule.source or 'all'} to {rule.destination or 'all'}"
        yield f"ip rule add {ends} {iif} lookup {rule.table} priority {rule.priority}"
    if machine.rules:
        yield "nft add table ip world"
    for entry in machine.rules:
        if entry.chain == "nat":
            yield "nft 'add chain ip world nat { type nat hook postrouting priority 100; }'"
            yield f"nft add rule ip world nat oifname {entry.leaving} masquerade"
            continue
        hook = {"in": "input", "out": "output"}.get(entry.chain, "forward")
        yield f"nft 'add chain ip world {hook} {{ type filter hook {hook} priority 0; }}'"
        verdict = "reject with icmp admin-prohibited" if entry.verdict == "reject" else entry.verdict
        yield f"nft add rule ip world {hook} {f'ip protocol {entry.protocol}' if entry.protocol else ''} {verdict}"


@pytest.fixture(scope="module")
def namespaces():
    with Namespaces() as made:
        yield made


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planned", *TRIED])
def test_a_kernel_agrees(name, namespaces):
    """Pings of the verification's probe, the kernel's routes, and the prediction of what multimaster_info reads there."""
    world = WORLD if name == "planned" else ENDS[name][0]
    namespaces.become(world)
    addresses = {str(member.address): member.name for member in PLAN.members}
    with ThreadPoolExecutor(3) as pool:
        answers = dict(zip(OBSERVERS, pool.map(lambda one: namespaces.pings(one, addresses), OBSERVERS)))
        infos = dict(zip(PLAN.computers, pool.map(namespaces.info, PLAN.computers)))
    expected = {(pair.observer, pair.target): pair.now for pair in predict(PLAN, infos).pairs if pair.traffic == "ping"}
    for one in OBSERVERS:
        machine = world.machines[one]
        for other, name_of in addresses.items():
            if name_of == one:
                continue
            way = echo(world, one, ping(other))
            assert answers[one][other].ok == way.ok, (one, other, way)
            predicted = "reaches" if way.ok else "fails"
            assert expected[one, name_of] == predicted, (one, other, infos)
            if told := report_end(world, one, way.there):
                assert answers[one][other].error == told
            chosen = machine.route(ping(other))
            way = None
            if chosen is not None and chosen.kind == "unicast":
                way = str(chosen.gateway) if chosen.gateway else None, str(machine.source(chosen, IPv4Address(other)))
            assert namespaces.next_hop(one, other) == way, (one, other)


def test_the_words_of_routers_are_those_of_the_probes():
    text = open(
        os.path.join(os.path.dirname(packets.__file__), "../../module_utils/_probe/multicast/packets.py")
    ).read()
    assert all(f'"{words}"' in text for words in simulated.REPORTS.values())


def test_a_computer_reaches_itself():
    assert trace(WORLD, INNER, Packet("tcp", IPv4Address("127.0.1.1"), port=11311)).where == INNER
    assert trace(WORLD, INNER, tcp("192.168.11.100", 11311)).ok
    assert trace(change(WORLD, INNER, on=False), INNER, tcp("192.168.11.100", 11311)).outcome == "off"
