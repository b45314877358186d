# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The check of the relay: each topic that is to cross is there, and no other one."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    CrossingTopic,
    Exchange,
    NodeParameters,
    ParameterDifference,
    RegisteredTopic,
    SeenRelay,
    ServiceState,
    SilentNode,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from fleets import diagnosed, plan, update
from mentioned import mentions

ROBOT, STATION = "kobuki1computer", "kobuki2computer"
SCAN, DRIVE = "sensor_msgs/LaserScan", "geometry_msgs/Twist"
EXPORTS = {
    "kobuki1": [{"topics": ["/scan"], "back": ["/cmd_vel"], "as": "/kobuki1"}],
    "kobuki2": [{"topics": ["/kobuki1/cmd_vel"]}],
}


def tell(robot=(), station=()):
    """The diagnosis, with what is published besides: (topic, type, node) of each."""

    def seen_so(seen):
        for name, published in ((ROBOT, robot), (STATION, station)):
            topics = tuple(RegisteredTopic(topic, kind, (node,)) for topic, kind, node in published)
            update(seen[name].probe, exchange=Exchange(topics=topics))

    return diagnosed(seen_so, plan(2, exports=EXPORTS))


CROSSED = {
    "robot": [("/scan", SCAN, "/laser"), ("/cmd_vel", DRIVE, "/master_relay")],
    "station": [("/kobuki1/scan", SCAN, "/master_relay"), ("/kobuki1/cmd_vel", DRIVE, "/joystick")],
}


def test_what_has_crossed_is_well():
    assert not tell(**CROSSED).findings


@pytest.mark.parametrize(("side", "number", "lacking"), [("station", 0, "/kobuki1/scan"), ("robot", 1, "/cmd_vel")])
def test_what_is_not_there_is_one_finding(side, number, lacking):
    changed = {**CROSSED, side: [row for row in CROSSED[side] if row is not CROSSED[side][number]]}
    (finding,) = tell(**changed).findings
    assert (finding.component.kind, finding.component.mode) == ("relay", "lacking") and lacking in finding.sentence()


def test_what_is_published_the_wrong_way_is_not_due():
    assert not tell(robot=CROSSED["robot"], station=[*CROSSED["station"], ("/kobuki1/scan", SCAN, "/player")]).findings


def test_what_the_relay_says_of_the_frames_is_due():
    entry = {"topics": ["/tf", "/tf_static"], "frames": "kobuki1/"}
    kind = "tf2_msgs/TFMessage"

    def tell_tree(*station):
        def seen_so(seen):
            own = (RegisteredTopic("/tf", kind, ("/base",)),)
            update(seen[ROBOT].probe, exchange=Exchange(topics=own))
            topics = tuple(RegisteredTopic(topic, kind, ("/master_relay",)) for topic in station)
            update(seen[STATION].probe, exchange=Exchange(topics=topics))

        exports = {"kobuki1": [entry], "kobuki2": []}
        return diagnosed(seen_so, plan(2, exports=exports, multimaster_frames={"world": "map"}))

    assert not tell_tree("/tf", "/tf_static").findings
    (finding,) = tell_tree("/tf").findings
    assert "/tf_static" in finding.sentence()


def test_the_nodes_of_the_verification_itself_are_left_out():
    entry = {"topics": ["/*"], "as": "/kobuki1"}

    def seen_so(seen):
        test = "/multimaster_verify_talker"
        own = (RegisteredTopic("/scan", SCAN, ("/laser",)), RegisteredTopic("/multimaster_verify/a", SCAN, (test,)))
        update(seen[ROBOT].probe, exchange=Exchange(topics=own))
        there = tuple(RegisteredTopic("/kobuki1" + topic.name, SCAN, ("/master_relay",)) for topic in own)
        update(seen[STATION].probe, exchange=Exchange(topics=there))

    assert not diagnosed(seen_so, plan(2, exports={"kobuki1": [entry], "kobuki2": []})).findings


def test_what_nobody_publishes_is_one_finding():
    (finding,) = tell(robot=CROSSED["robot"][1:], station=CROSSED["station"]).findings
    assert (finding.component.kind, finding.component.mode) == (
        "relay",
        "lacking",
    ) and "/kobuki1/scan" in finding.sentence()


def tell_with(change, **crossed):
    """The diagnosis with what is published, and a change of the observations of both computers."""

    def seen_so(seen):
        for name, published in ((ROBOT, crossed["robot"]), (STATION, crossed["station"])):
            topics = tuple(RegisteredTopic(topic, kind, (node,)) for topic, kind, node in published)
            update(seen[name].probe, exchange=Exchange(topics=topics))
        change(seen)

    return diagnosed(seen_so, plan(2, exports=EXPORTS))


LACKING = {**CROSSED, "station": CROSSED["station"][1:]}
UNIT = "multimaster-relay.service"


