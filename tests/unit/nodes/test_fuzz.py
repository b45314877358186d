# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Hostile input: datagrams, filters and state documents of strangers."""

import contextlib
import math
import signal
import xmlrpc.client

import hostile_inputs
import pytest
from drawn import drawn
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from rosfleet_multimaster.discovery.core.actions import Ask, MasterEvent
from rosfleet_multimaster.discovery.core.announcements import MAX_ANSWERED
from rosfleet_multimaster.discovery.core.discovery import Discovery
from rosfleet_multimaster.discovery.core.newcomers import MAX_ASKED, MAX_NEWCOMERS
from rosfleet_multimaster.discovery.core.peer import Contact
from rosfleet_multimaster.protocol.filters import Filters, InvalidPattern, Pattern, Rules
from rosfleet_multimaster.protocol.graph import InvalidDocument, State, add_stamps, build, document, parse, users_of
from rosfleet_multimaster.protocol.heartbeat import Heartbeat, Kind, Stamp, decode, encode
from rosfleet_multimaster.protocol.messages import AnnouncedMaster, View
from rosfleet_multimaster.protocol.parameters import Settings
from rosfleet_multimaster.protocol.wire_filters import read_pattern, read_rules, write_rules
from rosfleet_multimaster.sync.core.sync import Candidate, calls, plan, select

slow = settings(
    deadline=None, max_examples=100, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large]
)

OWN_ADDRESS, PEER_ADDRESS, PORT, RPC = "192.168.1.229", "192.168.1.239", 11511, 11611
OWN = AnnouncedMaster(
    "own", "http://own:11311/", f"http://{OWN_ADDRESS}:{RPC}", "/master_discovery", 1000.0, 1000.0, True
)
PEER = Contact(2000.0, "http://peer:11311/", "peer", "/master_discovery")
BEAT = encode(Heartbeat(Kind.STATE, RPC, 1.0, Stamp(2000), Stamp(2000)))

# Datagrams


ports = st.sampled_from([0, 1, PORT, RPC, 40000, 65535])
datagrams = drawn(hostile_inputs.datagram) | st.just(BEAT)
addresses = st.sampled_from([PEER_ADDRESS, OWN_ADDRESS, "127.0.0.1", "0.0.0.0", "10.0.0.7"]) | st.ip_addresses(v=4).map(
    str
)
attacks = st.lists(
    st.tuples(st.sampled_from([0.0, 0.01, 0.3, 2.5]), addresses, ports, st.booleans(), datagrams), max_size=25
)


class Bystander:
    """A discovery, a live master that sends a heartbeat each second and answers, and a stranger who sends what he likes."""

    def __init__(self):
        self.core = Discovery(Settings(heartbeat_hz=1.0), ["127.0.0.1", OWN_ADDRESS], RPC)
        self.contacts = {f"http://{PEER_ADDRESS}:{RPC}": PEER}
        self.now, self.beat_due, self.events, self.asked = 0.0, 0.5, [], []
        self.core.take_own_state(OWN, 0.0)
        self.wait(2.0)
        self.events.clear()

    def wait(self, seconds):
        """Let time pass; the core is ticked when it wants to be, and the live master sends its heartbeats."""
        end = self.now + seconds
        while True:
            self.carry_out()
            answers = [due for due, _action in self.asked]
            self.now = min(end, max(self.now, self.core.next_tick()), self.beat_due, *answers)
            if self.now >= self.beat_due:
                self.beat_due += 1.0
                self.core.datagram(BEAT, (PEER_ADDRESS, PORT), True, self.now)
            self.core.tick(self.now)
            self.carry_out()
            assert self.now < self.core.next_tick() <= self.now + 1.0, "it sleeps, and wakes up in time"
            if self.now >= end:
                return

    def carry_out(self):
        """Carry out the actions of the core. They are bounded, however much has arrived. A stranger answers after two seconds."""
        for due, action in [item for item in self.asked if item[0] <= self.now]:
            self.asked.remove((due, action))
            contact = self.contacts.get(action.monitor_uri)
            self.core.take_contact(action.key, contact, "" if contact else "timed out", self.now)
        assert len(self.core.actions) <= 2 * MAX_ASKED + 8 + 2 * len(self.core.peers.table)
        while self.core.actions:
            action = self.core.actions.popleft()
            if isinstance(action, MasterEvent):
                self.events.append(action)
            elif isinstance(action, Ask):
                self.asked.append((self.now + (0.01 if action.monitor_uri in self.contacts else 2.0), action))
        assert len(self.asked) <= MAX_ASKED + len(self.core.peers.table)

    def master(self, uri):
        return next((master for master in self.core.view.masters() if master.uri == uri), None)


