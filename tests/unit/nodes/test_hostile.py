# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Hostile schedules against the cores: nothing of a stranger, no change of identity, few connections, losses in time."""

import hostile_inputs
import pytest
from drawn import drawn
from fleet_of_one import ROUTER, TIBI, URI
from hypothesis import given, settings
from hypothesis import strategies as st
from mentioned import mentions
from rosfleet_multimaster.discovery.core.actions import Ask, MasterEvent, Say, Send
from rosfleet_multimaster.discovery.core.discovery import Discovery
from rosfleet_multimaster.discovery.core.peer import Contact
from rosfleet_multimaster.protocol.filters import Filters
from rosfleet_multimaster.protocol.graph import State
from rosfleet_multimaster.protocol.heartbeat import Heartbeat, Kind, Stamp, encode
from rosfleet_multimaster.protocol.members import Members, Networks
from rosfleet_multimaster.protocol.messages import AnnouncedMaster
from rosfleet_multimaster.protocol.parameters import Settings
from rosfleet_multimaster.sync.core.sync import Sync

OWN = AnnouncedMaster("own", "http://own:11311/", "http://192.168.1.202:11611", "/master_discovery", 1.0, 1.0, True)
ADDRESS, ROGUE = "192.168.1.201", "192.168.1.66"
KNOWN = Contact(5.0, URI, "tibi-visio", "/master_discovery")
ADDRESSES = [ADDRESS, ROGUE, "192.168.1.67", "192.168.1.202", "127.0.0.1", "8.8.8.8", "192.168.11.102", "192.168.1.1"]
MEMBERS = {"members": [TIBI, ROUTER], "strangers": "ignore", "allow": []}


def beat(kind=Kind.STATE, rate=1.0, stamp=5, port=11611):
    return encode(Heartbeat(kind, port, rate, Stamp(stamp), Stamp(stamp)))


def running(members):
    core = Discovery(
        Settings(heartbeat_hz=1.0), ["127.0.0.1", "192.168.1.202"], 11611, Members.from_parameters(members)
    )
    core.take_networks(Networks(["192.168.1.202/24"]))
    core.take_own_state(OWN, 0.0)
    return core


class Fleet:
    """The core, a member that sends and answers until it is lost, and somebody else who sends and answers what he likes."""

    def __init__(self, members, answer):
        self.core, self.answer = running(members), answer
        self.alive, self.now, self.asked, self.events, self.said = True, 0.0, [], [], []
        self.closed = False  # where nobody answers, a closed port does

    def go(self, seconds, hostile=()):
        """Pass some time. `hostile`: (time, address, UDP port, datagram)."""
        end, waiting = self.now + seconds, sorted(hostile, key=lambda item: item[0])
        while self.now < end:
            self.now = round(self.now + 0.1, 3)
            if self.alive and round(self.now * 10) % 10 == 0:
                self.core.datagram(beat(), (ADDRESS, 11511), True, self.now)
            while waiting and waiting[0][0] <= self.now:
                _at, address, port, data = waiting.pop(0)
                self.core.datagram(data, (address, port), True, self.now)
            self.core.tick(self.now)
            self.carry_out()

    def carry_out(self):
        while self.core.actions:
            action = self.core.actions.popleft()
            if isinstance(action, Ask):
                self.asked.append((action.key[0], action.monitor_uri))
                there = self.alive and action.monitor_uri == f"http://{ADDRESS}:11611"
                answer = KNOWN if there else None if action.key[0] == ADDRESS else self.answer
                gone = answer is None and self.closed
                self.core.take_contact(action.key, answer, "timed out", self.now, gone=gone)
            elif isinstance(action, MasterEvent):
                self.events.append((self.now, action.change, action.master))
            elif isinstance(action, Say):
                self.said.append(action.text)
            elif isinstance(action, Send) and action.host is not None:
                assert action.host == ADDRESS, "no stranger is answered"


DATAGRAMS = st.tuples(
    st.floats(2.0, 40.0), st.sampled_from(ADDRESSES), st.sampled_from([11511, 4711]), drawn(hostile_inputs.datagram)
)
ANSWERS = [
    None,
    Contact(1.0, "http://rogue:11311/", "rogue", "/master_discovery"),
    Contact(1.0, URI, "tibi-visio", "/master_discovery"),
    Contact(1.0, "http://rogue:11311/", "tibi-visio", "/master_discovery"),
    Contact(0.0, "http://rogue:11311/", "rogue", "/master_discovery"),
]


@settings(max_examples=60, deadline=None)
@given(st.lists(DATAGRAMS, max_size=60), st.sampled_from(ANSWERS))
def test_whatever_is_sent_the_fleet_stays_what_it_is(datagrams, answer):
    fleet = Fleet(MEMBERS, answer)
    fleet.go(41.0, datagrams)
    assert {master.uri for _now, _change, master in fleet.events} <= {OWN.uri, URI}
    assert {master.monitor_uri for _now, _change, master in fleet.events if master.uri == URI} == {
        f"http://{ADDRESS}:11611"
    }
    assert all(change != "removed" and master.online for _now, change, master in fleet.events)
    for address in set(ADDRESSES) - {ADDRESS}:
        assert len([one for one, _uri in fleet.asked if one == address]) <= 2
    assert not {"127.0.0.1", "8.8.8.8", "192.168.1.202"} & {address for address, _uri in fleet.asked}
    assert len([uri for address, uri in fleet.asked if address == ADDRESS and not uri.endswith(":11611")]) <= 2


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.lists(DATAGRAMS, max_size=60))
def test_a_loss_is_seen_in_time_whatever_was_sent_before(datagrams):
    fleet = Fleet(MEMBERS, None)
    fleet.go(41.0, datagrams)
    fleet.alive, lost = False, fleet.now
    fleet.go(6.0)
    offline = [now for now, _change, master in fleet.events if master.uri == URI and not master.online]
    assert offline and offline[0] - lost <= 5.0


