# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import pytest
from rosfleet_multimaster.discovery_core import Ask, Contact, Discovery, Event, Master, Say, Send, Settings, misnamed
from rosfleet_multimaster.heartbeat import Heartbeat, Kind, Stamp, decode, encode

OWN = Master(
    "kobuki1computer",
    "http://kobuki1computer:11311/",
    1000.0,
    1000.0,
    True,
    "/master_discovery",
    "http://192.168.1.229:11611",
)
PEER = ("192.168.1.239", 11511)
KEY = (*PEER, 11611)
CONTACT = Contact(2000.0, "http://kobuki2computer:11311/", "kobuki2computer", "/master_discovery")
REFUSED = "Connection refused"


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
    core.own_state(OWN, 0.0)
    for now in (0.2, 1.0, 5.0, 10.0):
        core.tick(now)
    take(core)
    return core


def met(**settings):
    """A core that knows one other master, heard last at 10 s."""
    core = started(**settings)
    core.datagram(state(), PEER, True, 10.0)
    core.contacted(KEY, CONTACT, "", 10.0)
    take(core)
    return core


def changes(core):
    return [(event.change, event.master.name, event.master.online) for event in take(core, Event)]


def run(core, begin, end, step=0.25):
    """Tick as the program does; the (time, kind, host) of what was sent, and the (time, change)s."""
    out, events, now = [], [], begin
    while now <= end:
        core.tick(now)
        for action in take(core):
            if isinstance(action, Send):
                out.append((now, decode(action.datagram).kind, action.host))
            elif isinstance(action, Event):
                events.append((now, action.change, action.master.online))
            elif isinstance(action, Ask):
                core.contacted(action.key, None, REFUSED, now)
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
    core.own_state(OWN, 0.0)
    both = [(Kind.STATE, None), (Kind.STATE, "peer"), (Kind.REQUEST, None), (Kind.REQUEST, "peer")]
    assert sent(core) == both


def test_a_change_is_announced_at_once_and_twice_again():
    core = started(heartbeat_hz=0.02)
    core.own_state(Master(**{**OWN.__dict__, "stamp": 1001.0}), 20.0)
    out, _events = run(core, 20.0, 22.0, 0.1)
    assert [round(now, 1) for now, kind, host in out if kind is Kind.STATE] == [20.0, 20.2, 21.0]


def test_the_announced_stamps_are_those_of_the_state():
    core = node()
    core.own_state(Master(**{**OWN.__dict__, "stamp": 1700000000.123456, "local_stamp": 1700000000.0}), 0.0)
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


def test_without_multicast_the_known_masters_are_told():
    core = met(send_mcast=False, listen_mcast=False, robot_hosts=["third"])
    core.own_state(Master(**{**OWN.__dict__, "stamp": 1001.0}), 20.0)
    assert sent(core) == [(Kind.STATE, "third"), (Kind.STATE, PEER[0])]


def test_leave_and_refresh():
    core = met(robot_hosts=["third"])
    core.refresh(20.0)
    assert sent(core) == [(Kind.REQUEST, PEER[0]), (Kind.REQUEST, None), (Kind.REQUEST, "third")]
    core.leave()
    assert sent(core) == [(Kind.LEAVE, None), (Kind.LEAVE, "third")]


# Who is there


def test_the_own_master_is_listed_first_and_its_own_datagrams_change_nothing():
    core = met()
    for datagram in (state(5), request(), leave()):
        core.datagram(datagram, ("192.168.1.229", 11511), True, 11.0)
    assert take(core) == []
    assert [(master.name, master.monitor_uri) for master in core.masters()] == [
        ("kobuki1computer", "http://192.168.1.229:11611"),
        ("kobuki2computer", "http://192.168.1.239:11611"),
    ]


def test_a_new_master_is_asked_who_it_is():
    core = started()
    core.datagram(state(), PEER, True, 10.0)
    assert take(core) == [Ask(KEY, "http://192.168.1.239:11611")]
    core.contacted(KEY, CONTACT, "", 10.1)
    assert changes(core) == [("new", "kobuki2computer", True)]