@pytest.mark.slow
@slow
@given(attacks)
def test_no_datagram_takes_a_live_master_or_the_own_one_away(attack):
    robot = Bystander()
    for pause, address, port, multicast, data in attack:
        if pause:
            robot.wait(pause)
        robot.core.datagram(data, (address, port), multicast, robot.now)
        robot.carry_out()
        assert robot.master(OWN.uri) == OWN
        assert robot.master(PEER.uri).online
    assert not [event for event in robot.events if event.change == "removed" and event.master.uri == PEER.uri]
    robot.wait(5.0)
    assert robot.master(OWN.uri) == OWN
    assert (robot.master(PEER.uri).online, robot.master(PEER.uri).stamp) == (True, 2000.0)


def test_a_flood_from_everywhere_is_bounded():
    robot = Bystander()
    for number in range(6000):
        address, rpc_port = f"10.{number >> 8}.{number & 255}.1", 1 + number % 60000
        kind = (Kind.STATE, Kind.REQUEST, Kind.LEAVE)[number % 3]
        beat = Heartbeat(kind, rpc_port, 1.0, Stamp(5), Stamp(5))
        robot.core.datagram(encode(beat), (address, PORT), False, robot.now)
        robot.carry_out()
        if number % 64 == 0:
            robot.wait(0.01)
    assert len(robot.core.newcomers.table) <= MAX_NEWCOMERS
    assert len(robot.core.announcements._answered) <= MAX_ANSWERED + 2
    assert robot.master(PEER.uri).online
    assert robot.events == []
    robot.wait(40.0)
    assert len(robot.core.newcomers.table) == 0, "newcomers who never say who they are, are forgotten"
    assert len(robot.core.announcements._answered) <= 2


def test_one_address_cannot_fill_the_table():
    robot = Bystander()
    for port in range(1, 1000):
        robot.core.datagram(BEAT, ("10.0.0.7", port), True, robot.now)
        robot.core.datagram(BEAT, (PEER_ADDRESS, port), True, robot.now)
        robot.wait(0.02)
    assert len(robot.core.peers.table) < 100
    assert robot.master(PEER.uri).online


@pytest.mark.parametrize(("rate", "flooded", "patience"), [(500, 12, 0), (3000, 3, 8)])
def test_a_newcomer_is_met_during_or_after_a_flood_of_strangers(rate, flooded, patience):
    """(More newcomers in a second than are remembered leave no room for him while they come.)"""
    robot = Bystander()
    new = Contact(1.0, "http://new:11311/", "new", "/master_discovery")
    robot.contacts[f"http://192.168.1.77:{RPC}"] = new
    for second in range(flooded + patience):
        for number in range(rate if second < flooded else 0):
            robot.core.datagram(BEAT, (f"10.{second}.{number >> 8}.{number & 255}", PORT), True, robot.now)
            robot.carry_out()
        robot.core.datagram(BEAT, ("192.168.1.77", PORT), True, robot.now)
        robot.wait(1.0)
    assert robot.master(new.uri).online
    assert robot.master(PEER.uri).online


@pytest.mark.parametrize("problem", ["too much to do at once", "timed out"])
def test_a_leave_is_not_believed_after_one_check_without_result(problem):
    robot = Bystander()
    robot.core.datagram(encode(Heartbeat(Kind.LEAVE, RPC)), (PEER_ADDRESS, PORT), False, robot.now)
    robot.core.tick(robot.now + 0.9)
    (asked,) = [action for action in robot.core.actions if isinstance(action, Ask)]
    robot.core.take_contact(asked.key, None, problem, robot.now + 0.95)
    assert robot.master(PEER.uri).online