def test_a_loss_is_seen_in_time_without_a_list():
    fleet = Fleet({}, None)
    fleet.go(20.0, [(at, ADDRESS, 11511, beat(rate=0.0)) for at in (5.0, 10.05, 15.3, 19.95)])
    fleet.alive, lost = False, fleet.now
    fleet.go(6.0, [(lost + 0.1, ADDRESS, 11511, beat(rate=0.0))])
    (offline,) = [now for now, _change, master in fleet.events if master.uri == URI and not master.online]
    assert offline - lost <= 5.1


def test_own_addresses_are_never_asked():
    own = {**TIBI, "robot": "own", "name": "own", "uris": ["http://own:11311/"], "hosts": ["own"]}
    own["addresses"] = ["192.168.1.202", "192.168.1.203"]
    core = running({**MEMBERS, "members": [TIBI, ROUTER, own], "allow": ["192.168.1.202", "192.168.1.66"]})
    asked = [
        address
        for address in ("192.168.1.202", "192.168.1.203", "127.0.0.1", ADDRESS, ROGUE)
        if core.local.may_ask(address)
    ]
    assert asked == [ADDRESS, ROGUE]


def test_a_rogue_is_named_once():
    fleet = Fleet(MEMBERS, ANSWERS[1])
    fleet.go(60.0, [(at, ROGUE, 11511, beat()) for at in range(2, 60)])
    said = [text for text in fleet.said if ROGUE in text]
    assert len(said) == 1 and mentions(said[0], "rogue", "http://rogue:11311/", ROGUE)
    assert [outsider.name for outsider in fleet.core.outsiders.list_ignored()] == ["rogue"]


def test_a_member_at_an_unplanned_port_is_named_with_the_reason():
    fleet = Fleet(MEMBERS, None)
    fleet.core.datagram(beat(port=11999), (ADDRESS, 11511), True, 0.0)
    fleet.core.tick(0.1)
    (key,) = [action.key for action in fleet.core.actions if isinstance(action, Ask)]
    fleet.core.take_contact(key, KNOWN, "", 0.2)
    (outsider,) = fleet.core.outsiders.list_ignored()
    assert mentions(outsider.why, "discovery", "11999")


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize(
    "members",
    [{}, {**MEMBERS, "strangers": "allow"}, {**MEMBERS, "allow": ["192.168.1.64/28"]}],
    ids=["none", "all", "some"],
)
def test_an_address_that_somebody_invents_is_asked_twice(members, closed):
    fleet = Fleet(members, None)
    fleet.closed = closed
    fleet.go(60.0, [(2.0, ROGUE, 11511 + port, beat(port=11611 + port)) for port in range(20)])
    assert len([address for address, _uri in fleet.asked if address == ROGUE]) == 2


# master_sync


def announced(stamp, name="tibi-visio", uri=URI, address=ADDRESS):
    return AnnouncedMaster(name, uri, f"http://{address}:11611", "/master_discovery", stamp, stamp, True)


def test_spoofed_stamps_cost_one_fetch_a_second():
    """226 datagrams in 9 s, each with another stamp; the state never changes."""
    sync = Sync(Filters({}), "http://own:11311/", "/master_sync", False, False, 0.0, Members.from_parameters(MEMBERS))
    fetches = 0
    for step in range(900):
        now = step / 100
        if step % 4 == 0:
            sync.take_announcement(announced(5.0 if step % 8 == 0 else 1000.0 + step), now)
        for fetch in sync.due(now):
            fetches += 1
            sync.take_fetch(fetch, State(URI, "tibi-visio", 5.0, 5.0), now + 0.005)
    assert 1 <= fetches <= 11


@pytest.mark.parametrize(("own", "wanted"), [(8, 1), (4100, 5)], ids=["between_its_own", "alone"])
def test_spoofed_stamps_of_a_followed_master_cost_one_fetch(own, wanted):
    """It tells its changes itself, so a stamp that it has not told is somebody else's, or its connection is dead.

    Its own next heartbeat says that there is nothing to fetch. `own`: each of so many steps it sends one.
    """
    sync = Sync(Filters({}), "http://own:11311/", "/master_sync", False, False, 0.0, Members.from_parameters(MEMBERS))
    fetched = []
    for step in range(4100):
        now = step / 100
        if step % 4 == 0:
            sync.take_announcement(announced(5.0 if step % own == 0 else 1000.0 + step), now)
        for fetch in sync.due(now):
            fetched.append(now)
            sync.take_fetch(fetch, State(URI, "tibi-visio", 5.0, 5.0), now + 0.005, following=True)
    pauses = [later - earlier for earlier, later in zip(fetched[1:], fetched[2:])]
    assert len(fetched) == wanted and min(pauses, default=10.0) > 9.99


def test_a_master_is_taken_at_its_planned_address_alone():
    sync = Sync(Filters({}), "http://own:11311/", "/master_sync", False, False, 0.0, Members.from_parameters(MEMBERS))
    sync.take_list([announced(5.0, address=ROGUE), announced(5.0, "rogue", "http://rogue:11311/", ROGUE)], 0.0)
    assert not sync.remotes
    sync.take_list([announced(5.0)], 0.0)
    assert set(sync.remotes) == {URI}