def test_it_is_asked_again_where_it_does_not_answer_or_has_no_state_yet():
    core = started()
    core.datagram(state(), PEER, True, 10.0)
    take(core)
    core.contacted(KEY, CONTACT._replace(stamp=0.0), "", 10.0)
    core.tick(10.9)
    assert take(core, Ask) == []
    core.tick(11.0)
    assert len(take(core, Ask)) == 1
    core.contacted(KEY, None, REFUSED, 11.0)
    core.tick(15.9)
    assert take(core, Ask) == []
    core.tick(16.0)
    assert len(take(core, Ask)) == 1


def test_a_change_is_an_event_and_a_repetition_is_none():
    core = met()
    core.datagram(state(2001), PEER, True, 11.0)
    assert changes(core) == [("changed", "kobuki2computer", True)]
    core.datagram(state(2001), PEER, True, 11.2)
    assert changes(core) == []


def test_empty_datagrams_are_ignored_silently_and_malformed_ones_counted():
    core = met()
    core.datagram(b"", PEER, True, 11.0)
    assert take(core) == [] and core.malformed == 0
    for data in (b"x", b"R\x01" + bytes(22), b"R\x02short"):
        core.datagram(data, PEER, True, 11.0)
    assert core.malformed == 3
    assert {type(action) for action in take(core)} == {Say}
    assert len(core.masters()) == 2


def test_two_addresses_of_one_master_are_one_master():
    core = met()
    second = ("10.0.0.2", 11511)
    core.datagram(state(), second, True, 11.0)
    core.contacted((*second, 11611), CONTACT, "", 11.0)
    assert changes(core) == []
    core.datagram(leave(), PEER, True, 12.0)
    core.tick(12.2)
    core.contacted(KEY, None, REFUSED, 12.2)
    assert [(event.change, event.master.monitor_uri) for event in take(core, Event)] == [
        ("changed", "http://10.0.0.2:11611")
    ]


def test_a_gateway_may_have_its_name_in_the_network_of_its_robot():
    """It is heard from its address in the common network; whether its name leads to it shows who answers there."""
    heard, named = "192.168.1.239", "192.168.11.101"
    assert misnamed(CONTACT, heard, heard, None) == ""
    assert misnamed(CONTACT, heard, named, CONTACT._replace(stamp=2001.0)) == ""
    for there in (None, CONTACT._replace(uri="http://other:11311/")):
        problem = misnamed(CONTACT, heard, named, there)
        assert f"kobuki2computer resolves to {named}" in problem and f"heard from {heard}" in problem
    assert "kobuki2computer has no address" in misnamed(CONTACT, heard, "", None)


def test_one_name_or_one_uri_for_two_masters_is_reported():
    core = met()
    for address, contact in (
        ("10.0.0.3", CONTACT._replace(uri="http://other:11311/")),
        ("10.0.0.4", CONTACT._replace(uri=OWN.uri)),
    ):
        core.datagram(state(), (address, 11511), True, 11.0)
        core.contacted((address, 11511, 11611), contact, "", 11.0)
    texts = [action.text for action in take(core, Say)]
    assert any("two masters are called kobuki2computer" in text for text in texts)
    assert any("ROS_HOSTNAME" in text for text in texts)
    assert core.masters()[0] == OWN


def test_a_flood_of_senders_is_bounded():
    core = started()
    for count in range(3000):
        core.datagram(state(), (f"10.0.{count // 250}.{count % 250}", 11511), True, 10.0)
    assert core.refused == 3000 - 1024
    run(core, 11.0, 45.0, 1.0)
    core.datagram(state(), PEER, True, 46.0)
    assert take(core, Ask) == [Ask(KEY, "http://192.168.1.239:11611")]


# Who is gone


def test_leave_of_a_master_that_no_longer_answers():
    core = met()
    core.datagram(leave(), PEER, True, 11.0)
    core.tick(11.1)
    assert take(core, Ask) == []
    core.tick(11.2)
    assert len(take(core, Ask)) == 1
    core.contacted(KEY, None, REFUSED, 11.2)
    assert changes(core) == [("removed", "kobuki2computer", False)]
    assert [master.name for master in core.masters()] == ["kobuki1computer"]


