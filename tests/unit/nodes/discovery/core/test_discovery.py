# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import random

import pytest
from fleet_of_one import TIBI, URI
from mentioned import mentions
from rosfleet_multimaster.discovery.core.actions import NEWCOMER_LIMIT, Ask, MasterEvent, Say, Send
from rosfleet_multimaster.discovery.core.announcements import MAX_ANSWERED
from rosfleet_multimaster.discovery.core.discovery import Discovery
from rosfleet_multimaster.discovery.core.newcomers import MAX_ASKED, MAX_NEWCOMERS
from rosfleet_multimaster.discovery.core.peer import Contact, Peer, find_name_problem
from rosfleet_multimaster.discovery.core.peers import MAX_PER_ADDRESS, RETURNED, Peers
from rosfleet_multimaster.protocol.heartbeat import Heartbeat, Kind, Stamp, decode, encode
from rosfleet_multimaster.protocol.members import Members
from rosfleet_multimaster.protocol.messages import AnnouncedMaster
from rosfleet_multimaster.protocol.parameters import Settings
from virtual_time import Robot, World

OWN = AnnouncedMaster(
    "kobuki1computer",
    "http://kobuki1computer:11311/",
    "http://192.168.1.229:11611",
    "/master_discovery",
    1000.0,
    1000.0,
    True,
)
PEER = ("192.168.1.239", 11511)
KEY = (*PEER, 11611)
CONTACT = Contact(2000.0, "http://kobuki2computer:11311/", "kobuki2computer", "/master_discovery")
REFUSED = "Connection refused"
TIMED_OUT = "timed out"


def node(**settings):
    return Discovery(Settings(**settings), ["127.0.0.1", "192.168.1.229"], 11611)


def take(core, kind=None):
    found = list(core.actions)
    core.actions.clear()
    return [action for action in found if kind is None or isinstance(action, kind)]


def sent(core):
    return [(decode(action.datagram).kind, action.host) for action in take(core, Send)]


def state(stamp=2000, rate=0.0, local=None):
    return encode(Heartbeat(Kind.STATE, 11611, rate, Stamp(stamp), Stamp(stamp if local is None else local)))


def request():
    return encode(Heartbeat(Kind.REQUEST, 11611))


def leave():
    return encode(Heartbeat(Kind.LEAVE, 11611))


def started(**settings):
    core = node(**settings)
    core.take_own_state(OWN, 0.0)
    for now in (0.2, 1.0, 5.0, 10.0):
        core.tick(now)
    take(core)
    return core


def met(**settings):
    """A core that knows one other master, heard last at 10 s."""
    core = started(**settings)
    core.datagram(state(), PEER, True, 10.0)
    core.take_contact(KEY, CONTACT, "", 10.0)
    take(core)
    return core


def changes(core):
    return [(event.change, event.master.name, event.master.online) for event in take(core, MasterEvent)]


def wait(core, begin, end):
    """Tick as the program does; what is to be done."""
    actions, now = [], begin
    while now <= end:
        core.tick(now)
        actions += take(core)
        now += 0.25
    return actions


def run(core, begin, end, step=0.25):
    """Tick as the program does; the (time, kind, host) of what was sent, and the (time, change)s."""
    out, events, now = [], [], begin
    while now <= end:
        core.tick(now)
        for action in take(core):
            if isinstance(action, Send):
                out.append((now, decode(action.datagram).kind, action.host))
            elif isinstance(action, MasterEvent):
                events.append((now, action.change, action.master.online))
            elif isinstance(action, Ask):
                core.take_contact(action.key, None, REFUSED, now)
        now += step
    return out, events


# What is sent


def test_nothing_is_sent_before_the_first_state():
    core = node(robot_hosts=["peer"])
    core.tick(100.0)
    core.datagram(request(), PEER, True, 101.0)
    assert sent(core) == []


def test_state_and_requests_at_the_start_to_group_and_hosts():
    core = node(robot_hosts=["peer"])
    core.take_own_state(OWN, 0.0)
    both = [(Kind.STATE, None), (Kind.STATE, "peer"), (Kind.REQUEST, None), (Kind.REQUEST, "peer")]
    assert sent(core) == both


