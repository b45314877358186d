# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The use that master_sync makes of the news of discovery: messages of a topic, and lists."""

import pytest
from rosfleet_multimaster.sync import finder
from running_sync import Lab, until


@pytest.fixture(name="lab")
def _lab(monkeypatch, tmp_path):
    made = Lab(monkeypatch, tmp_path)
    made.other.fault = True  # its state cannot be had, so nothing but its news asks for a round
    yield made
    made.end()


def is_online(lab):
    """True if robot2 is online, as far as master_sync knows; None if master_sync does not know it."""
    remote = lab.program.core.remotes.get(lab.other.uri)
    return None if remote is None else remote.announced.online


def test_each_news_of_a_master_is_looked_at_for_a_loss(lab):
    seen = []
    lab.listed = []
    lab.start()
    until(lambda: lab.program.finder.listed_once)
    news = [True, False, True]

    def tell():  # in the loop, where the look after the list is over; and all in one pass
        lab.program.disconnector.look = lambda now: seen.append(is_online(lab))
        for online in news:
            lab.changed(lab.other.announced(online))

    lab.program.loop.post(tell)
    until(lambda: len(seen) >= len(news))
    assert seen[: len(news)] == news


def test_a_list_asked_for_before_the_news_does_not_undo_it(lab):
    def answer_late(_service):
        lab.changed(lab.other.announced(True))
        until(lambda: is_online(lab))
        return [lab.other.announced(False)]

    lab.list_masters = answer_late
    lab.start()
    until(lambda: lab.program.finder.listed_once)
    assert is_online(lab)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("before", "after", "asks"),
    [([], [True], False), ([True], [False], True), ([True], [], False)],
    ids=["comes", "goes", "missing"],
)
def test_a_list_asks_for_a_round_for_a_lost_master_alone(lab, monkeypatch, before, after, asks):
    monkeypatch.setattr(finder, "LIST", 0.1)
    lab.listed = [lab.other.announced(online) for online in before]
    lab.start()
    until(lambda: lab.program.finder.listed_once and not lab.program.rounds.working)
    rounds = []
    lab.program.loop.post(lambda: setattr(lab.program.rounds, "soon", rounds.append))
    lab.listed, asked = [lab.other.announced(online) for online in after], len(lab.asked_list)
    until(lambda: len(lab.asked_list) >= asked + 3)  # the second of these lists is known by then
    assert bool(rounds) is asks
    assert is_online(lab) is (after or before)[0]
