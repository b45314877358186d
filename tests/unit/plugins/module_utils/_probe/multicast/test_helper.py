# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Helpers of multicast_verify on a simulated network: what they count, and what is said about it."""

import random

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast import helper as m
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast.messages import ASK, Message, encode
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast.multicast import wrong
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast.multicast_report import explain
from hypothesis import given, settings
from hypothesis import strategies as st
from mentioned import mentions


def test_times_of_the_quickest_round_trip():
    assert m.times([]) == {"rtt_ms": None, "clock_offset_s": None}
    found = m.times([(0.2, 3600.09), (0.001, 3600.0), (0.003, 3599.9)])
    assert found == {"rtt_ms": {"min": 1, "median": 3, "max": 200}, "clock_offset_s": 3600}


# Helpers on a simulated network


class Air:
    """Carries the datagrams of helpers that are stepped in simulated time. passes(sender, receiver, group?) -> bool."""

    def __init__(self, count, passes=lambda sender, receiver, group: True, clocks=(), delay=0.01, **options):
        self.addresses = [f"10.0.0.{number}" for number in range(1, count + 1)]
        self.passes, self.delay = passes, delay
        self.clocks = list(clocks) + [0] * (count - len(clocks))
        computers = {address: f"c{number}" for number, address in enumerate(self.addresses)}
        apart = frozenset(self.addresses[number] for number in options.get("apart", ()))
        self.helpers = [
            m.Helper(
                m.HelperSettings("run", "226.0.0.0", 11511, "eth0", address, (address,), computers, 100, apart), 0.0
            )
            for address in self.addresses
        ]
        self.translated = options.get("translated", {})
        self.flying, self.sent, self.now = [], [], 0.0
        self.ended = [False] * count

    def send(self, number, datagrams):
        for payload, (address, port) in datagrams:
            self.sent.append((self.now, number, payload, address))
            group = address == "226.0.0.0"
            for other, own in enumerate(self.addresses):
                target = group or address == own or self.translated.get(other) == address
                if target and other != number and self.passes(number, other, group):
                    source = (self.translated.get(number, self.addresses[number]), 40000 + number)
                    self.flying.append((self.now + self.delay, other, source, address, port, payload))

    def step(self):
        landed = [item for item in self.flying if item[0] <= self.now]
        self.flying = [item for item in self.flying if item[0] > self.now]
        for unused, number, source, address, port, payload in landed:
            helper = self.helpers[number]
            if self.ended[number]:
                continue
            if port == 11511:
                destination = address if address == "226.0.0.0" else self.addresses[number]
                self.send(number, helper.datagram(self.now, source, destination, "eth0", len(payload)))
            else:
                self.send(number, helper.message(self.now, self.now + self.clocks[number], source, payload))
        for number, helper in enumerate(self.helpers):
            self.ended[number] = self.ended[number] or helper.is_over(self.now)
            if not self.ended[number]:
                self.send(number, helper.poll(self.now, self.now + self.clocks[number]))
        self.now += 0.005

    def run(self, seconds):
        end = self.now + seconds
        while self.now < end:
            self.step()

    def measure(self, numbers, rounds=10, unicast=True):
        for number in numbers:
            self.helpers[number].measure(self.now, rounds, 0.1, unicast)
        while any(self.helpers[number].rounds for number in numbers):
            self.step()
        return [self.helpers[number].result() for number in numbers]


@settings(max_examples=20, deadline=None)
@given(st.integers(2, 5), st.integers(1, 5), st.floats(0.005, 0.04))
def test_any_number_of_forks_gives_the_whole_matrix(count, forks, delay):
    air = Air(count, delay=delay)
    air.run(1)
    for first in range(0, count, forks):
        for result in air.measure(range(first, min(first + forks, count))):
            assert result["missing"] == result["unanswered"] == result["unexpected"] == []
            assert len(result["heard"]) == count - 1
            assert all(entry["loss"] == 0 for entry in result["udp"])
            assert all(entry["rtt_ms"]["min"] == pytest.approx(2000 * delay, abs=11) for entry in result["udp"])
    assert not all(air.ended)
    air.run(3)
    assert all(air.ended)