def test_a_change_is_announced_at_once_and_twice_again():
    core = started(heartbeat_hz=0.02)
    core.take_own_state(OWN._replace(stamp=1001.0), 20.0)
    out, _events = run(core, 20.0, 22.0, 0.1)
    assert [round(now, 1) for now, kind, host in out if kind is Kind.STATE] == [20.0, 20.2, 21.0]


@pytest.mark.parametrize(("rate", "local", "beats"), [(1.0, 1000.0, 2), (0.5, 1000.0, 3), (1.0, 1001.0, 3)])
def test_others_changes_travel_with_the_next_heartbeat(rate, local, beats):
    core = started(heartbeat_hz=rate)
    run(core, 0.25, 20.25)
    core.take_own_state(OWN._replace(stamp=1001.0, local_stamp=local), 20.4)
    out, _events = run(core, 20.4, 22.2, 0.1)
    told = [now for now, kind, _host in out if kind is Kind.STATE]
    assert len(told) == beats


def test_a_copy_of_a_heartbeat_is_a_sign_of_life_alone():
    core = met()
    core.datagram(state(2001, rate=1.0), PEER, True, 11.0)
    core.tick(11.0)
    core.actions.clear()
    core.datagram(state(2001, rate=1.0), PEER, False, 11.01)
    entry = core.peers.table[next(iter(core.peers.table))]
    assert entry.heard == 11.01 and list(entry.beats)[-2:] == [11.0, 11.01]
    assert not core.peers.stale and not core.actions


def test_another_beat_is_no_copy_whoever_sends_it():
    core = met()
    core.datagram(state(2001), PEER, True, 11.0)
    core.datagram(state(2002), PEER, True, 11.01)
    core.datagram(state(2001), ("10.0.0.9", 11511), True, 11.02)
    core.tick(11.02)
    assert [master.stamp for master in core.view.masters()][1] == 2002 and core.newcomers.table


def test_the_announced_stamps_are_those_of_the_state():
    core = node()
    core.take_own_state(OWN._replace(stamp=1700000000.123456, local_stamp=1700000000.0), 0.0)
    record = decode(take(core, Send)[0].datagram)
    assert record.stamp.seconds == 1700000000.123456
    assert record.local_stamp.seconds == 1700000000.0
    assert record.rpc_port == 11611


def test_heartbeats_at_their_rate():
    core = started(heartbeat_hz=0.5)
    out, _events = run(core, 10.25, 20.0)
    assert sum(kind is Kind.STATE for _now, kind, _host in out) == 5


@pytest.mark.parametrize(
    ("settings", "multicast", "to"),
    [({}, True, [None, PEER[0]]), ({}, False, [PEER[0]]), ({"send_mcast": False}, True, [PEER[0]])],
)
def test_a_request_is_answered(settings, multicast, to):
    core = started(**settings)
    core.datagram(request(), PEER, multicast, 10.0)
    assert [host for kind, host in sent(core) if kind is Kind.STATE] == to


def test_a_flood_of_requests_is_not_answered_by_a_flood():
    core = started()
    for count in range(1000):
        core.datagram(request(), PEER, True, 10.0 + count / 10000)
    assert len(sent(core)) == 2


def test_requests_of_too_many_addresses_are_logged_not_answered():
    core = started()
    for number in range(MAX_ANSWERED + 10):
        core.datagram(request(), (f"10.0.{number // 250}.{number % 250}", 11511), False, 10.0)
    said = take(core)
    assert sum(isinstance(action, Send) for action in said) == MAX_ANSWERED
    assert {action.topic for action in said if isinstance(action, Say) and "not answered" in action.text} == {
        "requests"
    }
    core.tick(12.0)
    take(core)
    core.datagram(request(), PEER, False, 12.0)
    assert (Kind.STATE, PEER[0]) in sent(core), "a second later there is room again"


def test_without_multicast_the_known_masters_are_told():
    core = met(send_mcast=False, listen_mcast=False, robot_hosts=["third"])
    core.take_own_state(OWN._replace(stamp=1001.0), 20.0)
    assert sent(core) == [(Kind.STATE, "third"), (Kind.STATE, PEER[0])]


def test_leave_and_refresh():
    core = met(robot_hosts=["third"])
    core.refresh(20.0)
    assert sent(core) == [(Kind.REQUEST, PEER[0]), (Kind.REQUEST, None), (Kind.REQUEST, "third")]
    core.announcements.leave()
    assert sent(core) == [(Kind.LEAVE, None), (Kind.LEAVE, "third")]


