# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import pytest
from mentioned import mentions
from rosfleet_multimaster.protocol.messages import Registration, View
from rosfleet_multimaster.sync.core.message_types import AGAIN, TypeGuard
from rosfleet_multimaster.sync.core.sync import Candidate

R2, R3 = "http://robot2:11311/", "http://robot3:11311/"
TALKER = ("/talker", "http://robot2:40000/")
OWN = ("/listener", "http://robot1:30000/")
TOPIC = "/chatter"
STRING, INT = "std_msgs/String", "std_msgs/Int32"
CHATTER = Registration("publisher", TOPIC, *TALKER)
HEARD = Registration("subscriber", TOPIC, *TALKER)
STAMPS = {R2: 1.0, R3: 1.0}


def want(kind, item=CHATTER, master=R2):
    return Candidate(item, master, "robot2" if master == R2 else "robot3", kind)


def roscore(own="subscribers", held=(), kind=STRING):
    """An own node on the topic, and what is registered for others; `kind` is what the roscore calls the topic."""
    tables = {"publishers": {}, "subscribers": {}}
    uris = {}
    if own:
        tables[own][TOPIC] = [OWN[0]]
        uris[OWN[0]] = OWN[1]
    for item in held:
        tables[item.kind + "s"].setdefault(item.name, []).append(item.node)
        uris[item.node] = item.node_uri
    return View(tables["publishers"], tables["subscribers"], {}, {TOPIC: kind}, uris)


class Robot:
    """A guard whose questions are answered."""

    def __init__(self, own=STRING, here="1", there="1"):
        self.guard, self.own, self.here, self.there = TypeGuard(), own, here, there
        self.asked, self.now = [], 0.0

    def judge(self, wanted, view, claims=None, stamps=None, answer=True):
        verdict = self.guard.judge(wanted, view, claims or {}, stamps or STAMPS, self.now)
        self.asked += [*verdict.nodes, *verdict.masters.items()]
        for node in verdict.nodes if answer else ():
            self.guard.take_node_types(node, self.own and {TOPIC: self.own}, self.now)
        for master, types in verdict.masters.items() if answer else ():
            sums = dict.fromkeys(types, self.there) if self.there else None
            self.guard.take_md5sums(master, sums, dict.fromkeys(types, self.here), self.now)
        return verdict

    def settled(self, wanted, view, claims=None, stamps=None):
        verdict = self.judge(wanted, view, claims, stamps)
        while verdict.nodes or verdict.masters:
            verdict = self.judge(wanted, view, claims, stamps)
        return verdict


def test_a_topic_without_own_nodes_is_nobodys_business():
    robot = Robot()
    verdict = robot.judge([want(INT)], roscore(own=None))
    assert (verdict.wanted, verdict.refused, robot.asked) == ([want(INT)], [], [])


def test_a_shared_topic_is_registered_when_both_types_are_known():
    robot = Robot()
    view = roscore()
    assert robot.judge([want(STRING)], view, answer=False).wanted == []
    robot = Robot()
    assert robot.settled([want(STRING)], view).wanted == [want(STRING)]
    assert robot.asked == [OWN, (R2, {STRING})]


@pytest.mark.parametrize("own", ["publishers", "subscribers"])
@pytest.mark.parametrize("item", [CHATTER, HEARD])
def test_another_type_is_refused_with_both_types_and_nodes(own, item):
    verdict = Robot(own=STRING).settled([want(INT, item)], roscore(own))
    assert verdict.wanted == []
    (refusal,) = verdict.refused
    assert refusal == ("type", TOPIC, "robot2", "std_msgs/Int32 (of /talker)", "std_msgs/String (of /listener)")


def test_a_later_own_subscribers_type_is_known_too():
    view = roscore(held=[CHATTER], kind=INT)  # the roscore keeps what the import said
    verdict = Robot(own=STRING).settled([want(INT)], view, {TALKER: R2})
    assert verdict.wanted == [] and len(verdict.refused) == 1


def test_old_topics_of_the_roscore_are_not_the_nodes():
    first = Robot(own=INT).judge([want(INT)], roscore(kind=STRING), answer=False)
    assert (first.wanted, first.refused) == ([], [])
    verdict = Robot(own=INT).settled([want(INT)], roscore(kind=STRING))
    assert verdict.wanted == [want(INT)] and not verdict.refused


