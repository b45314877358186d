# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The room for the states of all other masters: whoever fills it, each robot of the fleet has its part."""

from rosfleet_multimaster.protocol.members import MemberRobot, Members
from rosfleet_multimaster.sync.state_room import ALL, MOST_FOLLOWED, StateRoom


def uri(name):
    return f"http://{name}:11311/"


def make(count, most=ALL):
    robots = [f"robot{number}" for number in range(count)]
    none = frozenset()
    return StateRoom(
        Members(MemberRobot(name, name, frozenset({uri(name).rstrip("/")}), 0, none, none, none) for name in robots),
        most,
    )


def fill(room, names, size):
    """Hold a state of each of these masters, as far as there is room."""
    return [name for name in names if room.hold(uri(name), min(size, room.find(uri(name))))]


def test_many_strangers_leave_each_robot_its_part():
    room = make(20)
    fill(room, [f"stranger{number}" for number in range(1000)], MOST_FOLLOWED)
    for number in range(20):
        assert room.find(uri(f"robot{number}")) == ALL // 2 // 20
        assert room.hold(uri(f"robot{number}"), ALL // 2 // 20)
    assert room.find(uri("late")) == 0 and not room.hold(uri("late"), 1)


def test_all_together_are_bounded_and_what_is_gone_is_given_back():
    room = make(2, 1000)
    masters = ["robot0", "robot1", *(f"stranger{number}" for number in range(9))]
    for _round in range(3):
        fill(room, masters, 400)
        assert sum(room._held.values()) <= 1000
    assert not room.hold(uri("stranger0"), 5000) and room._held[uri("stranger0")] == 200, "the one before counts"
    room.keep({uri("robot0")})
    assert set(room._held) == {uri("robot0")} and room.find(uri("stranger1")) == 350


def test_a_fleet_of_twenty_large_robots_is_taken_whole():
    room = make(20)
    assert len(fill(room, [f"robot{number}" for number in range(20)], 5000)) == 20
    assert set(room._held.values()) == {5000}