@pytest.mark.parametrize("forks", [1, 3])
def test_a_master_behind_a_gateway_is_measured_by_unicast_alone(forks):
    air = Air(3, passes=lambda sender, receiver, group: not group or 2 not in (sender, receiver), apart=[2])
    air.run(1)
    results = []
    for first in range(0, 3, forks):
        results += air.measure(range(first, min(first + forks, 3)))
        air.run(15)  # longer than the silence after which nobody is waited for
    for number, result in enumerate(results):
        assert result["missing"] == result["unanswered"] == []
        for entry in result["udp"]:
            together = 2 not in (number, int(entry["name"][1:]))
            assert entry["multicast"] == entry["heard_from"] == together
            assert entry["unicast"] and entry["own_source_address"] == air.addresses[number]
            assert (entry["loss"], entry["heard_by"]) == ((0, True) if together else (None, None))
    assert "by unicast" in explain(results[0], 11511)
    assert all(air.ended)


def test_a_master_behind_a_gateway_without_unicast_is_missing():
    air = Air(3, passes=lambda sender, receiver, group: 2 not in (sender, receiver), apart=[2])
    air.run(1)
    result = air.measure([0, 1, 2])[0]
    assert (result["missing"], result["unanswered"]) == (["c2"], [])
    assert explain(result, 11511).startswith("No answer came from c2")


def test_who_has_called_is_known_by_address():
    air = Air(2)
    for number in range(3):
        air.helpers[0].datagram(0.0, ("192.168.11.100", 40000), "10.0.0.1", "eth0", 0)
    air.helpers[0].datagram(0.0, ("192.168.11.101", 40000), "10.0.0.1", "eth0", 24)  # a heartbeat
    assert air.helpers[0].result()["callers"] == [{"address": "192.168.11.100", "datagrams": 3}]
    for number in range(2 * m.SOURCES):
        air.helpers[0].datagram(0.0, (f"10.1.{number // 256}.{number % 256}", 1), "10.0.0.1", "eth0", 0)
    assert len(air.helpers[0].callers) == m.SOURCES


@pytest.mark.parametrize(
    "sources",
    [
        [("10.1.0.1", port) for port in range(1, 3 * m.SOURCES)],
        [(f"10.{number >> 8}.{number & 255}.1", 1) for number in range(256, 256 + 3 * m.SOURCES)],
        [("10.0.0.3", port) for port in range(1, 3 * m.SOURCES)],  # in the name of a member
        [("10.0.0.2", port) for port in range(1, 3 * m.SOURCES)],  # in the name of the one that is to be heard
    ],
    ids=["ports", "addresses", "member", "same"],
)
def test_no_flood_takes_the_place_of_a_member(sources):
    air = Air(3)
    first = air.helpers[0]
    for destination in ("226.0.0.0", "10.0.0.1"):
        for source in sources:
            first.datagram(0.0, source, destination, "eth0", 0)
    air.run(2)
    result, other, _third = air.measure([0, 1, 2])
    assert result["missing"] == result["unanswered"] == [] and result["heard"] == ["c1", "c2"]
    assert result["udp"][0]["heard"] >= 10
    entry = other["udp"][0]  # c0 as c1 sees it: c0 has told what it heard
    assert entry["heard_by"] and entry["unicast"] and entry["loss"] == 0
    assert all(len(counts) <= m.SOURCES + 6 for counts in (first.heard, first.heard_unicast, first.callers))


def test_offset_of_clocks_an_hour_apart():
    air = Air(3, clocks=[0, 3600, -3600])
    air.run(1)
    (result,) = air.measure([0])
    assert [entry["clock_offset_s"] for entry in result["udp"]] == pytest.approx([3600, -3600], abs=0.01)


@pytest.mark.parametrize("time", [float("nan"), float("inf"), 1.7e308, 1e20, -1e20])
def test_a_clock_that_shows_no_number_costs_its_offset_alone(time):
    """An answer with such a number would be refused as a whole."""
    air = Air(3, clocks=[0, time])
    air.run(1)
    (result,) = air.measure([0])
    liar, other = result["udp"]
    assert result["missing"] == [] and liar["heard_by"] and other["clock_offset_s"] == pytest.approx(0, abs=0.01)
    assert liar["clock_offset_s"] is None or abs(liar["clock_offset_s"]) <= 1 << 32


def test_a_lost_direction_is_found_on_both_sides():
    air = Air(3, passes=lambda sender, receiver, group: (sender, receiver, group) != (0, 1, True))
    air.run(1)
    first, second, third = air.measure([0, 1, 2])
    assert first["missing"] == ["c1"] and first["udp"][0]["heard_by"] is False and first["udp"][0]["loss"] == 1
    assert second["missing"] == ["c0"] and second["heard"] == ["c2"]
    assert third["missing"] == []
    assert "Do not hear this computer on the group: c1." in explain(first, 11511)
    assert "Unicast datagrams reach c1" in explain(first, 11511)


