# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Senders that are ignored: asked twice, told of once."""

from mentioned import mentions
from rosfleet_multimaster.discovery.core.actions import ActionOutbox
from rosfleet_multimaster.discovery.core.outsiders import (
    AGAIN,
    FORGET,
    MAX_ASKED,
    MAX_OUTSIDERS,
    ConnectionBudget,
    Outsiders,
)
from rosfleet_multimaster.discovery.core.peer import FAR, Contact

ROGUE = Contact(1.0, "http://rogue:11311/", "rogue", "/master_discovery")
WHY = "it is no robot of the fleet"


def asked(outsiders, until, address="10.0.0.6", answer=None):
    """The times at which an outsider that is heard each second is asked."""
    times = []
    for now in range(until):
        outsiders.hear(address, 11611, float(now), True)
        for key in outsiders.due(float(now)):
            times.append(now)
            outsiders.take_answer(key, answer, WHY if answer else "", now + 0.5)
    return times


def test_who_says_its_name_is_asked_once_and_told_of_once():
    box = ActionOutbox(lambda address: False)
    outsiders = Outsiders(box)
    assert asked(outsiders, 1000, answer=ROGUE) == [0]
    (news,) = outsiders.list_ignored()
    assert mentions(str(news), "rogue", "http://rogue:11311/", "10.0.0.6", "multimaster_allow")
    assert [line.text for line in box.actions] == [str(news)]


def test_who_does_not_is_asked_twice_and_told_of_by_address():
    box = ActionOutbox(lambda address: False)
    outsiders = Outsiders(box)
    assert len(asked(outsiders, 1000)) == 2
    (line,) = box.actions
    assert mentions(line.text, "10.0.0.6", "heartbeats")


def test_who_may_not_be_asked_is_told_of_by_address_at_once():
    outsiders = Outsiders(ActionOutbox(lambda address: False))
    outsiders.hear("172.16.0.1", 22, 0.0, False)
    assert list(outsiders.due(0.0)) == [] and outsiders.next_due() == FAR
    assert [news.address for news in outsiders.list_ignored()] == ["172.16.0.1"]


def test_a_flood_does_not_win_more_questions_for_an_address():
    outsiders, tries = Outsiders(ActionOutbox(lambda address: False)), {}
    for step in range(4 * MAX_OUTSIDERS):
        address = f"10.0.{step % 512 // 256}.{step % 256}"
        outsiders.hear(address, 1024 + step, step / 100, True)
        for key in list(outsiders.due(step / 100)):
            tries[key[0]] = tries.get(key[0], 0) + 1
            outsiders.take_answer(key, None, "", step / 100)
    assert tries and max(tries.values()) <= 2
    assert len(outsiders.list_ignored()) <= MAX_OUTSIDERS


def test_few_are_asked_at_a_time():
    outsiders = Outsiders(ActionOutbox(lambda address: False))
    for number in range(50):
        outsiders.hear(f"10.0.0.{number}", 11611, 0.0, True)
    assert len(list(outsiders.due(0.0))) == MAX_ASKED and list(outsiders.due(1.0)) == []


def test_the_silent_are_forgotten():
    outsiders = Outsiders(ActionOutbox(lambda address: False))
    asked(outsiders, 3, answer=ROGUE)
    outsiders.forget(FORGET + 3.0)
    assert outsiders.list_ignored() == []


def test_two_more_connections_for_an_allowed_address():
    budget = ConnectionBudget()
    assert budget.free("a", 0.0) == 0.0
    budget.spend("a", 0.0)
    budget.spend("a", 5.0)
    assert budget.free("a", 6.0) == 5.0 + AGAIN and budget.free("b", 6.0) == 6.0
    budget.spend("a", 5.0 + AGAIN)
    assert budget.free("a", 6.0 + AGAIN) == 6.0 + AGAIN
    budget.refund("a")
    assert budget.free("a", 6.0 + AGAIN) == 6.0 + AGAIN