@given(st.floats(-1e10, 1e12))
def test_any_clock_can_be_announced(clock):
    beat = Heartbeat(Kind.STATE, RPC, 1.0, Stamp.from_seconds(clock), Stamp.from_seconds(clock))
    assert decode(encode(beat)).kind in (Kind.STATE, Kind.REQUEST)


def test_no_port_is_no_record():
    robot = Bystander()
    robot.core.datagram(BEAT[:12] + bytes(2) + BEAT[14:], ("10.0.0.7", PORT), True, robot.now)
    assert robot.core.malformed == 1


# Filters

NAMES = ["a" * 255, "ab" * 127, "/" + "a" * 254, "/" * 255, "a" * 254 + "\n", "", "/tf"]


class TooSlow(Exception):
    pass


@contextlib.contextmanager
def within(seconds):
    """Ends what takes more time of the processor, also a regular expression."""

    def late(_number, _frame):
        raise TooSlow

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    except TooSlow:
        raise AssertionError(f"it took more than {seconds} s") from None
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


texts = drawn(hostile_inputs.expression) | st.text(max_size=40)


@pytest.mark.slow
@settings(deadline=None, max_examples=300, suppress_health_check=[HealthCheck.too_slow])
@given(texts)
def test_any_pattern_is_cheap_or_refused(text):
    check_cost(text)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(hostile_inputs.FILTERS)))
def test_a_costly_pattern_is_refused(number):
    check_cost(hostile_inputs.FILTERS[number])


def check_cost(text):
    """One of the own configuration, too: the names that it is tried with are others'."""
    patterns = []
    with within(0.5):
        patterns.append(read_pattern(text))
    for make, seconds in ((Pattern.from_foreign_items, 0.5), (Pattern.from_items, 20.0)):
        try:
            with within(seconds):
                patterns.append(make([text], "ignore_topics"))
        except InvalidPattern as problem:
            assert 0 < len(str(problem)) < 1000
    for name in NAMES:
        with within(1.5):  # an eighth of a second here; an expensive one takes minutes
            for pattern in filter(None, patterns):
                pattern.matches(name)


values = drawn(hostile_inputs.value) | st.just(10**400) | st.datetimes()


def nested(depth):
    value = []
    for _level in range(depth):
        value = [value]
    return value


@given(values | st.lists(values | texts, min_size=7, max_size=12))
def test_any_value_is_a_filter_or_refused_with_a_sentence(value):
    try:
        rules = read_rules(value)
    except InvalidPattern as problem:
        assert 0 < len(str(problem)) < 1000
    else:
        assert all(isinstance(text, str) for text in write_rules(rules, False)[1:])


@pytest.mark.parametrize("element", [nested(5000), ["x"] * 100_000, {"a": nested(3000)}])
def test_a_filter_too_big_or_too_deep_is_refused_in_few_words(element):
    for value in (element, [False] + [element] * 10):
        with pytest.raises(InvalidPattern) as refused:
            read_rules(value)
        assert len(str(refused.value)) < 1000
        with pytest.raises(InvalidDocument) as refused:
            parse(value)
        assert len(str(refused.value)) < 1000


# State documents

OURS, THEIRS = OWN.uri, PEER.uri
OWN_NODES = {"/camera": "http://own:40001/", "/rosout": "http://own:40002/", "/master_sync": "http://own:40003/"}
hostile = drawn(hostile_inputs.state, [THEIRS], [*OWN_NODES, "/talker", "/listener", "/chatter"], OWN_NODES.values())


@given(values | st.lists(values, min_size=10, max_size=10) | hostile)
@example([10**400, "1", "http://a:1/", "a", [], [], [], [], [], []])
@example(["nan", "1", "http://a:1/", "a", [], [], [], [], [], []])
def test_any_document_is_a_state_or_malformed(value):
    try:
        state = parse(value)
    except InvalidDocument as problem:
        assert 0 < len(str(problem)) < 1000
    else:
        assert isinstance(state, State) and math.isfinite(state.stamp) and math.isfinite(state.local_stamp)


