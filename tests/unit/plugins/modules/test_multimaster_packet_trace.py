# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""multimaster_packet_trace between computers: real packets in network namespaces, on a bridge in another one."""

import json
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import namespaces
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.packet_trace import (
    CapturedPacket,
    SeenPackets,
    SentProbe,
    TracedProbe,
    TraceObservation,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.trace import place
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.trace.place import TraceStage
from mentioned import mentions
from processes import with_paths

# A datagram, an echo request and a connection of others
TRAFFIC = """
import socket, sys
socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b"x" * 40, (sys.argv[1], 9))
echo = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_ICMP)
echo.sendto(b"\\x08\\x00\\xf7\\xff\\x00\\x00\\x00\\x00", (sys.argv[1], 0))
socket.socket(socket.AF_INET, socket.SOCK_STREAM).connect_ex((sys.argv[1], 10))
"""

pytestmark = pytest.mark.skipif(bool(namespaces.why_not()), reason=namespaces.why_not() or "can run")


@pytest.fixture
def three(tmp_path):
    """Two ends, and the third one, which is the gateway between them: the ends have an address in a network of their own."""
    network = namespaces.Network(3, tmp_path)
    yield network
    network.end()


def follow(network, probes, lifetime=60):
    """Listen everywhere, send, and return what each computer sent and saw."""
    options = [{"run": "test", "name": host.name, "probes": probes} for host in network.hosts]

    def call(number, action, **more):
        return network.run_module(
            network.hosts[number], "multimaster_packet_trace", {**options[number], "action": action, **more}
        )

    numbers = range(len(network.hosts))
    with ThreadPoolExecutor() as pool:
        list(pool.map(lambda number: call(number, "listen", lifetime=lifetime), numbers))
        sent = [result["sent"] for result in pool.map(lambda number: call(number, "send"), numbers)]
        return sent, list(pool.map(lambda number: call(number, "collect"), numbers))


def mac(host):
    return json.loads(host.run("ip", "-j", "link", "show", "eth0"))[0]["address"]


def seen(result, **wanted):
    return [entry for entry in result["seen"] if all(entry[key] == value for key, value in wanted.items())]


def probe(number, sender, protocol, target, port=0, **more):
    return {
        "number": number,
        "sender": sender.name,
        "protocol": protocol,
        "address": target.address,
        "port": port,
        **more,
    }


@pytest.mark.slow
def test_each_kind_of_packet_is_seen_at_both_ends(three):
    one, other, _third = three.hosts
    probes = [
        probe(0, one, "icmp", other),
        probe(1, one, "icmp", other, size=1400),
        probe(2, one, "tcp", other, 9),
        probe(3, one, "udp", other, 11511),
    ]
    sent, (here, there, beside) = follow(three, probes)
    assert [(entry["number"], entry["outcome"]) for entry in sent[0]] == [
        (0, "answered"), (1, "answered"), (2, "refused"), (3, "no_answer"),
    ]  # fmt: skip
    for number, protocol, length in ((0, "icmp", 28), (1, "icmp", 1400), (3, "udp", 33)):
        left = seen(here, number=number, outgoing=True, kind="request")
        came = seen(there, number=number, outgoing=False, kind="request")
        assert {entry["protocol"] for entry in left} == {protocol}
        assert [entry["length"] for entry in left] == [length] * 3
        assert {entry["target_mac"] for entry in left} == {entry["target_mac"] for entry in came} == {mac(other)}
        assert all(entry["intact"] and entry["ttl"] in (20, 64) for entry in came)
    assert len(seen(here, kind="answer", outgoing=False, number=1)) == 3
    syn, refusal = seen(here, protocol="tcp", outgoing=True)[0], seen(there, protocol="tcp", outgoing=True)[0]
    assert (syn["sequence"], refusal["kind"]) == (refusal["sequence"], "answer")
    assert syn["source_port"] == sent[0][2]["source_port"]
    assert seen(here, kind="error", protocol="udp")  # the port is closed, and the error quotes the datagram
    assert not [entry for entry in beside["seen"] if entry["protocol"] != "arp"]


# It takes a connection, and says nothing.
HANGS = """
import socket, sys, time
place = socket.create_server((sys.argv[1], 11311))
print(flush=True)
link = place.accept()
time.sleep(20)
"""


@pytest.mark.slow
@pytest.mark.parametrize("drops", [False, True])
def test_a_question_that_is_lost_is_not_confirmed(three, drops):
    one, other, _third = three.hosts
    server = other.popen(sys.executable, "-c", HANGS, other.address)
    server.stdout.readline()
    if drops:
        chain = "chain in { type filter hook input priority 0; tcp flags & psh == psh drop; }"
        other.run("nft", f"table ip lost {{ {chain}; }}")
    sent, _seen = follow(three, [probe(0, one, "tcp", other, 11311)])
    assert (sent[0][0]["outcome"], sent[0][0]["data"]) == ("open", "no_answer")
    assert bool(sent[0][0]["unconfirmed"]) == drops


@pytest.mark.slow
def test_other_traffic_is_not_seen(three):
    one, other, _third = three.hosts
    options = {"run": "test", "name": one.name, "probes": [probe(0, one, "tcp", other, 9)]}
    three.run_module(one, "multimaster_packet_trace", {**options, "action": "listen"})
    one.run(sys.executable, "-c", TRAFFIC, other.address)
    found = three.run_module(one, "multimaster_packet_trace", {**options, "action": "collect"})
    assert {entry["protocol"] for entry in found["seen"]} <= {"arp"}


@pytest.mark.slow
def test_an_error_of_a_hop_quotes_the_packet_and_a_counter_grows(three):
    one, other, third = three.hosts
    third.run("sysctl", "-q", "-w", "net.ipv4.ip_forward=1")
    one.run("ip", "route", "add", "10.77.0.0/24", "via", third.address)
    third.run("ip", "route", "add", "10.77.0.0/24", "via", other.address)
    one.run("sysctl", "-q", "-w", "net.ipv4.ip_default_ttl=1")
    sent, (here, _there, gateway) = follow(
        three, [{"number": 7, "sender": one.name, "protocol": "icmp", "address": "10.77.0.1"}]
    )
    assert sent[0][0]["outcome"] == "no_answer"
    assert {entry["ttl"] for entry in seen(here, number=7, outgoing=True)} == {1}
    errors = seen(here, number=7, kind="error")
    assert {(entry["icmp_type"], entry["reporter"]) for entry in errors} == {(11, third.address)}
    assert {"IpInHdrErrors", "IcmpOutTimeExcds"} <= {entry["counter"] for entry in gateway["counters"]}


@pytest.mark.slow
def test_a_listener_ends_by_itself_and_says_so(three):
    one = three.hosts[0]
    options = {"run": "test", "name": one.name, "probes": []}
    three.run_module(one, "multimaster_packet_trace", {**options, "action": "listen", "lifetime": 1})
    deadline = time.monotonic() + 10
    while one.processes():
        assert time.monotonic() < deadline
        time.sleep(0.1)
    answer = three.run_module(one, "multimaster_packet_trace", {**options, "action": "collect"}, True)
    assert "No listener of this run lives on this computer" in answer["msg"]


# What the controller says of real packets on links of other shapes: bridges, VLANs, address translation, routers of no fleet

# Echo requests of the run to a hardware address, each with a tag of a VLAN: source, target, both addresses, then number=VLAN
TAGGED_PINGS = """
import socket, struct, sys
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.trace.capture import Tag
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast.packets import checksum, echo_request
own, its = (bytes.fromhex(mac.replace(":", "")) for mac in sys.argv[1:3])
ends = b"".join(map(socket.inet_aton, sys.argv[3:5]))
link = socket.socket(socket.AF_PACKET, socket.SOCK_RAW)
link.bind(("eth0", 0))
for word in sys.argv[5:]:
    number, vlan = map(int, word.split("="))
    body = echo_request(Tag.from_run("test").identifier, number)
    head = struct.pack("!BBHHHBBH", 0x45, 0, 20 + len(body), 0, 0, 64, 1, 0) + ends
    head = head[:10] + struct.pack("!H", checksum(head)) + head[12:]
    link.send(its + own + struct.pack("!HHH", 0x8100, vlan, 0x0800) + head + body)
"""
FOUR = {1: ["10.0.1.1"], 2: ["10.0.2.1"], 3: ["10.0.1.254", "10.0.2.254"], 4: ["10.0.1.253"]}
DROPS = "table inet lost {{ chain c {{ type filter hook {} priority 0; {} drop; }}; }}"
NAT = "table ip nat {{ chain c {{ type nat hook {}; {}; }}; }}"


@pytest.fixture
def four(tmp_path):
    """Two ends in networks of their own, the router between them, and a computer beside the first one."""
    network = namespaces.Network(4, tmp_path)
    for number, host in enumerate(network.hosts, 1):
        host.run("ip", "address", "flush", "dev", "eth0")
        for address in FOUR[number]:
            host.run("ip", "address", "add", f"{address}/24", "dev", "eth0")
    one, other, router, _beside = network.hosts
    router.run("sysctl", "-q", "-w", "net.ipv4.ip_forward=1")
    one.run("ip", "route", "add", "default", "via", "10.0.1.254")
    other.run("ip", "route", "add", "default", "via", "10.0.2.254")
    yield network
    network.end()


def list_links(host):
    links = json.loads(host.run("ip", "-j", "address"))
    own = [link for link in links if link["ifname"] != "lo" and link["addr_info"]]
    return {link["address"] for link in own}, {one["local"] for link in own for one in link["addr_info"]}


def judge(network, route, address, protocols, unasked=()):
    """Follow a packet of each protocol along the planned route; return what is said of each: the stage, the computer, and its words."""
    hosts = {host.name: list_links(host) for host in network.hosts if host not in unasked}
    names = {one: name for name, (_macs, addresses) in hosts.items() for one in addresses}
    traffic = {"icmp": "icmp", "tcp": "rpc"}
    probes = [
        TracedProbe(number, route[0].name, route[-1].name, traffic[protocol], protocol, address, 11611)
        for number, protocol in enumerate(protocols)
    ]
    sent, collected = follow(network, [vars(one) for one in probes])
    outcomes = [
        SentProbe(**{**one, "outcome": Outcome(one["outcome"]), "data": Outcome(one["data"])})
        for one in sent[network.hosts.index(route[0])]
    ]
    looks = {
        host.name: TraceObservation(packets=SeenPackets(tuple(CapturedPacket(**one) for one in result["seen"])))
        for host, result in zip(network.hosts, collected, strict=True)
        if host.name in hosts
    }
    looks[route[0].name] = TraceObservation(tuple(probes), tuple(outcomes), looks[route[0].name].packets)
    chart = place.Map(
        {mac: frozenset([name]) for name, (macs, _addresses) in hosts.items() for mac in macs},
        lambda one: names.get(one, ""),
        frozenset(hosts),
    )
    found = place.locate(looks, chart, {one.number: [host.name for host in route] for one in probes})
    return [(one.stage, one.at, place.describe_place(one, chart) if one.is_fault else "") for one in found]


def make_bridge(host, number):
    """Put the address of a computer on a bridge, whose hardware address no port has."""
    host.run("ip", "link", "add", "br0", "address", f"02:00:00:00:00:0{number}", "up", "type", "bridge")
    host.run("ip", "link", "set", "eth0", "master", "br0")
    host.run("ip", "address", "flush", "dev", "eth0")
    host.run("ip", "address", "add", f"{host.address}/24", "dev", "br0")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "hook", "said", "words"),
    [
        (0, "", TraceStage.ARRIVED, ""),
        (0, "output", TraceStage.SOURCE, "do not leave robot1computer"),
        (1, "input", TraceStage.TARGET, "came in at robot2computer on eth0, which sent no answer"),
    ],
    ids=["well", "near", "far"],
)
def test_what_a_bridge_drops_ends_at_its_computer(three, number, hook, said, words):
    one, other, _third = three.hosts
    for place_of, host in enumerate((one, other)):
        make_bridge(host, place_of)
    if hook:
        chain = f"chain c {{ type filter hook {hook} priority 0; ether type ip drop; }}"
        three.hosts[number].run("nft", f"table bridge lost {{ {chain}; }}")
    for stage, _at, sentence in judge(three, [one, other], other.address, ["icmp", "tcp"]):
        assert stage == said and sentence.endswith(words)