def test_another_md5_sum_is_refused_with_both():
    (refusal,) = Robot(here="aaa", there="bbb").settled([want(STRING)], roscore()).refused
    assert mentions(refusal.uri, "std_msgs/String", "md5", "bbb", "/talker")
    assert refusal.holder == 'std_msgs/String with "aaa" (of /listener)'


@pytest.mark.parametrize("robot", [Robot(there=None), Robot(here="")])
def test_a_master_without_md5_sums_or_types_is_skipped(robot):
    assert robot.settled([want(STRING)], roscore()).wanted == [want(STRING)]


def test_an_own_node_without_an_answer_is_asked_again_later():
    robot = Robot(own=None)
    assert robot.settled([want(STRING)], roscore()).wanted == [want(STRING)]
    assert robot.settled([want(INT)], roscore()).refused
    assert robot.asked == [OWN]  # and no class is imported for a type that no own node has named
    robot.now += AGAIN
    robot.judge([want(STRING)], roscore())
    assert robot.asked == [OWN] * 2


def test_only_the_conflicting_master_is_refused():
    other = want(STRING, Registration("publisher", TOPIC, "/other", "http://robot3:1/"), R3)
    verdict = Robot(own=STRING).settled([want(INT), other], roscore())
    assert verdict.wanted == [other]
    assert [refusal.master for refusal in verdict.refused] == ["robot2"]


def test_a_conflict_ends_by_itself():
    robot = Robot(own=STRING)
    assert robot.settled([want(INT)], roscore()).refused
    assert robot.settled([want(INT)], roscore(own=None)).wanted == [want(INT)]
    assert not robot.settled([want(STRING)], roscore()).refused


def test_what_is_registered_stays_while_it_is_asked_for():
    held = roscore(held=[CHATTER])
    assert Robot().judge([want(STRING)], held, {TALKER: R2}, answer=False).wanted == [want(STRING)]


def test_another_state_of_the_master_is_asked_without_a_wait():
    robot, view = Robot(), roscore()
    robot.settled([want(STRING)], view)
    robot.there = "2"
    assert robot.judge([want(STRING)], view, stamps={R2: 2.0}).wanted == [want(STRING)]
    assert len(robot.asked) == 3
    assert robot.settled([want(STRING)], view, stamps={R2: 2.0}).refused
    assert len(robot.asked) == 3


@pytest.mark.parametrize("kind", ["*", "", "None"])
def test_an_unknown_type_conflicts_with_nothing(kind):
    verdict = Robot().settled([want(kind, HEARD)], roscore())
    assert verdict.wanted and not verdict.refused
    assert Robot(own="*").settled([want(INT)], roscore(kind="*")).wanted


def test_services_have_no_type_here():
    service = Candidate(Registration("service", "/add", *TALKER, "rosrpc://robot2:1"), R2, "robot2")
    assert Robot().judge([service], roscore()).wanted == [service]


def test_a_topic_that_an_own_node_left_may_change_its_type():
    """rviz and the like: the node goes on and shares other topics meanwhile."""
    other = Registration("publisher", "/other", *TALKER)
    both, alone = roscore(), roscore(own=None)
    for view in (both, alone):
        view.subscribers["/other"] = [OWN[0]]
        view.node_uris[OWN[0]] = OWN[1]
    robot, everything = Robot(own=STRING), [want(INT), want("*", other), want(INT, other)]
    assert robot.settled(everything, both).refused
    assert not robot.settled(everything, alone).refused
    robot.own = INT
    verdict = robot.settled(everything, both)
    assert not verdict.refused and want(INT) in verdict.wanted


def test_a_type_that_changed_unseen_is_found_by_asking_again():
    robot = Robot(own=STRING)
    assert robot.settled([want(INT)], roscore()).refused
    robot.own = INT  # it left the topic and came back between two looks
    robot.now += AGAIN
    assert robot.settled([want(INT)], roscore()).wanted == [want(INT)]


def test_any_type_subscribers_contradict_no_type():
    """rosbag: the roscore keeps the type of an import for ever, so this would never end."""
    assert Robot(own="*").settled([want(INT)], roscore(kind=STRING)).wanted == [want(INT)]
