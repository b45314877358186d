# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The links as people are shown them: losses, questions for the time, and who is missing."""

import math

import pytest
from fleet_of_one import ROUTER, TIBI, URI
from rosfleet_multimaster.discovery.core.health import ANY, EACH, MOST, NAME, ClockAnswer, Health, LinkList, read_answer
from rosfleet_multimaster.protocol.members import Members
from rosfleet_multimaster.protocol.messages import AnnouncedMaster, LinkQuality

OWN = "http://own:11311/"


def master(number=1, online=True, uri="", name=""):
    return AnnouncedMaster(
        name or f"robot{number}",
        uri or f"http://robot{number}:11311/",
        f"http://10.0.0.{number}:1",
        "/d",
        1.0,
        1.0,
        online,
    )


def health(members=()):
    return Health(OWN, Members.from_parameters({"members": list(members)}))


def test_each_loss_is_counted_when_the_master_is_removed_too():
    seen = health()
    seen.take_event("new", None, master())
    for before, now in ((True, False), (False, True), (True, False), (False, False)):
        seen.take_event("changed", master(online=before), master(online=now))
    (link,) = seen.links([master(online=False)], []).links
    assert (link.losses, link.online, link.silent, link.quality) == (2, False, None, -1.0)
    seen.take_event("removed", master(), master(online=False))
    assert seen.links([master()], []).links[0].losses == 0, "who belongs to nobody is forgotten"


def test_losses_of_a_robot_stay_while_it_is_gone():
    seen = health([TIBI])
    seen.take_event("removed", master(uri=URI), master(uri=URI, online=False))
    (link,) = seen.links([], []).links
    assert (link.name, link.online, link.losses) == ("tibi-visio", False, 1)


def test_missing_robots_are_listed_without_master_and_router():
    own = {**TIBI, "robot": "own", "name": "own", "uris": [OWN.upper()]}
    shown = health([TIBI, own, ROUTER]).links([master(uri=OWN), master(uri=URI, name="tibi-visio")], [])
    assert [(link.name, link.online) for link in shown.links] == [("tibi-visio", True)]
    shown = health([TIBI, own, ROUTER]).links([master(uri=OWN)], [])
    assert [(link.name, link.online) for link in shown.links] == [("tibi-visio", False)]


def test_of_two_addresses_of_a_robot_the_better_one_counts():
    links = [LinkQuality("robot1", 20.0, 3.0, master().uri), LinkQuality("robot1", 90.0, 0.5, master().uri)]
    (link,) = health().links([master()], links).links
    assert (link.quality, link.silent) == (90.0, 0.5)


def test_a_flood_of_masters_is_bounded_and_the_fleet_is_first():
    flood = [master(number, name=f"{'x' * 2000}{number}") for number in range(50)]
    flood += [master(number) for number in range(1000, 1500)]
    shown = health([TIBI]).links(flood, [])
    names = {"tibi-visio", *(f'"{one.name[: NAME - 2]}' for one in flood)}  # the long names are one, cut
    assert len(shown.links) == MOST and shown.left_out == len(names) - MOST
    assert shown.links[0].name == "tibi-visio" and max(len(link.name) for link in shown.links) <= NAME
    assert len({link.name for link in shown.links}) == MOST


def test_a_second_master_of_a_name_is_not_one_too_many():
    shown = health().links([master(1), master(2, name="robot1")], [])
    assert [link.uri for link in shown.links] == [master(1).uri] and shown.left_out == 0


def test_masters_are_asked_in_turns_and_none_too_often():
    seen, masters, asked = health(), [master(0, uri=OWN), master(1), master(2), master(3, online=False)], []
    for now in range(300):
        chosen = seen.question(masters, float(now))
        if chosen is not None:
            asked.append((now, chosen.name))
    assert [name for _now, name in asked[:4]] == ["robot1", "robot2"] * 2
    assert all(later - now >= ANY for (now, _one), (later, _other) in zip(asked, asked[1:]))
    of_one = [now for now, name in asked if name == "robot1"]
    assert all(later - now >= EACH for now, later in zip(of_one, of_one[1:])) and len(of_one) == 300 // EACH


def test_a_hundred_masters_cost_no_more_questions_than_ten():
    seen, masters = health(), [master(number) for number in range(100)]
    asked = [seen.question(masters, float(now)) for now in range(1000)]
    names = [found.name for found in asked if found is not None]
    assert len(names) == 1000 / ANY and len(set(names)) == 100


def test_an_answer_is_kept_until_the_master_is_lost():
    seen, answer = health(), ClockAnswer(0.002, 0.3)
    seen.question([master()], 0.0)
    seen.take_answer(master().uri, answer)
    seen.take_answer("http://never.asked/", answer)
    assert seen.links([master()], []).links[0].answer == answer
    seen.take_event("changed", master(), master(online=False))
    assert seen.links([master()], []).links[0].answer is None


def test_the_offset_is_seen_from_the_middle_of_the_answer():
    assert read_answer(["http://x/", 101.5], 100.0, 1.0) == ClockAnswer(1.0, 1.0)
    assert ClockAnswer(0.2, -0.25).surely_apart == pytest.approx(0.15) and ClockAnswer(0.2, 0.05).surely_apart == 0.0


@pytest.mark.parametrize(
    "value", [None, [], ["x"], ["x", 1], ["x", "1.0"], ["x", math.nan], ["x", math.inf], ["x", -1.0], ["x", 1e300], 5.0]
)
def test_an_answer_that_is_no_time_is_refused(value):
    with pytest.raises(ValueError, match="time"):
        read_answer(value, 0.0, 0.1)


def test_nothing_is_shown_without_others():
    assert health().links([master(uri=OWN)], [LinkQuality("own", 100.0, 0.1, OWN)]) == LinkList([])
