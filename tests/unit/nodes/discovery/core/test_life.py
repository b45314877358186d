# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The life of a peer as a whole: what becomes of it in each state by each event. How it is told is tested in test_discovery.py."""

import pytest
from rosfleet_multimaster.discovery.core.discovery import Discovery
from rosfleet_multimaster.discovery.core.life import LEAVE_CHECKS
from rosfleet_multimaster.discovery.core.peer import Contact, Peer
from rosfleet_multimaster.protocol.heartbeat import Heartbeat, Kind, Stamp, encode
from rosfleet_multimaster.protocol.members import Members
from rosfleet_multimaster.protocol.parameters import Settings

KEY = ("10.0.0.2", 0, 11611)
ROBOT2 = {
    "robot": "robot2",
    "name": "robot2",
    "uris": ["http://robot2:11311/"],
    "rpc_port": 11611,
    "addresses": ["10.0.0.2"],
    "hosts": ["robot2"],
}
CONTACT = Contact(2000.0, "http://robot2:11311/", "robot2", "/master_discovery")
FOREIGN = Contact(2000.0, "http://other:11311/", "other", "/master_discovery")
NOW = 100.0

ONLINE, OFFLINE = (True, False), (False, False)  # online, leaving
LEAVING, LEAVING_OFFLINE = (True, True), (False, True)
REMOVED = None
LISTED = (ONLINE, OFFLINE, LEAVING, LEAVING_OFFLINE)


def beat(kind=Kind.STATE, stamp=2000):
    return encode(Heartbeat(kind, 11611, 1.0, Stamp(stamp), Stamp(stamp)))


def hear(data):
    return lambda core: core.datagram(data, (KEY[0], 11511), True, NOW)


def answer(contact, **more):
    return lambda core: core.take_contact(KEY, contact, "" if contact else "no answer", NOW, **more)


def wait(seconds):
    return lambda core: core.peers.step(NOW + seconds)


#: event -> what becomes of a peer that is online, offline, leaving, both
EVENTS = {
    "heartbeat": (hear(beat()), ONLINE, ONLINE, ONLINE, ONLINE),
    "heartbeat without a state": (hear(beat(stamp=0)), ONLINE, OFFLINE, ONLINE, OFFLINE),
    "leave": (hear(beat(Kind.LEAVE)), LEAVING, LEAVING_OFFLINE, LEAVING, LEAVING_OFFLINE),
    "answer": (answer(CONTACT), ONLINE, ONLINE, LEAVING, LEAVING_OFFLINE),
    "answer without a state": (answer(CONTACT._replace(stamp=0.0)), ONLINE, OFFLINE, LEAVING, LEAVING_OFFLINE),
    "no answer": (answer(None), ONLINE, OFFLINE, LEAVING, LEAVING_OFFLINE),
    "refusal": (answer(None, gone=True), ONLINE, OFFLINE, REMOVED, REMOVED),
    "answer of another master": (answer(FOREIGN), REMOVED, REMOVED, REMOVED, REMOVED),
    "silence": (wait(5.0), OFFLINE, OFFLINE, LEAVING_OFFLINE, LEAVING_OFFLINE),
    "long silence": (wait(300.0), REMOVED, REMOVED, REMOVED, REMOVED),
}


def a_core(state, checks=1):
    """A discovery with one peer in this state."""
    core = Discovery(Settings(), [], 11611, Members.from_parameters({"members": [ROBOT2], "strangers": "ignore"}))
    online, leaving = state
    heartbeat = Heartbeat(Kind.STATE, 11611, 1.0, Stamp(2000 if online else 0))
    checks = checks if leaving else 0
    core.peers.table[KEY] = Peer(KEY, NOW, NOW, heartbeat, CONTACT, online, rate=1.0, checks=checks)
    return core


def find_state(core):
    entry = core.peers.table.get(KEY)
    return REMOVED if entry is None else (entry.online, entry.is_leaving)


@pytest.mark.parametrize("state", LISTED)
@pytest.mark.parametrize("event", EVENTS)
def test_each_event_in_each_state(event, state):
    happen, *after = EVENTS[event]
    core = a_core(state)
    happen(core)
    assert find_state(core) == after[LISTED.index(state)]


@pytest.mark.parametrize(("state", "after"), [(LEAVING, ONLINE), (LEAVING_OFFLINE, OFFLINE)])
def test_the_last_check_after_a_leave_decides(state, after):
    for contact, left in ((CONTACT, after), (None, REMOVED), (CONTACT._replace(stamp=0.0), REMOVED)):
        core = a_core(state, checks=len(LEAVE_CHECKS))
        answer(contact)(core)
        assert find_state(core) == left


def test_checks_begin_again_with_the_next_leave():
    core = a_core(LEAVING, checks=2)
    entry = core.peers.table[KEY]
    hear(beat())(core)
    assert entry.checks == 0 and not entry.is_leaving
    hear(beat(Kind.LEAVE))(core)
    assert entry.checks == 1 and entry.is_leaving