@pytest.mark.parametrize(
    ("state", "mode"),
    [
        (ServiceState("relay", UNIT, active_state="inactive", sub_state="dead"), "down"),
        (ServiceState("relay", UNIT, load_state="not-found", active_state="inactive", sub_state="dead"), "missing"),
        (ServiceState("relay", UNIT, active_state="active", stopped=True), "stopped"),
    ],
)
def test_a_relay_that_does_not_run_is_the_only_finding(state, mode):
    def change(seen):
        probe = seen[ROBOT].probe
        update(probe, services=(*(one for one in probe.services if one.name != "relay"), state))
        if state.stopped:
            silent = (SilentNode("/master_relay", ROBOT, "timed out", Outcome.NO_ANSWER, Outcome.OPEN),)
            update(probe.exchange, silent=("/master_relay",), silences=silent)

    (finding,) = tell_with(change, **LACKING).findings
    assert (finding.component.kind, finding.component.place, finding.component.mode) == ("service", ROBOT, mode)
    assert "cleanup" not in str(finding.do)


def test_a_relay_with_other_channels_than_planned_is_named_at_its_computer():
    def change(seen):
        differing = (ParameterDifference("master_relay", "channels", "['/scan']", "[]"),)
        update(seen[ROBOT].probe, parameters=NodeParameters(("master_relay",), differing))

    (finding,) = tell_with(change, **LACKING).findings
    assert (finding.component.kind, finding.component.place, finding.component.mode) == (
        "relay",
        ROBOT,
        "configuration",
    )
    assert {row.check for row in finding.proof} == {"parameters", "relay"}


def test_a_topic_with_another_type_on_the_other_side_is_named():
    crossed = {**CROSSED, "robot": [CROSSED["robot"][0], ("/cmd_vel", "geometry_msgs/TwistStamped", "/base")]}
    told = tell(**{**crossed, "robot": [*crossed["robot"], ("/x", DRIVE, "/master_relay")]})
    found = [one for one in told.findings if one.component.kind == "messages"]
    assert len(found) == 1 and "/kobuki1/cmd_vel" in found[0].sentence() and "TwistStamped" in found[0].sentence()


@pytest.mark.parametrize(
    ("row", "component"),
    [
        (
            SeenRelay("kobuki1", outcome=Outcome.ANSWERED, data_port=40811, data_outcome=Outcome.NO_ANSWER),
            ("node", "fenced"),
        ),
        (
            SeenRelay("kobuki1", outcome=Outcome.REFUSED, data_port=0, data_outcome=Outcome.NOT_TRIED),
            ("service", "down"),
        ),
    ],
)
def test_a_relay_whose_data_does_not_cross_is_named_also_if_all_is_registered(row, component):
    (finding,) = tell_with(lambda seen: update(seen[STATION].probe, relays=(row,)), **CROSSED).findings
    assert (finding.component.kind, finding.component.mode, finding.component.place) == (*component, ROBOT)
    (finding,) = tell_with(lambda seen: update(seen[STATION].probe, relays=(row,)), **LACKING).findings
    assert (finding.component.kind, finding.component.mode, finding.component.place) == (*component, ROBOT)


def test_a_relay_that_is_reached_is_well():
    row = SeenRelay("kobuki1", outcome=Outcome.ANSWERED, data_port=40811, data_outcome=Outcome.OPEN)
    assert not tell_with(lambda seen: update(seen[STATION].probe, relays=(row,)), **CROSSED).findings


def hear(silences=(), **values):
    """The findings where a topic of the robot was not heard at the station."""
    unheard = {"outcome": Outcome.NO_ANSWER, "message": False, "error": "no header", **values}
    crossing = (CrossingTopic("/kobuki1/scan", nodes=("/laser",), **unheard),)
    row = SeenRelay("kobuki1", outcome=Outcome.ANSWERED, data_outcome=Outcome.OPEN, crossing=crossing)

    def change(seen):
        update(seen[STATION].probe, relays=(row,))
        names = tuple(one.node for one in silences)
        update(seen[ROBOT].probe.exchange, silent=names, silences=silences)

    return tell_with(change, **CROSSED).findings


def test_data_that_does_not_come_through_both_relays_is_named_at_the_one_that_loses_it():
    (finding,) = hear(there=Outcome.ANSWERED)
    assert (finding.component.kind, finding.component.mode, finding.component.place) == ("relay", "mute", STATION)
    assert "/kobuki1/scan" in finding.sentence() and finding.do
    (finding,) = hear(there=Outcome.NO_ANSWER)
    assert {one.place for one in finding.candidates if one.kind == "relay"} >= {ROBOT} and finding.sure == "inferred"


def test_a_node_that_subscribes_another_type_than_the_other_robot_sends_is_named():
    (finding,) = hear(outcome=Outcome.ANSWERED, message=True, error="", unlike=("/viewer",))
    assert (finding.component.kind, finding.component.mode) == ("messages", "differ")
    assert mentions(finding.sentence(), "/scan of kobuki1", "/kobuki1/scan of kobuki2", "/viewer")
    assert "/kobuki1/scan of kobuki1" not in finding.sentence()
    assert finding.look[0].text == f"rostopic type /scan; rostopic type /kobuki1/scan; rosmsg md5 {SCAN}"


def test_data_that_crosses_or_whose_publisher_is_silent_is_no_fault_of_a_relay():
    assert not hear(outcome=Outcome.ANSWERED)
    found = hear(silences=(SilentNode("/laser", ROBOT, outcome=Outcome.REFUSED),))
    assert [(one.component.kind, one.component.mode) for one in found] == [("registration", "ghost")]
