# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of a peer's life, as a whole. What the acts do is tested in test_discovery.py."""

import pytest
from rosfleet_multimaster.discovery.core.discovery import Discovery
from rosfleet_multimaster.discovery.core.life import LIFE, Life
from rosfleet_multimaster.discovery.core.peer import Peer, Sign, State
from rosfleet_multimaster.discovery.core.peers import News
from rosfleet_multimaster.protocol.heartbeat import Heartbeat, Kind
from rosfleet_multimaster.protocol.parameters import Settings

ONLINE = (State.ONLINE, State.LEAVING)
LISTED = (*ONLINE, State.OFFLINE, State.LEAVING_OFFLINE)
LEAVING = (State.LEAVING, State.LEAVING_OFFLINE)


def test_every_state_can_be_reached_and_left():
    assert set(LIFE) == set(State)
    reached = {after for signs in LIFE.values() for after, _act in signs.values()}
    assert reached == set(State)
    assert [state for state, signs in LIFE.items() if not signs] == [State.REMOVED]


@pytest.mark.parametrize("state", LISTED)
def test_a_listed_peer_takes_every_sign_that_can_come(state):
    can_come = set(Sign) - {Sign.NO_ROOM}
    can_come -= set() if state in LEAVING else {Sign.LAST_ANSWER, Sign.LAST_NO_ANSWER}
    can_come -= set() if state in ONLINE else {Sign.SILENCE}
    assert set(LIFE[state]) == can_come
    assert LIFE[state][Sign.HEARD][0] is State.ONLINE, "who is heard is there"
    assert LIFE[state][Sign.LONG_SILENCE] == (State.REMOVED, Life.drop)


@pytest.mark.parametrize("state", LEAVING)
def test_only_a_leaving_peer_is_removed_by_its_answer(state):
    removing = {sign for sign, (after, _act) in LIFE[state].items() if after is State.REMOVED}
    assert removing == {Sign.LAST_NO_ANSWER, Sign.REFUSAL, Sign.FOREIGN, Sign.LONG_SILENCE}


def test_checks_begin_again_with_the_next_leave():
    peer = Peer(("10.0.0.2", 11511, 11611), 0.0, 0.0, Heartbeat(Kind.STATE, 11611), state=State.LEAVING, checks=2)
    life = Discovery(Settings(), [], 11611).life
    assert peer.online and peer.is_leaving and LIFE[peer.state][Sign.HEARD][1] is None
    life.move(peer, Sign.HEARD, News(0.0))
    assert peer.checks == 0 and not peer.is_leaving
    with pytest.raises(KeyError):
        life.move(peer, Sign.LAST_ANSWER, News(0.0))
