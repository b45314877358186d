# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The place where packets end: from what three computers captured of a ping, a connection and a datagram."""

import random
from dataclasses import replace

import lies
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import Component
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.packet_trace import (
    CapturedPacket,
    Counter,
    SeenPackets,
    SentProbe,
    TracedProbe,
    TraceObservation,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.trace import place, suspects
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.trace.place import Map, TraceStage
from hypothesis import given
from hypothesis import strategies as st
from mentioned import mentions

ROUTE = ["one", "gate", "two"]
MACS = {"one": "02:00:00:00:00:01", "gate": "02:00:00:00:00:02", "two": "02:00:00:00:00:03"}
ADDRESSES = {"10.0.1.1": "one", "10.0.1.254": "gate", "10.0.2.254": "gate", "10.0.2.1": "two"}
CHART = Map(
    {mac: frozenset([name]) for name, mac in MACS.items()}, lambda address: ADDRESSES.get(address, ""), frozenset(ROUTE)
)
PING = TracedProbe(3, "one", "two", "icmp", "icmp", "10.0.2.1")
CALL = TracedProbe(3, "one", "two", "rpc", "tcp", "10.0.2.1", port=11611)
BEAT = TracedProbe(3, "one", "two", "udp", "udp", "10.0.2.1", port=11511)


def capture(outgoing, kind, mac="", probe=PING, **more):
    number, sequence = (-1, 77) if probe.protocol == "tcp" else (probe.number, 0)
    ends = ("10.0.1.1", "10.0.2.1") if kind != "answer" else ("10.0.2.1", "10.0.1.1")
    values = {"source_port": 4000, "port": probe.port, "number": number, "sequence": sequence, "ttl": 64, "length": 60}
    interface = more.pop("interface", "eth0")
    return CapturedPacket(interface, outgoing, kind, probe.protocol, *ends, **{**values, "target_mac": mac, **more})


def cross(kind, hops, probe=PING, **more):
    """The captures of a packet by computer: in and out at each of the hops, until the last one."""
    seen = {name: [] for name in ROUTE}
    for before, after in zip(hops, hops[1:], strict=False):
        seen[before].append(capture(True, kind, MACS[after], probe, **more))
        seen[after].append(capture(False, kind, MACS[after], probe, **more))
    return seen


def join(*all_seen):
    return {name: [one for seen in all_seen for one in seen[name]] for name in ROUTE}


def find(seen, probe=PING, sent=None, listening=tuple(ROUTE), chart=CHART):
    looks = {name: TraceObservation(packets=SeenPackets(tuple(seen[name]))) for name in listening}
    sent = sent or SentProbe(probe.number, Outcome.NO_ANSWER, source_port=4000)
    first = looks.get("one", TraceObservation())
    looks["one"] = TraceObservation((probe,), (sent,), first.packets)
    chart = replace(chart, listening=frozenset(listening), networks={("one", "gate"): "net 1"})
    (found,) = place.locate(looks, chart, {probe.number: ROUTE})
    return found


def where(found):
    return found.stage, found.at, found.next, found.answer


@pytest.mark.parametrize("probe", [PING, CALL], ids=["ping", "connection"])
def test_packets_are_walked_there_and_back(probe):
    seen = join(cross("request", ROUTE, probe), cross("answer", ROUTE[::-1], probe))
    for outcome in (Outcome.ANSWERED, Outcome.OPEN, Outcome.REFUSED):
        assert where(find(seen, probe, SentProbe(3, outcome, source_port=4000))) == (
            TraceStage.ARRIVED,
            "one",
            "",
            True,
        )
    kept = find(seen, probe)  # the program that has sent them got no answer, which came in all the same
    assert where(kept) == (TraceStage.WITHHELD, "one", "", True)
    assert mentions(place.describe_place(kept, CHART), "one", "eth0", "no program")
    assert suspects.is_consistent(Component("filter", "one", "rpc in"), kept)
    assert not suspects.is_consistent(Component("filter", "two", "rpc in"), kept)


@pytest.mark.parametrize("probe", [PING, CALL, BEAT], ids=["ping", "connection", "datagram"])
def test_the_last_step_that_was_seen_is_the_place(probe):
    nothing = {name: [] for name in ROUTE}
    assert where(find(nothing, probe)) == (TraceStage.SOURCE, "one", "gate", False)
    assert where(find(cross("request", ["one", "gate"], probe), probe)) == (TraceStage.HOP, "gate", "two", False)
    lost = cross("request", ["one", "gate"], probe)
    lost["gate"].append(capture(True, "request", MACS["two"], probe))
    assert where(find(lost, probe)) == (TraceStage.WIRE, "gate", "two", False)
    arrived = cross("request", ROUTE, probe)
    end = (TraceStage.ARRIVED, "two", "", False) if probe is BEAT else (TraceStage.TARGET, "two", "", False)
    assert where(find(arrived, probe)) == end


def test_each_step_that_was_seen_is_kept_with_its_values():
    seen = join(cross("request", ROUTE), cross("answer", ["two", "gate"], ttl=7))
    seen["gate"].append(capture(True, "answer", "02:00:00:00:00:99", interface="eth1"))
    found = find(seen)
    assert found.route == tuple(ROUTE)
    steps = [(one.sender, one.receiver, one.answer, one.arrived, one.ttl) for one in found.hops]
    assert steps == [
        ("one", "gate", False, True, 64),
        ("gate", "two", False, True, 64),
        ("two", "gate", True, True, 7),
        ("gate", "", True, False, 64),
    ]
    last = found.hops[-1]
    assert (last.network, last.left, last.target_mac, last.came) == ("", "eth1", "02:00:00:00:00:99", "")
    assert [(one.network, one.came) for one in found.hops[:3]] == [("net 1", "eth0"), ("", "eth0"), ("", "eth0")]


def test_an_answer_is_lost_on_its_own_way():
    seen = join(cross("request", ROUTE), cross("answer", ["two", "gate"]))
    found = find(seen)
    assert where(found) == (TraceStage.HOP, "gate", "one", True)
    assert mentions(place.describe_place(found, CHART), "pings", "one", "two", "gate")


def test_a_strange_hardware_address_is_named_with_the_right_one():
    seen = cross("request", ["one", "gate"])
    seen["gate"].append(capture(True, "request", "02:00:00:00:00:99"))
    found = find(seen)
    assert where(found) == (TraceStage.STRANGER, "gate", "two", False)
    words = place.describe_place(found, CHART)
    assert mentions(words, "02:00:00:00:00:99", "fleet")
    assert words.endswith("(two, which was expected, has 02:00:00:00:00:03)")


def test_a_question_without_an_answer_names_both_sides():
    asked = CapturedPacket("eth0", True, "request", "arp", "10.0.1.1", "10.0.1.254")
    found = find({"one": [asked], "gate": [], "two": []})
    assert where(found) == (TraceStage.ASKED, "one", "gate", False)
    assert suspects.name_place(found, "x").places == ("gate", "one")
    answer = CapturedPacket("eth0", False, "answer", "arp", "10.0.1.254", "10.0.1.1")
    assert find({"one": [asked, answer], "gate": [], "two": []}).stage == TraceStage.SOURCE


def test_a_question_of_another_program_is_none_of_the_probe():
    asked = CapturedPacket("eth0", True, "request", "arp", "10.0.1.1", "10.0.1.77")
    assert find({"one": [asked], "gate": [], "two": []}).stage == TraceStage.SOURCE


def test_a_connection_of_another_program_is_none_of_the_probe():
    for more in ({"source_port": 4001}, {"destination": "10.0.2.2"}):
        seen = {"one": [capture(True, "request", MACS["gate"], CALL)], "gate": [], "two": []}
        seen["one"] = [replace(one, **more) for one in seen["one"]]
        assert where(find(seen, CALL)) == (TraceStage.SOURCE, "one", "gate", False)


def test_a_computer_that_did_not_listen_is_no_place():
    found = find(cross("request", ["one", "gate"]), listening=["one", "two"])
    assert found.stage == TraceStage.UNSEEN
    assert not found.is_fault


@pytest.mark.parametrize("outcome", [Outcome.NO_ANSWER, Outcome.FAILED, Outcome.NOT_TRIED])
def test_a_sender_that_did_not_listen_or_send_is_no_place(outcome):
    nothing, sent = {name: [] for name in ROUTE}, SentProbe(3, outcome, source_port=4000)
    others = ["gate", "two"] if outcome == Outcome.NO_ANSWER else ROUTE
    assert find(nothing, sent=sent, listening=others).stage == TraceStage.UNSEEN
    refused = SentProbe(3, Outcome.NOT_PERMITTED)  # the errno of its kernel needs no listener
    assert find(nothing, sent=refused, listening=others).stage == TraceStage.SOURCE


def test_a_packet_to_the_own_hardware_address_ends_at_its_sender():
    seen = cross("request", ["one", "gate"])
    seen["gate"].append(capture(True, "request", MACS["gate"]))
    found = find(seen)
    assert where(found) == (TraceStage.SELF, "gate", "", False) and found.places == ("gate",)
    assert mentions(place.describe_place(found, CHART), "gate", "eth0", "02:00:00:00:00:02")


def test_a_target_that_missed_packets_is_no_place():
    assert find(cross("request", ROUTE)).stage == TraceStage.TARGET
    assert find(cross("request", ROUTE), listening=["one", "gate"]).stage == TraceStage.UNSEEN


def test_an_unknown_mac_may_be_that_of_the_planned_computer():
    """A bridge translates it, or the computer that has it was not asked."""
    seen = cross("request", ROUTE)
    seen["gate"] = [seen["gate"][0], capture(True, "request", "02:00:00:00:00:99")]
    assert where(find(seen))[:2] == (TraceStage.TARGET, "two")
    flooded = {**seen, "two": [capture(False, "request", "02:00:00:00:00:99")]}  # by a switch that knows nobody with it
    assert find(flooded).stage == TraceStage.STRANGER
    chart = replace(CHART, hosts={mac: names for mac, names in CHART.hosts.items() if "gate" not in names})
    lost = {"one": [capture(True, "request", MACS["gate"])], "two": []}
    looks = {name: TraceObservation(packets=SeenPackets(tuple(packets))) for name, packets in lost.items()}
    looks["one"] = replace(looks["one"], probes=(PING,), sent=(SentProbe(3, Outcome.NO_ANSWER),))
    (found,) = place.locate(looks, replace(chart, listening=frozenset(lost)), {3: ROUTE})
    assert (found.stage, found.next) == (TraceStage.UNSEEN, "gate")


def test_a_report_about_packets_that_were_answered_ends_nothing():
    there, back = cross("request", ROUTE), cross("answer", ROUTE[::-1])
    seen = join(there, back)
    seen["one"].append(capture(False, "error", icmp_type=11, icmp_code=0, reporter="10.0.1.254"))
    assert find(seen, sent=SentProbe(3, Outcome.ANSWERED)).stage == TraceStage.ARRIVED
    assert find(seen).stage == TraceStage.WITHHELD
    lost = cross("request", ["one", "gate"])
    report = capture(False, "error", icmp_type=3, icmp_code=13, reporter="10.0.1.254")
    lost["one"].append(replace(report, destination="10.0.2.9"))
    assert find(lost).stage == TraceStage.HOP  # it quotes a packet to another address
    lost["one"].append(report)
    assert find(lost).stage == TraceStage.REPORTED


def test_a_sender_that_rejects_the_answers_withholds_them():
    """Its own ICMP errors are about the answers, and go out."""
    seen = join(cross("request", ROUTE, CALL), cross("answer", ROUTE[::-1], CALL))
    own = capture(True, "error", probe=CALL, icmp_type=3, icmp_code=3, reporter="10.0.1.1")
    seen["one"].append(replace(own, source="10.0.2.1", destination="10.0.1.1"))
    assert where(find(seen, CALL)) == (TraceStage.WITHHELD, "one", "", True)


def test_a_connection_that_is_rejected_ends_there():
    seen = cross("request", ROUTE, CALL)
    seen["one"].append(capture(False, "error", probe=CALL, icmp_type=3, icmp_code=3, reporter="10.0.2.1"))
    assert where(find(seen, CALL))[:2] == (TraceStage.REPORTED, "two")


def test_a_bridge_shows_each_packet_twice_and_counts_once():
    seen = cross("request", ["one", "gate"])
    seen["gate"] = [replace(one, interface=name) for one in seen["gate"] for name in ("port", "bridge")]
    assert find(seen).times == 1


def test_an_interface_above_another_one_is_named():
    """That of a VLAN, whose packets leave by its parent, too."""
    seen = cross("request", ["one", "gate"])
    seen["one"] = [replace(one, interface=name) for one in seen["one"] for name in ("eth0.10", "eth0")]
    assert find(seen).hops[0].left == "eth0.10"


def test_containers_with_one_hardware_address_are_told_apart():
    """As those of IPVLAN are, which have that of their machine."""
    chart = replace(CHART, hosts={**CHART.hosts, MACS["two"]: frozenset(["another", "gate", "two"])})
    seen = join(cross("request", ROUTE), cross("answer", ROUTE[::-1]))
    assert where(find(seen, chart=chart)) == (TraceStage.WITHHELD, "one", "", True)
    lost = cross("request", ROUTE)
    lost["two"] = []
    assert where(find(lost, chart=chart)) == (TraceStage.WIRE, "gate", "two", False)


def test_an_answer_at_another_interface_is_none():
    """The kernel takes it where it has asked: a bond with the answers at its inactive port does not."""
    asked = [
        CapturedPacket(name, True, "request", "arp", "10.0.1.1", "10.0.1.254")
        for name in ("bond0", "eth0")  # each shows the question
    ]
    for name, stage in (("eth1", TraceStage.ASKED), ("eth0", TraceStage.ASKED), ("bond0", TraceStage.SOURCE)):
        answer = CapturedPacket(name, False, "answer", "arp", "10.0.1.254", "10.0.1.1")
        assert find({"one": [*asked, answer], "gate": [], "two": []}).stage == stage


def test_what_is_answered_ends_nowhere_where_nobody_saw_it():
    for outcome, stage in ((Outcome.ANSWERED, TraceStage.ARRIVED), (Outcome.NO_ANSWER, TraceStage.HOP)):
        assert find(cross("request", ["one", "gate"]), sent=SentProbe(3, outcome)).stage == stage


def test_an_answer_that_changed_unseen_has_no_place():
    seen = join(cross("request", ROUTE), cross("answer", ROUTE[::-1]))
    seen["one"] = [one if one.outgoing else replace(one, source="10.0.2.9") for one in seen["one"]]
    found = find(seen)
    assert (found.stage, found.at) == (TraceStage.UNSEEN, "")


def test_a_closed_port_shows_that_a_datagram_has_arrived():
    seen = cross("request", ROUTE, BEAT)
    seen["one"].append(capture(False, "error", probe=BEAT, icmp_type=3, icmp_code=3, reporter="10.0.2.1"))
    assert find(seen, BEAT).stage == TraceStage.ARRIVED


@pytest.mark.parametrize("mac", ["", "ff:ff:ff:ff:ff:ff", "01:00:5e:62:00:00", '"zz', "::"])
def test_without_a_hardware_address_the_plan_names_the_next(mac):
    seen = cross("request", ROUTE)
    seen["one"] = [capture(True, "request", mac)]
    assert find(seen).stage == TraceStage.TARGET


def test_packets_that_turn_round_come_to_an_end():
    seen = {name: [capture(False, "request"), capture(True, "request", MACS["one"])] for name in ROUTE}
    found = find(seen)
    assert found.stage == TraceStage.CIRCLE and "come back to one" in place.describe_place(found, CHART)
    assert suspects.is_consistent(Component("route", "one", "circle"), found)


# What place, errno and counters show together


def show(found, *counters):
    return suspects.find_sign(found, SeenPackets(counters=tuple(Counter(name, 1) for name in counters)))


def test_an_errno_of_the_sender_is_evidence():
    nothing = {name: [] for name in ROUTE}
    for outcome, component in (
        (Outcome.NO_LOCAL_PORT, Component("computer", "one", "ports")),
        (Outcome.NO_FILE, Component("computer", "one", "limit", "a process may not open more files")),
        (Outcome.NOT_PERMITTED, Component("filter", "one", "rpc out")),
        (Outcome.CLOSED_ROUTE, None),  # a rule or a route, and each of them is read
        (Outcome.NO_ANSWER, None),
    ):
        assert show(find(nothing, CALL, SentProbe(3, outcome))) == component


def test_a_short_life_is_told_from_a_circle_of_routers():
    for ttl, component in ((1, Component("setting", "one", "ttl")), (64, None)):
        seen = cross("request", ["one", "gate"], ttl=ttl)
        seen["one"].append(capture(False, "error", icmp_type=11, icmp_code=0, reporter="10.0.1.254", ttl=64))
        found = find(seen)
        assert (found.stage, found.at) == (TraceStage.REPORTED, "gate")
        assert show(found) == component
        assert suspects.is_consistent(Component("route", "gate", "circle"), found)


def test_a_counter_is_a_hint_only_where_packets_end():
    hop = find(cross("request", ["one", "gate"]))
    assert show(hop, "TcpExtIPReversePathFilter") == Component("reverse_path", "gate", "strict")
    assert show(hop, '"rule of filter FORWARD: drop"') == Component("filter", "gate", "forward")
    assert show(hop, "IpOutDiscards") is None
    target = find(cross("request", ROUTE, CALL), CALL)
    assert show(target, '"rule of filter INPUT: tcp dport 11611 drop"') == Component("filter", "two", "rpc in")


def test_a_hardware_address_set_by_hand_is_evidence():
    seen = cross("request", ["one", "gate"])
    seen["gate"].append(capture(True, "request", "02:00:00:00:00:99"))
    found = find(seen)
    assert show(found) is None
    fixed = SeenPackets(fixed=("02:00:00:00:00:99",))
    assert suspects.find_sign(found, fixed) == Component("neighbour", "gate", "fixed", "two")


def test_a_rule_that_drops_something_else_is_no_evidence():
    twice = join(cross("request", ["one", "gate"]), cross("request", ["one", "gate"]))
    assert show(find(twice), '"rule of filter FORWARD: drop"') is None  # it has counted one of two
    target = find(cross("request", ROUTE, CALL), CALL)
    assert show(target, '"rule of filter INPUT: pkttype broadcast drop"') is None


def test_a_counter_of_others_is_no_evidence():
    twice = join(cross("request", ["one", "gate"]), cross("request", ["one", "gate"]))
    assert show(find(twice), "TcpExtIPReversePathFilter") is None  # it has counted one of two
    hop = find(cross("request", ["one", "gate"]))
    for chain in ("INPUT", "ufw-before-output", "filter_INPUT_POLICIES"):
        assert show(hop, f'"rule of filter {chain}: pkttype broadcast drop"') is None
    assert show(hop, '"rule of filter DOCKER-USER: input_guard drop"') == Component("filter", "gate", "forward")


def test_the_last_hop_of_a_life_at_its_target_is_no_fault():
    assert show(find(cross("request", ROUTE, ttl=1))) is None
    assert show(find(cross("request", ["one", "gate"], ttl=1))) == Component("setting", "one", "ttl")


HOSTILE = st.builds(
    CapturedPacket,
    st.sampled_from(["eth0", '"\u202e"']), st.booleans(), st.sampled_from(["request", "answer", "error", "x"]),
    st.sampled_from(["icmp", "tcp", "udp", "arp", "x"]), st.sampled_from([*ADDRESSES, "x"]), st.sampled_from([*ADDRESSES, "x"]),
    st.sampled_from([0, 4000]), st.sampled_from([0, 11611]), st.sampled_from([-1, 3]), st.sampled_from([0, 77]),
    st.integers(-1, 300), st.integers(-1, 70000), st.booleans(), st.just(""), st.sampled_from([*MACS.values(), "", "zz"]),
    st.integers(-1, 300), st.integers(-1, 300), st.sampled_from([*ADDRESSES, "x"]),
)  # fmt: skip


@given(
    st.fixed_dictionaries({name: st.lists(HOSTILE, max_size=6) for name in ROUTE}), st.sampled_from([PING, CALL, BEAT])
)
def test_whatever_computers_tell_has_a_place_and_words(seen, probe):
    found = find(seen, probe)
    assert len(found.hops) <= 2 * place.MOST_HOPS and all(one.arrived and one.receiver for one in found.hops[:-1])
    assert all(one.sender and (one.receiver or not one.arrived) for one in found.hops[-1:])
    if found.is_fault:
        assert place.describe_place(found, CHART)
        assert suspects.find_sign(found, SeenPackets()) or suspects.name_place(found, "x").sentence()


@pytest.mark.parametrize(
    ("hops", "right", "wrong"),
    [
        ([], ("filter", "one", "icmp out"), ("filter", "two", "icmp in")),
        (["one", "gate"], ("forwarding", "gate", "off"), ("filter", "one", "icmp out")),
        (ROUTE, ("filter", "two", "icmp in"), ("filter", "gate", "forward")),
    ],
    ids=["source", "hop", "target"],
)
def test_a_place_leaves_few_components(hops, right, wrong):
    found = find(cross("request", hops) if hops else {name: [] for name in ROUTE})
    assert suspects.is_consistent(Component(*right), found)
    assert not suspects.is_consistent(Component(*wrong), found)


@pytest.mark.parametrize(
    ("unconfirmed", "expected"), [(1, (TraceStage.CUT, "one", "two", False)), (0, (TraceStage.MUTE, "two"))]
)
def test_a_lost_question_is_told_from_a_program_that_hangs(unconfirmed, expected):
    both = join(cross("request", ROUTE, CALL), cross("answer", ROUTE[::-1], CALL))
    sent = SentProbe(3, Outcome.OPEN, source_port=4000, data=Outcome.NO_ANSWER, unconfirmed=unconfirmed)
    found = find(both, CALL, sent)
    assert where(found)[: len(expected)] == expected
    words = place.describe_place(found, CHART)
    assert ("two does not confirm a question" in words) == bool(unconfirmed)


# One computer that lies


@pytest.mark.parametrize("seed", range(8))
def test_a_lie_costs_nobody_else_anything(seed):
    """A liar beside the way changes nothing where others saw the packets. One on the way is in each place that it makes up."""
    for number in range(250):
        chance = random.Random(f"{seed} {number}")
        world = lies.draw_world(chance)
        true, liar = world.find(), chance.choice(lies.NAMES)
        told = lies.draw_lie(chance, world, liar).find()
        if not told.is_fault or (true.is_fault and told.at == true.at):
            continue
        if liar not in world.route:
            assert (true.stage, told.at) == (TraceStage.STRANGER, liar), number
        elif told.at in lies.NAMES:
            assert liar in suspects.name_place(told, "x").places, number


def test_who_gets_broken_packets_is_not_where_they_end():
    seen = cross("request", ROUTE[:2])
    assert where(find(seen)) == (TraceStage.HOP, "gate", "two", False)
    seen["gate"] = [replace(one, intact=False) for one in seen["gate"]]
    assert where(find(seen)) == (TraceStage.WIRE, "one", "gate", False)


def test_a_report_that_its_computer_denies_is_none():
    """It has passed the packets on, it has none of them, or it is their end and has answered."""
    for protocol, hops, at, stage in (
        (CALL, ROUTE, "10.0.1.254", TraceStage.TARGET),
        (CALL, ["one", "gate"], "10.0.2.1", TraceStage.HOP),
        (PING, ["one", "gate"], "10.0.2.1", TraceStage.UNSEEN),  # it may have come there with another identifier
        (BEAT, ROUTE, "10.0.2.1", TraceStage.ARRIVED),
    ):
        seen = cross("request", hops, protocol)
        seen["one"].append(capture(False, "error", probe=protocol, icmp_type=3, icmp_code=13, reporter=at))
        assert find(seen, protocol).stage == stage
        name = ADDRESSES[at]
        seen[name].append(capture(True, "error", probe=protocol, icmp_type=3, icmp_code=13, reporter=at))
        assert where(find(seen, protocol))[:2] == (TraceStage.REPORTED, name)


def test_who_tells_the_address_of_a_router_takes_no_packets():
    seen = cross("request", ROUTE)
    seen["gate"] = [seen["gate"][0], capture(True, "request", "02:00:00:00:00:99")]
    hosts = {**CHART.hosts, "02:00:00:00:00:99": frozenset(["other"])}
    assert where(find(seen, chart=replace(CHART, hosts=hosts)))[:2] == (TraceStage.TARGET, "two")


def test_packets_came_back_only_with_less_of_their_life():
    for ttl, stage in ((64, TraceStage.UNSEEN), (62, TraceStage.CIRCLE)):
        seen = cross("request", ROUTE)
        seen["two"] = []
        hosts = {**CHART.hosts, "02:00:00:00:00:05": frozenset(["other"])}
        seen["gate"][-1] = replace(seen["gate"][-1], target_mac="02:00:00:00:00:05")
        seen["other"] = [
            capture(False, "request", "02:00:00:00:00:05"),
            capture(True, "request", MACS["gate"], ttl=ttl),
        ]
        if ttl < 64:
            seen["gate"].append(capture(False, "request", MACS["gate"], ttl=ttl))
        found = find(seen, listening=(*ROUTE, "other"), chart=replace(CHART, hosts=hosts))
        assert found.stage == stage and found.at == {TraceStage.CIRCLE: "gate"}.get(stage, "other")


def test_what_one_of_two_alone_says_names_both():
    seen = join(cross("request", ROUTE, CALL), cross("answer", ROUTE[::-1], CALL))
    mute = find(seen, CALL, SentProbe(3, Outcome.OPEN, source_port=4000, data=Outcome.NO_ANSWER))
    assert (mute.stage, suspects.name_place(mute, "x").places) == (TraceStage.MUTE, ("one", "two"))
    strange = {"one": [capture(True, "request", "02:00:00:00:00:99")], "gate": [], "two": []}
    assert suspects.name_place(find(strange), "x").places == ("gate", "one")  # the one that it has, maybe