# Who is there


def test_the_own_master_is_listed_first():
    core = met()
    for datagram in (state(5), request(), leave()):
        core.datagram(datagram, ("192.168.1.229", 11511), True, 11.0)
    assert take(core) == []
    assert [(master.name, master.monitor_uri) for master in core.view.masters()] == [
        ("kobuki1computer", "http://192.168.1.229:11611"),
        ("kobuki2computer", "http://192.168.1.239:11611"),
    ]


def test_a_new_master_is_asked_who_it_is():
    core = started()
    core.datagram(state(), PEER, True, 10.0)
    assert take(core) == [Ask(KEY, "http://192.168.1.239:11611", NEWCOMER_LIMIT, True)]
    core.take_contact(KEY, CONTACT, "", 10.1)
    assert changes(core) == [("new", "kobuki2computer", True)]


def test_a_node_without_an_answer_or_a_state_is_asked_again():
    core = started()
    core.datagram(state(), PEER, True, 10.0)
    take(core)
    core.take_contact(KEY, CONTACT._replace(stamp=0.0), "", 10.0)
    core.tick(10.9)
    assert take(core, Ask) == []
    core.tick(11.0)
    assert len(take(core, Ask)) == 1
    core.take_contact(KEY, None, REFUSED, 11.0)
    core.tick(15.9)
    assert take(core, Ask) == []
    core.tick(16.0)
    assert len(take(core, Ask)) == 1


def test_a_change_is_an_event_and_a_repetition_is_none():
    core = met()
    core.datagram(state(2001), PEER, True, 11.0)
    core.tick(11.0)
    assert changes(core) == [("changed", "kobuki2computer", True)]
    core.datagram(state(2001), PEER, True, 11.2)
    core.tick(11.2)
    assert changes(core) == []


def test_what_many_datagrams_change_is_told_once():
    core = met()
    for stamp in (2001, 2002, 2003):
        core.datagram(state(stamp), PEER, True, 11.0)
    core.tick(11.0)
    assert changes(core) == [("changed", "kobuki2computer", True)]
    assert [master.stamp for master in core.view.masters()][1] == 2003


def test_empty_datagrams_are_ignored_and_malformed_ones_counted():
    core = met()
    core.datagram(b"", PEER, True, 11.0)
    assert take(core) == [] and core.malformed == 0
    for data in (b"x", b"R\x01" + bytes(22), b"R\x02short"):
        core.datagram(data, PEER, True, 11.0)
    assert core.malformed == 3
    assert {type(action) for action in take(core)} == {Say}
    assert len(core.view.masters()) == 2


def test_two_addresses_of_one_master_are_one_master():
    core = met()
    second = ("10.0.0.2", 11511)
    core.datagram(state(), second, True, 11.0)
    core.take_contact((*second, 11611), CONTACT, "", 11.0)
    assert changes(core) == []
    core.datagram(leave(), PEER, True, 12.0)
    core.tick(12.2)
    core.take_contact(KEY, None, REFUSED, 12.2, gone=True)
    assert [(event.change, event.master.monitor_uri) for event in take(core, MasterEvent)] == [
        ("changed", "http://10.0.0.2:11611")
    ]


def test_a_gateway_may_have_its_name_in_the_network_of_its_robot():
    """It is heard from its address in the common network; whether its name leads to it shows who answers there."""
    heard, named = "192.168.1.239", "192.168.11.101"
    assert find_name_problem(CONTACT, heard, heard, None) == ""
    assert find_name_problem(CONTACT, heard, named, CONTACT._replace(stamp=2001.0)) == ""
    for there in (None, CONTACT._replace(uri="http://other:11311/")):
        problem = find_name_problem(CONTACT, heard, named, there)
        assert f"kobuki2computer resolves to {named}" in problem and f"heard from {heard}" in problem
    assert "kobuki2computer has no address" in find_name_problem(CONTACT, heard, "", None)