def test_a_spoofed_leave_has_no_lasting_effect():
    core = met()
    core.datagram(leave(), PEER, True, 11.0)
    core.datagram(leave(), ("10.9.9.9", 11511), True, 11.0)
    asked = 0
    for tenth in range(200):
        core.tick(11.0 + tenth / 10)
        for action in take(core, Ask):
            asked += 1
            core.contacted(action.key, CONTACT, "", 11.0 + tenth / 10)
    assert asked == 3
    assert changes(core) == []
    assert core.masters()[1].online


def test_silence_without_a_promised_rate_is_offline_after_65_s_and_removed_after_300_s():
    core = met()
    out, events = run(core, 10.0, 320.0)
    requests = [now for now, kind, host in out if kind is Kind.REQUEST and host == PEER[0]]
    assert requests[0] > 70.0 and requests[4] < 76.0
    assert [change for _now, change, _online in events] == ["changed", "removed"]
    assert 74.0 < events[0][0] < 77.0 and not events[0][2]
    assert 310.0 < events[1][0] < 312.0


def test_silence_with_a_promised_rate():
    core = met(timeout_factor=1.4)
    core.datagram(state(rate=1.0), PEER, True, 10.0)
    _out, events = run(core, 10.0, 30.0)
    assert events[0][1:] == ("changed", False)
    assert 17.0 < events[0][0] < 18.5


def test_back_online_is_a_change_and_it_is_asked_again_who_it_is():
    core = met()
    run(core, 10.0, 80.0)
    core.datagram(state(), PEER, True, 81.0)
    actions = take(core)
    assert [type(action) for action in actions] == [Event, Ask]
    assert actions[0].master.online


def test_removal_can_be_switched_off():
    core = met(remove_after=0.0)
    _out, events = run(core, 10.0, 1000.0, 1.0)
    assert [change for _now, change, _online in events] == ["changed"]


# The own roscore


def test_a_dead_roscore_is_not_announced_as_alive():
    core = met(heartbeat_hz=1.0)
    core.own_offline(leave=False)
    assert changes(core) == [("changed", "kobuki1computer", False)]
    core.datagram(request(), PEER, True, 11.0)
    out, _events = run(core, 11.0, 20.0)
    assert [kind for _now, kind, _host in out if kind is Kind.STATE] == []
    core.own_offline(leave=True)
    assert sent(core) == [(Kind.LEAVE, None)]
    core.own_state(OWN, 21.0)
    assert (Kind.STATE, None) in sent(core)


# Quality


def test_quality_of_a_link():
    core = met()
    assert [link.quality for link in core.links(10.0)] == [-1.0, -1.0]
    core = met(heartbeat_hz=1.0, measurement_intervals=10)
    for second in range(11, 31):
        if second % 2:
            core.datagram(state(rate=1.0), PEER, True, float(second))
    own, peer = core.links(30.5)
    assert own.quality == 0.0  # its own multicast does not come back
    assert peer.quality == pytest.approx(50.0, abs=10)
    assert peer.silent == pytest.approx(1.5)


def test_the_next_tick_is_never_late():
    core = met(heartbeat_hz=0.5)
    core.tick(20.0)
    assert 20.0 < core.next_tick() <= 21.0
    core.own_state(Master(**{**OWN.__dict__, "stamp": 1001.0}), 20.5)
    assert core.next_tick() == pytest.approx(20.7)


def test_who_slept_does_not_take_the_others_for_silent():
    core = met(timeout_factor=1.0)
    core.datagram(state(rate=1.0), PEER, True, 10.0)
    core.tick(10.0)
    take(core)
    core.tick(40.0)
    assert take(core, Event) == []
    _out, events = run(core, 40.25, 50.0)
    assert [change for _now, change, _online in events] == ["changed"]


ANSWER = ["2000.000000000", "http://kobuki2computer:11311/", "kobuki2computer", "/master_discovery", "http://x:1/"]


def test_the_answer_of_another_discovery_node():
    assert Contact.of(ANSWER) == CONTACT


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
        (3, None),
    ],
)
def test_an_answer_that_cannot_be_used_is_refused(at, value):
    with pytest.raises(ValueError):
        Contact.of([*ANSWER[:at], value, *ANSWER[at + 1 :]])
