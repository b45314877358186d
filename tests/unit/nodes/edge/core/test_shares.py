# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Shares: what is kept for a party is there, whatever the others take and give back."""

from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.edge.core.shares import Shares

PARTIES = ("own", "one", "two", "three", "")
DEEDS = st.lists(st.tuples(st.sampled_from(PARTIES), st.integers(1, 30), st.booleans()), max_size=200)


@given(DEEDS)
def test_whatever_others_take_each_has_what_is_kept_for_it(deeds):
    shares, had = Shares(100, 40, PARTIES, "own"), dict.fromkeys(PARTIES, 0)
    for party, number, comes in deeds:
        if not comes and had[party] >= number:
            shares.remove(party, number)
            had[party] -= number
        elif comes and shares.have_room(party, number):
            shares.add(party, number)
            had[party] += number
        assert sum(had.values()) <= 100 and {party: shares.count(party) for party in PARTIES} == had
        assert all(had[party] <= 40 for party in PARTIES if party != "own")
        assert all(shares.have_room(party, 6 - had[party]) for party in PARTIES if party != "own" and had[party] < 6)
        assert had["own"] >= 25 or shares.have_room("own", 25 - had["own"])
    for party, number in had.items():
        shares.remove(party, number)
    assert shares.have_room("own", 75) and not shares.have_room("own", 77)


def test_very_many_parties_have_one_each():
    names = [f"robot{number}" for number in range(500)]
    shares = Shares(100, 10, names)
    for name in names:
        assert shares.have_room(name)
        shares.add(name)
        assert not shares.have_room(name)


def test_without_parties_each_has_the_most_of_one():
    shares = Shares(100, 8, (), "own")
    for _number in range(8):
        assert shares.have_room("10.0.0.1")
        shares.add("10.0.0.1")
    assert not shares.have_room("10.0.0.1") and shares.have_room("10.0.0.2")