def test_one_name_or_one_uri_for_two_masters_is_reported():
    core = met()
    for address, contact in (
        ("10.0.0.3", CONTACT._replace(uri="http://other:11311/")),
        ("10.0.0.4", CONTACT._replace(uri=OWN.uri)),
    ):
        core.datagram(state(), (address, 11511), True, 11.0)
        core.take_contact((address, 11511, 11611), contact, "", 11.0)
    texts = [action.text for action in take(core, Say)]
    assert any("two masters are called kobuki2computer" in text for text in texts)
    assert any("ROS_HOSTNAME" in text for text in texts)
    assert core.view.masters()[0] == OWN


def heard_from_two_addresses(answers):
    """The events about a master whose first address falls silent; `answers`: a program answers there over TCP."""
    core = started()
    second = ("10.0.0.2", 11511)
    for source in (PEER, second):
        core.datagram(state(rate=1.0), source, True, 10.0)
        core.take_contact((*source, 11611), CONTACT, "", 10.0)
    take(core)
    shown, asked = [], []
    for tenth in range(1, 100):
        now = 10.0 + tenth / 10
        core.tick(now)
        if tenth % 10 == 0:
            core.datagram(state(rate=1.0), second, True, now)
        asked += [(now + (0.01 if answers else action.limit), action.key) for action in take(core, Ask)]
        for due, key in [one for one in asked if one[0] <= now]:
            asked.remove((due, key))
            lives = answers or key[0] == second[0]
            core.take_contact(key, CONTACT if lives else None, "timed out", now)
        for event in take(core, MasterEvent):
            shown.append((now, event.change, event.master.monitor_uri, event.master.online))
    return shown


def test_a_master_heard_at_two_addresses_is_shown_where_it_lives():
    shown = heard_from_two_addresses(answers=False)
    assert [line[1:] for line in shown] == [("changed", "http://10.0.0.2:11611", True)], "once, and it stays there"
    assert 12.0 < shown[0][0] < 15.5, "when nobody answers at the first one"


def test_a_master_stays_where_it_is_while_it_answers_there():
    """Whoever answers with the URI of another robot that is silent for a moment does not become it."""
    assert heard_from_two_addresses(answers=True) == []


def test_whoever_answers_with_the_uri_of_another_robot_is_named():
    core = started()
    second = ("10.0.0.2", 11511)
    for source in (PEER, second):
        core.datagram(state(rate=1.0), source, True, 10.0)
        core.take_contact((*source, 11611), CONTACT, "", 10.0)
    (said,) = [action.text for action in take(core, Say) if "10.0.0.2" in action.text]
    assert mentions(said, "192.168.1.239", "10.0.0.2")


def test_an_own_address_that_is_new_is_not_another_master():
    core = started()
    new = ("10.5.5.5", 11511)
    core.datagram(state(), new, True, 11.0)
    core.take_addresses(["127.0.0.1", "192.168.1.229", new[0]])
    core.take_contact((*new, 11611), CONTACT._replace(uri=OWN.uri), "", 11.1)
    core.datagram(state(), new, True, 12.0)
    assert take(core, Say) == [] and [master.uri for master in core.view.masters()] == [OWN.uri]


# Floods


def flooded(core, seconds, senders, meet, begin=20.0):
    """A flood whose senders do not exist: asking them takes its whole time limit. When `meet` was identified, or None."""
    running, met = [], None
    for step in range(int(seconds * 100)):
        now = begin + step / 100
        for sender in senders(step):
            core.datagram(state(rate=1.0), sender, True, now)
        if step in (100, 120, 200, 300, 400, 500):  # it starts a second later, and says its state and a request
            core.datagram(state(rate=1.0), meet, True, now)
            core.datagram(request(), meet, True, now)
        for action in take(core, Ask):
            running.append((now + (0.01 if action.key[0] == meet[0] else action.limit), action.key))
        for due, key in [one for one in running if one[0] <= now]:
            running.remove((due, key))
            real = key == (*meet, 11611)
            core.take_contact(key, CONTACT if real else None, "" if real else TIMED_OUT, now)
            met = now - begin - 1.0 if real and met is None else met
        core.tick(now)
        assert len(running) <= MAX_ASKED
        if met is not None:
            return met
    return met


def every_time_others(chance):
    return lambda step: [
        (f"10.{chance.randrange(256)}.{chance.randrange(256)}.7", chance.randrange(1, 65536)) for _sender in "12345"
    ]