def test_loss_is_measured_where_it_happens():
    luck = random.Random(1)
    air = Air(2, passes=lambda sender, receiver, group: not (group and sender == 0) or luck.random() < 0.7)
    air.run(1)
    (result,) = air.measure([0], rounds=400)
    assert result["udp"][0]["loss"] == pytest.approx(0.3, abs=0.07)
    (result,) = air.measure([1], rounds=50)
    assert result["udp"][0]["loss"] == 0


def test_lost_counts_are_asked_for_again():
    luck = random.Random(2)
    air = Air(4, passes=lambda sender, receiver, group: group or luck.random() < 0.6)
    air.run(3)
    for result in air.measure(range(4)):
        assert result["missing"] == result["unanswered"] == []
        assert all(entry["loss"] in (0, None) for entry in result["udp"])


def test_without_any_answer_nothing_is_claimed():
    air = Air(2, passes=lambda sender, receiver, group: group)
    air.run(1)
    (result,) = air.measure([0])
    assert result["heard"] == ["c1"] and result["missing"] == [] and result["unanswered"] == ["c1"]
    assert result["udp"][0]["loss"] is result["udp"][0]["heard_by"] is result["udp"][0]["unicast"] is None
    assert "their own result shows it" in explain(result, 11511)


def test_a_dead_computer_is_named_and_not_waited_for():
    air = Air(3)
    air.ended[2] = True
    air.run(1)
    first, second = air.measure([0, 1])
    assert first["missing"] == second["missing"] == ["c2"]
    assert "No answer came from c2" in explain(first, 11511) and "11511" in explain(first, 11511)
    air.run(3)
    assert all(air.ended)


def test_a_helper_that_dies_later_is_waited_for_only_a_while():
    air = Air(2)
    air.run(1)
    air.ended[1] = True
    air.measure([0])
    air.run(3)
    assert not air.ended[0]
    air.run(8)
    assert air.ended[0]


def test_address_translation_is_seen():
    air = Air(2, translated={0: "10.9.9.9"})
    air.run(1)
    first, second = air.measure([0, 1])
    assert first["udp"][0]["own_source_address"] == "10.9.9.9" and first["missing"] == []
    assert second["udp"][0]["source_address"] == "10.9.9.9" and second["udp"][0]["heard_from"]
    assert second["unexpected"] == []


def helper():
    computers = {"10.0.0.1": "own", "10.0.0.2": "other"}
    return m.Helper(m.HelperSettings("run", "226.0.0.0", 11511, "eth0", "10.0.0.1", ("10.0.0.1",), computers, 100), 0.0)


def test_strangers_are_counted_and_never_answered():
    one = helper()
    for port in range(10000):
        assert one.datagram(0, ("10.0.0.66", port), "226.0.0.0", "eth0", 0) == []
        assert one.message(0, 0, ("10.0.0.66", port), b"x" * 60) == []
    # All are told, and they are one source: their ports fill no places.
    assert one.result()["unexpected"] == [{"address": "10.0.0.66", "interface": "eth0", "datagrams": 10000}]
    assert len(one.heard) == 1
    assert one.result()["heard"] == []


def test_answers_and_introductions_are_bounded():
    one = helper()
    ask = encode(Message(ASK, False, "10.0.0.2", 1), "run")
    answers = [one.message(0, 0, ("10.0.0.2", 5000), ask) for unused in range(1000)]
    assert sum(map(len, answers)) == 2 * m.ANSWERS
    assert one.message(1, 0, ("10.0.0.2", 5000), ask)
    told = [one.datagram(0, ("10.0.0.2", port), "226.0.0.0", "eth0", 0) for port in range(1000)]
    assert sum(map(len, told)) == m.PORTS
    assert [len(payload) for payload, unused in one.datagram(0, ("10.0.0.2", 1), "226.0.0.0", "eth0", 24)] == []