@pytest.mark.slow
@pytest.mark.parametrize("where", [4, 5, 6, 7, 8, 9])
def test_a_gigantic_document_costs_little_or_is_refused(where):
    rows = {7: ["/t", "a/B"], 8: ["/n", "http://a:1/", "x", 1, "local"], 9: ["/s", "rosrpc://a:1", "x", "", "local"]}
    value = ["1", "1", "http://a:1/", "a", [], [], [], [], [], []]
    value[where] = [[f"/n{number}", *rows.get(where, ["", ["/n"] * 10])[1:]] for number in range(100_000)]
    with within(3.0), contextlib.suppress(InvalidDocument):
        parse(value)


@slow
@given(hostile, st.booleans())
def test_own_nodes_stay_whatever_a_master_says(value, remote_nodes):
    try:
        state = parse(value)
    except InvalidDocument:
        return
    items = select(state, Rules(), OURS, remote_nodes)
    claims = {("/talker", "http://peer:50001/"): THEIRS, ("/gone", "http://peer:50009/"): THEIRS}
    view = View(
        publishers={"/image": ("/camera",), "/rosout": ("/camera", "/talker"), "/chatter": ("/talker",)},
        subscribers={"/chatter": ("/camera",), "/rosout": ("/rosout",)},
        services={"/camera/set": ("/camera",)},
        types={"/image": "sensor_msgs/Image", "/chatter": "std_msgs/String"},
        node_uris={**OWN_NODES, "/talker": "http://peer:50001/"},
        service_uris={"/camera/set": "rosrpc://own:40004"},
    )
    todo = plan([Candidate(item, THEIRS, "peer") for item in items], view, claims)
    for item in todo.unregister:
        assert item.node_key in claims and item.node not in OWN_NODES
    for item in todo.register:
        assert item in items and item.node not in OWN_NODES, "a second node of this name would shut the own one down"
        assert (item.kind, item.name) != ("service", "/camera/set")
    for _method, *arguments in calls(todo):
        assert all(isinstance(argument, str) and argument.isprintable() for argument in arguments)
        assert arguments[0][0] == arguments[1][0] == "/" and min(map(len, arguments[:2])) > 1
        assert not set(" \n") & set("".join(arguments[:2]))


ros_names = st.from_regex(r"\A/[a-z][a-z0-9_]{0,6}(/[a-z][a-z0-9_]{0,6})?\Z")
tables = st.dictionaries(ros_names, st.lists(ros_names, min_size=1, max_size=3, unique=True).map(tuple), max_size=4)


@pytest.mark.slow
@given(tables, tables, tables, st.floats(1e9, 2e9), st.booleans())
def test_a_true_state_comes_back_over_the_wire(publishers, subscribers, services, wall, typed):
    kinds = dict.fromkeys([*publishers, *subscribers], "std_msgs/String") if typed else {}
    graph = State(OURS, "own", 0.0, 0.0, publishers, subscribers, services, kinds)
    node_uris = {
        name: f"http://own:{number + 1024}/"
        for number, name in enumerate(sorted(users_of(publishers, subscribers, services)))
    }
    service_uris = {name: f"rosrpc://own:{number + 1024}" for number, name in enumerate(services)}
    state = add_stamps(build(graph, node_uris, service_uris, {}), None, wall)
    sent = xmlrpc.client.dumps((document(state),), methodresponse=True, allow_none=True)
    back = parse(xmlrpc.client.loads(sent)[0][0])
    assert back == state and back.stamp == wall


@given(st.lists(values, max_size=6) | hostile)
def test_any_contact_is_one_that_can_be_shown_or_refused(answer):
    with contextlib.suppress(ValueError):
        contact = Contact.from_answer(answer)
        assert "".join(contact[1:]).isprintable()


def test_a_masters_name_cannot_speak_to_the_service_manager():
    with pytest.raises(ValueError, match="name"):
        Contact.from_answer(["1.0", "http://peer:11311/", "peer\nMAINPID=1", "/master_discovery"])


@given(st.lists(texts, max_size=4) | values)
def test_the_own_filters_are_usable_or_refused_with_a_sentence(value):
    filters = Filters({"ignore_topics": value})
    try:
        filters.check()
    except InvalidPattern as problem:
        assert "ignore_topics" in str(problem)
    else:
        assert filters.rules("peer") and filters.wants_host("peer") in (True, False)