FLOODS = {
    "ever other addresses": lambda: every_time_others(random.Random(1)),
    "one address with ever other ports": lambda: (
        lambda step: [("10.0.0.9", 1 + (step * 5 + part) % 65535) for part in range(5)]
    ),
    "a hundred addresses again and again": lambda: (
        lambda step: [(f"10.0.1.{(step * 5 + part) % 100}", 11511) for part in range(5)]
    ),
}


@pytest.mark.parametrize("flood", FLOODS)
def test_a_flood_does_not_hide_a_new_master(flood):
    core = started(heartbeat_hz=1.0)
    met = flooded(core, 8.0, FLOODS[flood](), PEER)
    assert met is not None and met < 6.0
    assert len(core.newcomers.table) <= MAX_NEWCOMERS


def test_a_flood_does_not_keep_a_known_master_waiting():
    core = met(heartbeat_hz=1.0)
    core.datagram(state(rate=1.0), PEER, True, 10.0)
    senders = every_time_others(random.Random(2))
    for step in range(1, 460):
        now = 10.0 + step / 100
        for sender in senders(step):
            core.datagram(state(), sender, True, now)
        core.tick(now)
    asked = [(action.key, action.newcomer) for action in take(core, Ask)]
    assert (KEY, False) in asked and sum(newcomer for _key, newcomer in asked) == MAX_ASKED


def test_newcomers_are_forgotten():
    core = started()
    for count in range(3000):
        core.datagram(state(), (f"10.0.{count // 250}.{count % 250}", 11511), True, 10.0)
    told = [action for action in take(core, Say) if action.topic == "full"]
    assert len(told) == 3000 - MAX_NEWCOMERS == 3000 - len(core.newcomers.table)
    run(core, 11.0, 45.0, 1.0)
    assert not core.newcomers.table


def test_one_address_has_few_masters_and_the_live_one_stays():
    core = met()
    for port in range(20000, 20100):  # false ports; who is asked answers truly
        now = 11.0 + port / 1000
        core.datagram(state(), PEER, True, now)
        core.datagram(state(), (PEER[0], port), True, now)
        for action in take(core, Ask):
            core.take_contact(action.key, CONTACT, "", now)
    assert len(core.peers.table) == MAX_PER_ADDRESS and KEY in core.peers.table


# Who is gone


def test_leave_of_a_master_that_no_longer_answers():
    core = met()
    core.datagram(leave(), PEER, True, 11.0)
    core.tick(11.1)
    assert take(core, Ask) == []
    core.tick(11.2)
    assert len(take(core, Ask)) == 1
    core.take_contact(KEY, None, REFUSED, 11.2, gone=True)
    assert changes(core) == [("removed", "kobuki2computer", False)]
    assert [master.name for master in core.view.masters()] == ["kobuki1computer"]


def test_leave_of_a_computer_that_is_off():
    core, now = met(), 11.0
    core.datagram(leave(), PEER, True, now)
    while core.view.masters()[1:]:
        now = core.next_tick()
        core.tick(now)
        for action in take(core, Ask):
            now += action.limit
            core.take_contact(action.key, None, TIMED_OUT, now)
    assert now < 11.0 + 4.5


@pytest.mark.parametrize("answers", ["always", "not in time, every second time"])
def test_leaves_with_the_true_address_for_minutes_remove_nobody(answers):
    core = met()
    core.datagram(state(rate=1.0), PEER, True, 10.0)
    asked, now = 0, 10.0
    for tenth in range(1800):
        now = 10.1 + tenth / 10
        core.datagram(leave(), PEER, True, now)
        core.datagram(leave(), ("10.9.9.9", 11511), True, now)
        if tenth % 10 == 9:
            core.datagram(state(rate=1.0), PEER, True, now)
        core.tick(now)
        for action in take(core, Ask):
            asked += 1
            late = answers != "always" and asked % 2
            core.take_contact(action.key, None if late else CONTACT, TIMED_OUT if late else "", now)
        assert not [event for event in take(core, MasterEvent) if event.change == "removed" or not event.master.online]
    assert asked <= 2 * 180, "and not every LEAVE is a connection"
    out, events = run(core, now, now + 10.0)
    assert [online for _now, _change, online in events] == [False], "who is silent after that is missed as ever"