def test_forged_ports_do_not_use_up_the_introductions():
    one = helper()
    for port in range(m.PORTS):
        one.datagram(0, ("10.0.0.2", port), "226.0.0.0", "eth0", 0)
    member = "10.0.0.2", 40001
    assert one.datagram(0, member, "226.0.0.0", "eth0", 0) == []
    for now in range(m.TIMES):
        one.poll(now, 0)
    ((_payload, told),) = one.datagram(m.TIMES, member, "226.0.0.0", "eth0", 0)
    assert (told, one.datagram(m.TIMES, member, "226.0.0.0", "eth0", 0)) == (member, [])
    again = [one.datagram(m.TIMES, ("10.0.0.2", port), "226.0.0.0", "eth0", 0) for port in range(1000)]
    assert sum(map(len, again)) == m.PORTS - 1, "it keeps its place until it was told all times"


def test_forged_ports_do_not_keep_a_helper_alive():
    air = Air(3)
    air.run(1)
    air.measure(range(3))
    chance = random.Random(3)
    for _step in range(600):
        air.step()
        source = "10.0.0.2", chance.randrange(1024, 1 << 16)
        air.send(0, air.helpers[0].datagram(air.now, source, "226.0.0.0", "eth0", 0))
    assert all(air.ended)


def test_heartbeats_of_a_discovery_node_are_no_probes():
    one = helper()
    one.datagram(0, ("10.0.0.2", 11511), "226.0.0.0", "eth0", 24)
    one.datagram(0, ("10.0.0.77", 11511), "226.0.0.0", "eth0", 24)
    one.datagram(0, ("10.0.0.1", 11511), "226.0.0.0", "eth0", 24)
    result = one.result()
    assert result["heard"] == []
    assert [item["address"] for item in result["unexpected"]] == ["10.0.0.77"]


def test_another_interface_than_the_planned_one_is_named():
    one = helper()
    one.datagram(0, ("10.0.0.2", 5000), "226.0.0.0", "wlan0", 0)
    result = one.result()
    assert result["missing"] == ["other"] and result["udp"][0]["other_interfaces"] == ["wlan0"]
    assert "other (wlan0)" in explain(result, 11511)


def test_probes_are_empty_and_slow_while_nobody_measures():
    air = Air(2)
    air.run(10)
    group = [payload for unused, number, payload, address in air.sent if address == "226.0.0.0" and number == 0]
    assert set(group) == {b""} and len(group) == pytest.approx(20, abs=1)
    unicast = [payload for unused, number, payload, address in air.sent if address != "226.0.0.0"]
    assert len(unicast) == 2 * m.TIMES


def test_lifetime_ends_a_helper_between_measurements():
    one = helper()
    assert not one.is_over(99) and one.is_over(100)
    one.measure(99, 1, 0.1, False)
    assert not one.is_over(100)


# The module's options

GOOD = {
    "action": "start",
    "run": "default",
    "group": "226.0.0.0",
    "icmp_group": "224.0.0.1",
    "port": 11511,
    "rounds": 10,
    "interval": 0.2,
    "lifetime": 120,
    "interface_address": "10.0.0.1",
    "name": "own",
    "computers": [{"name": "own", "address": "10.0.0.1"}, {"name": "other", "address": "10.0.0.2"}],
}


def test_good_options_are_good():
    assert wrong(GOOD) is None
    assert wrong({**GOOD, "action": "list", "name": None, "interface_address": None, "computers": None}) is None


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("run", "a/b", "run is 'a/b'"),
        ("group", "192.168.1.1", "group is '192.168.1.1'"),
        ("group", "ff02::1", "group is 'ff02::1'"),
        ("icmp_group", "all", "icmp_group is 'all'"),
        ("port", 0, "0 1 65535"),
        ("rounds", 0, "rounds is 0"),
        ("interval", 0.001, "interval is 0.001"),
        ("interval", 100.0, "interval is 100.0"),
        ("rounds", 1000, "1000 0.2"),
        ("lifetime", 4000, "lifetime is 4000"),
        ("interface_address", "eth0", "interface_address is 'eth0'"),
        (
            "interface_address",
            "10.0.0.9",
            "interface_address 10.0.0.9 own 10.0.0.1",
        ),
        ("name", "nobody", "name is 'nobody'"),
        ("computers", [{"name": "a", "address": "x"}], "x address"),
        ("computers", [{"name": "a", "address": "10.0.0.1"}] * 2, "twice name"),
        (
            "computers",
            [{"name": "a", "address": "10.0.0.1"}, {"name": "b", "address": "10.0.0.1"}],
            "10.0.0.1 address",
        ),
    ],
)
def test_wrong_options_are_named_in_one_sentence(option, value, said):
    sentence = wrong({**GOOD, option: value})
    assert mentions(sentence, *said.split()) and sentence.endswith(".") and "expected" in sentence or ";" in sentence