@pytest.mark.slow
def test_what_comes_for_another_vlan_has_not_come_in(three):
    """Without a number the tag has a priority alone, and the kernel takes the packet for one without a tag."""
    one, other, _third = three.hosts
    options = {"run": "test", "name": other.name, "probes": []}
    three.run_module(other, "multimaster_packet_trace", {**options, "action": "listen"})
    ends = [mac(one), mac(other), one.address, other.address]
    one.run(sys.executable, "-c", TAGGED_PINGS, *ends, "1=20", "2=0", "3=4095", env=with_paths())
    found = three.run_module(other, "multimaster_packet_trace", {**options, "action": "collect"})
    assert [entry["number"] for entry in found["seen"] if not entry["outgoing"] and entry["protocol"] == "icmp"] == [2]


@pytest.mark.parametrize(
    ("number", "said", "words"),
    [(10, TraceStage.ARRIVED, ""), (20, TraceStage.WIRE, "left robot1computer on eth0.10 for robot2computer {}, and did not come in there")],
    ids=["well", "wrong"],
)  # fmt: skip
def test_a_vlan_with_a_wrong_number_is_named(three, number, said, words):
    one, other, _third = three.hosts
    for host, vlan in ((one, 10), (other, number)):
        made = host.popen("ip", "link", "add", "link", "eth0", "name", f"eth0.{vlan}", "type", "vlan", "id", str(vlan))
        if made.wait():
            pytest.skip("this kernel has no VLANs")
        host.run("ip", "address", "flush", "dev", "eth0")
        host.run("ip", "link", "set", f"eth0.{vlan}", "up")
        host.run("ip", "address", "add", f"{host.address}/24", "dev", f"eth0.{vlan}")
    for host, to, vlan in ((one, other, 10), (other, one, number)):
        host.run("ip", "neighbour", "replace", to.address, "lladdr", mac(to), "dev", f"eth0.{vlan}")
    for stage, _at, sentence in judge(three, [one, other], other.address, ["icmp", "tcp"]):
        assert stage == said and sentence.endswith(words.format(mac(other)))