@pytest.mark.parametrize("rate", [0.0, 0.5, 25.5])
def test_heartbeats_with_another_rate_have_no_lasting_effect(rate):
    core = met()
    core.datagram(state(rate=1.0), PEER, True, 10.0)
    for tenth in range(1200):
        now = 10.0 + tenth / 10
        core.datagram(state(rate=rate), PEER, True, now)
        if tenth % 10 == 5:
            core.datagram(state(rate=1.0), PEER, True, now)
        core.tick(now)
        assert take(core, MasterEvent) == []
    core.datagram(state(rate=1.0), PEER, True, now)
    _out, events = run(core, now, now + 10.0, 0.05)
    assert [online for _now, _change, online in events] == [False] and events[0][0] < now + 4.6


# Silence


def test_who_promised_a_beat_is_asked_and_then_offline():
    core = met()
    core.datagram(state(rate=1.0), PEER, True, 10.0)
    asked, requests, now = [], [], 10.0
    while core.view.masters()[1].online:
        now = core.next_tick()
        core.tick(now)
        for action in take(core):
            if isinstance(action, Ask):
                asked.append((now, action.limit, action.newcomer))
            elif isinstance(action, Send) and decode(action.datagram).kind is Kind.REQUEST:
                requests.append(now)
    assert asked == [(12.25, 2.25, False)]
    assert requests[0] == 11.5 and 13 <= len(requests) <= 16
    assert now == 14.5


def test_any_answer_is_a_sign_of_life():
    core = met()
    core.datagram(state(rate=1.0), PEER, True, 10.0)
    for now in (13.0, 16.0, 19.0):
        assert [type(action) for action in wait(core, now - 2.75, now) if not isinstance(action, Send)] == [Ask]
        core.take_contact(KEY, CONTACT, "", now)
    wait(core, 19.25, 22.0)
    core.datagram(request(), PEER, False, 22.0)
    _out, events = run(core, 22.0, 30.0, 0.05)
    assert [round(at, 1) for at, _change, _online in events] == [26.5]


def test_an_answer_brings_a_change_with_lost_datagrams():
    core = met()
    core.datagram(state(2000, rate=1.0), PEER, True, 10.0)
    wait(core, 10.25, 13.0)
    core.take_contact(KEY, CONTACT._replace(stamp=2005.5), "", 13.1)
    assert [event.master.stamp for event in take(core, MasterEvent)] == [2005.5]
    assert [type(action) for action in wait(core, 13.25, 16.0) if not isinstance(action, Send)] == [Ask]
    core.datagram(state(2009, rate=1.0), PEER, True, 16.1)
    core.take_contact(KEY, CONTACT._replace(stamp=2005.5), "", 16.2)
    assert [event.master.stamp for event in take(core, MasterEvent)] == [2009.0]


def seen(robot, other):
    """The events of a robot about another one: (time, change, online)."""
    return [(now, change, master.online) for now, change, master in robot.events if master.uri == other.uri]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_ten_minutes_at_30_per_cent_loss_remove_nobody(seed):
    chance = random.Random(f"loss {seed}")
    one, two = Robot("one", "10.0.0.1"), Robot("two", "10.0.0.2")
    World([one, two], seed, lambda now, source, target: chance.random() < 0.3).run(600.0)
    for robot, other in ((one, two), (two, one)):
        assert [event[1:] for event in seen(robot, other)] == [("new", True)]


@pytest.mark.parametrize("phase", range(0, 1000, 100))
def test_two_seconds_without_a_link_remove_nobody(phase):
    begin = 20.0 + phase / 1000
    one, two = Robot("one", "10.0.0.1"), Robot("two", "10.0.0.2")
    World([one, two], 1, lambda now, source, target: begin <= now < begin + 2.0).run(60.0)
    assert [event[1:] for event in seen(one, two) + seen(two, one)] == [("new", True)] * 2


@pytest.mark.parametrize("phase", range(0, 1000, 100))
def test_lost_power_is_known_before_five_seconds_are_over(phase):
    end = 20.0 + phase / 1000
    one, two = Robot("one", "10.0.0.1"), Robot("two", "10.0.0.2")
    world = World([one, two], 2)
    world.run(end)
    two.alive = False
    world.run(30.0)
    (_met, (now, change, online)) = seen(one, two)
    assert (change, online) == ("changed", False)
    assert 4.4 < now - one.last_heard[two.address] < 4.6 and now - end < 4.6


def test_a_link_that_is_back_is_used_at_once():
    for phase in range(0, 1000, 100):
        back = 90.0 + phase / 1000
        one, two = Robot("one", "10.0.0.1"), Robot("two", "10.0.0.2")
        World([one, two], 3, lambda now, source, target, back=back: 20.0 <= now < back).run(100.0)
        (_met, _lost, (now, _change, online)) = seen(one, two)
        assert online and now - back <= 1.1


def test_a_master_that_answers_over_tcp_alone_stays():
    """A firewall that began to drop the datagrams."""
    one, two = Robot("one", "10.0.0.1"), Robot("two", "10.0.0.2")
    world = World([one, two], 4)
    world.run(20.0)
    world.deliver = lambda *_arguments: None
    two.stamp = 2000.0
    world.run(60.0)
    assert [event[1:] for event in seen(one, two)] == [("new", True), ("changed", True)]
    assert one.core.view.masters()[1].stamp == 2000.0


def test_silence_is_offline_after_65_s_and_removed_after_300_s():
    core = met()
    out, events = run(core, 10.0, 320.0)
    requests = [now for now, kind, host in out if kind is Kind.REQUEST and host == PEER[0]]
    assert requests[0] >= 70.0 and requests[4] < 76.0
    assert [change for _now, change, _online in events] == ["changed", "removed"]
    assert 74.0 < events[0][0] < 77.0 and not events[0][2]
    assert 310.0 <= events[1][0] < 312.0


def test_back_online_is_a_change_and_it_is_asked_again_who_it_is():
    core = met()
    run(core, 10.0, 80.0)
    core.datagram(state(), PEER, True, 81.0)
    core.tick(core.next_tick())
    actions = take(core)
    assert [type(action) for action in actions] == [Ask, MasterEvent]
    assert actions[1].master.online


def test_a_robot_at_its_planned_place_is_asked_its_name_again():
    there, contact = (TIBI["addresses"][0], 11511), CONTACT._replace(uri=URI, name=TIBI["name"])
    core = Discovery(Settings(), ["192.168.1.229"], 11611, Members.from_parameters({"members": [TIBI]}))
    core.take_own_state(OWN, 0.0)
    core.datagram(state(rate=1.0), there, True, 1.0)
    core.take_contact((there[0], 0, 11611), contact, "", 1.0)
    run(core, 1.0, 10.0)
    asked, events = [], []
    for quarter in range(40, 70):
        now = quarter / 4
        if quarter % 4 == 0:
            core.datagram(state(rate=1.0), there, True, now)
        core.tick(now)
        for action in take(core):
            asked += [now] if isinstance(action, Ask) else []
            events += [(now, action.master.online)] if isinstance(action, MasterEvent) else []
    assert events == [(10.0, True)], "its topics are fetched at once"
    assert asked == [10.0 + RETURNED]


def test_removal_can_be_switched_off():
    core = met(remove_after=0.0)
    _out, events = run(core, 10.0, 1000.0, 1.0)
    assert [change for _now, change, _online in events] == ["changed"]


# The own roscore


def test_a_dead_roscore_is_not_announced_as_alive():
    core = met(heartbeat_hz=1.0)
    assert core.note_silent_roscore(10.5, 11.6)
    assert changes(core) == [("changed", "kobuki1computer", False)]
    core.datagram(request(), PEER, True, 11.7)
    out, _events = run(core, 11.75, 15.25)
    assert out == []
    assert core.note_silent_roscore(10.5, 15.5)
    out, _events = run(core, 15.5, 20.0)
    assert [kind for _now, kind, _host in out] + [kind for kind, _host in sent(core)] == [Kind.LEAVE] * 3
    core.take_own_state(OWN, 21.0)
    assert (Kind.STATE, None) in sent(core)


def test_a_roscore_that_fails_for_a_moment_is_not_dead():
    core = met(heartbeat_hz=1.0)
    assert not core.note_silent_roscore(10.5, 10.6) and not core.note_silent_roscore(10.5, 11.5)
    assert changes(core) == [] and core.view.masters()[0].online
    core.take_own_state(OWN, 11.6)
    assert not core.note_silent_roscore(12.0, 12.0)
    assert changes(core) == []


# Quality