@pytest.mark.slow
@pytest.mark.parametrize("drops", [False, True])
def test_a_nat_that_changes_identifiers_is_not_blamed(four, drops):
    one, other, router, _beside = four.hosts
    router.run("nft", NAT.format("postrouting priority 100", "ip saddr 10.0.1.1 masquerade fully-random"))
    if drops:
        other.run("nft", DROPS.format("input", ""))
    said = judge(four, [one, router, other], "10.0.2.1", ["icmp", "tcp"])
    expected = [TraceStage.UNSEEN, TraceStage.TARGET] if drops else [TraceStage.ARRIVED, TraceStage.ARRIVED]
    assert [stage for stage, _at, _words in said] == expected
    assert said[1][1] == (other.name if drops else one.name)


@pytest.mark.slow
def test_an_answer_of_another_address_ends_where_it_changed(four):
    one, other, router, _beside = four.hosts
    router.run(
        "nft",
        "table ip odd { chain c { type filter hook forward priority 0; ip saddr 10.0.2.1 ip saddr set 10.0.1.77; }; }",
    )
    (_ping, (stage, at, words)) = judge(four, [one, router, other], "10.0.2.1", ["icmp", "tcp"])
    assert (stage, at) == (TraceStage.CHANGED, router.name)
    assert mentions(words, "robot3computer", "eth0", "10.0.1.77", "10.0.2.1")


@pytest.mark.slow
def test_a_computer_that_others_made_the_target_is_not_blamed(four):
    one, other, router, beside = four.hosts
    router.run("nft", NAT.format("prerouting priority -100", "ip daddr 10.0.2.1 dnat to 10.0.1.253"))
    beside.run("nft", DROPS.format("input", ""))
    for stage, at, words in judge(four, [one, router, other], "10.0.2.1", ["icmp", "tcp"]):
        assert (stage, at) == (TraceStage.CHANGED, router.name)
        assert mentions(words, "robot3computer", "eth0", "10.0.1.253", "10.0.2.1")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("drops", "said", "name"),
    [((), TraceStage.ARRIVED, 0), ((1, "input"), TraceStage.TARGET, 1), ((2, "forward"), TraceStage.STRANGER, 0)],
    ids=["well", "far", "middle"],
)
def test_a_router_that_nobody_planned_may_pass_packets_on(four, drops, said, name):
    one, other, router, beside = four.hosts
    if drops:
        four.hosts[drops[0]].run("nft", DROPS.format(drops[1], ""))
    for stage, at, _words in judge(four, [one, beside, other], "10.0.2.1", ["icmp", "tcp"], unasked=[router]):
        assert (stage, at) == (said, four.hosts[name].name)