def test_quality_of_a_link():
    core = met()
    assert [link.quality for link in core.view.links(10.0)] == [-1.0, -1.0]
    core = met(heartbeat_hz=1.0, measurement_intervals=10)
    for second in range(11, 31):
        if second % 2:
            core.datagram(state(rate=1.0), PEER, True, float(second))
    own, peer = core.view.links(30.5)
    assert own.quality == 0.0  # its own multicast does not come back
    assert peer.quality == pytest.approx(50.0, abs=10)
    assert peer.silent == pytest.approx(1.5)


def test_the_next_tick_is_never_late():
    core = met(heartbeat_hz=0.5)
    core.tick(20.0)
    assert 20.0 < core.next_tick() <= 21.0
    core.take_own_state(OWN._replace(stamp=1001.0), 20.5)
    assert core.next_tick() == pytest.approx(20.7)


def test_who_slept_does_not_take_the_others_for_silent():
    core = met()
    core.datagram(state(rate=1.0), PEER, True, 10.0)
    core.tick(10.0)
    take(core)
    core.tick(40.0)
    assert take(core, MasterEvent) == []
    _out, events = run(core, 40.25, 50.0)
    assert [round(now, 2) for now, _change, _online in events] == [43.5]


ANSWER = ["2000.000000000", "http://kobuki2computer:11311/", "kobuki2computer", "/master_discovery", "http://x:1/"]


def test_the_answer_of_another_discovery_node():
    assert Contact.from_answer(ANSWER) == CONTACT


@pytest.mark.parametrize(
    ("at", "value"),
    [
        (0, "nan"),
        (0, "inf"),
        (0, "1e300"),
        (0, "-1"),
        (0, "x"),
        (0, 2000.0),
        (1, "http://["),
        (1, "http://"),
        (1, "ftp://kobuki2computer:21/"),
        (1, ""),
        (2, "x" * 2000),
        (2, "two words"),
        (2, 'a "quote"'),
        (3, None),
    ],
)
def test_an_answer_that_cannot_be_used_is_refused(at, value):
    with pytest.raises(ValueError):
        Contact.from_answer([*ANSWER[:at], value, *ANSWER[at + 1 :]])


def test_a_full_list_of_masters_takes_a_new_one_later(monkeypatch):
    monkeypatch.setattr("rosfleet_multimaster.discovery.core.peers.MAX_MASTERS", 1)
    core, refusals = met(remove_after=20.0), []
    new = ("10.0.0.5", 11511)
    for now in range(11, 60):
        core.datagram(state(), new, True, float(now))
        core.tick(float(now))
        actions = take(core)
        refusals += [action for action in actions if isinstance(action, Say) and action.topic == "masters"]
        for action in actions:
            if not isinstance(action, Ask):
                continue
            known = action.key[0] == new[0]
            contact = CONTACT._replace(uri="http://new:11311/", name="new") if known else None
            core.take_contact(action.key, contact, "" if known else TIMED_OUT, float(now))
    refusals += [action for action in take(core, Say) if action.topic == "masters"]
    assert len(refusals) == 1 and [master.name for master in core.view.masters()[1:]] == ["new"]


def looks(monkeypatch, masters):
    """The number of times that a core looks at a single master, in ten seconds of beats of so many."""
    core, seen = started(heartbeat_hz=1.0, offline_after=5.0), []
    for number in range(masters):
        address = f"192.168.2.{number}"
        core.datagram(state(rate=1.0), (address, 11511), True, 10.0)
        contact = Contact(2000.0, f"http://robot{number}:11311/", f"robot{number}", "/master_discovery")
        core.take_contact((address, 11511, 11611), contact, "", 10.0)
    take(core)
    with monkeypatch.context() as patch:
        steps, master = Peers._steps, Peer.master
        patch.setattr(Peers, "_steps", lambda self, entry: seen.append(entry) or steps(self, entry))
        patch.setattr(Peer, "master", lambda self: seen.append(self) or master(self))
        for second in range(10):
            for number in range(masters):
                now = 10.0 + second + number / masters
                core.datagram(state(rate=1.0), (f"192.168.2.{number}", 11511), True, now)
                core.tick(now)
                assert core.next_tick() > now
    assert len(core.view.masters()) == masters + 1 and all(master.online for master in core.view.masters())
    return len(seen)


def test_heartbeats_cost_grows_with_the_masters(monkeypatch):
    assert looks(monkeypatch, 80) <= 6 * looks(monkeypatch, 20)
