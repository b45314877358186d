# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of ROS between two computers: a subscriber of the one hears a talker of the other."""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.case import Case
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import (
    FAILED,
    MEMBER,
    OK,
    UNKNOWN,
    Cause,
    Check,
    Documented,
    Judgement,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.exchange import Item
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.uris import host_of, on_loopback

TALKER_TYPE, TALKER_NODE = "std_msgs/String", "/multimaster_verify_talker_"


# A topic is heard


def _left_out(case: Case) -> bool:
    return case.topic is not None and _filtered(case, case.topic.topic)


def _talker_ended(case: Case) -> bool:
    talker = case.peer.seen.probe.talker if case.peer and case.peer.seen.probe else None
    return talker is not None and not talker.running


def _listener_failed(case: Case) -> bool:
    return case.topic is not None and case.topic.error.startswith("the listener")


def _not_registered_at_home(case: Case) -> bool:
    return _not_registered(case) and case.planned is not None and case.planned.robot == case.observer.plan.robot


def _only_the_master(case: Case) -> bool:
    """A talker on the computer of the target's roscore is heard; one on the robot's second computers is not even known."""
    its_master = case.masters[1]
    of_master = case.observer.topics.get(its_master)
    return _not_registered(case) and case.target != its_master and of_master is not None and of_master.heard


def _not_registered(case: Case) -> bool:
    return case.topic is None or not case.topic.publishers


def _topic_heard(case: Case) -> Judgement | None:
    target = case.peer
    if case.probe is None or target is None or case.observer.without_ros or _declared_away(case):
        return None
    entry = case.topic
    if entry is None:
        # A talker that never was is no fault of this pair.
        silent = target.seen.unreachable or (target.seen.probe is not None and target.without_ros)
        return None if silent else Judgement(FAILED, "its message", "not listened to")
    expected = f"a message on {entry.topic}"
    if entry.heard:
        return Judgement(OK, expected, "heard")
    if _filtered(case, entry.topic):
        return Judgement(UNKNOWN, expected, "the topic is left out by multimaster_filters")
    return Judgement(FAILED, expected, entry.error or "nothing")


def _declared_away(case: Case) -> bool:
    """The target's robot declares that it gives the observer's nothing."""
    own, its = case.robots
    return own != its and case.exchanges.flows.declared_away(its, own)


def _filtered(case: Case, topic: str) -> bool:
    """The filters between the two robots leave the topic out."""
    own, its = case.robots
    talker = Item("publisher", topic, TALKER_NODE + topic.rpartition("/")[2])
    return own != its and not case.exchanges.flows.rules(its, own).passes(talker, TALKER_TYPE)


TOPIC_HEARD = Check(
    id="topic_heard",
    title="subscriber hears the other's talker",
    scope=MEMBER,
    judge=_topic_heard,
    documented=Documented(
        "pair", "a subscriber hears what the talker of that computer says in this run", "3.3, 4.3, Fig. 9"
    ),
    explained_by=(
        "target:reachable",
        "target:measured",
        "observer:services",
        "master:services",
        "target:services",
        "its master:services",
        "observer:master_uri",
        "target:master_uri",
        "to its master:list_masters",
        "between masters:list_masters",
        "name",
        "back:name",
        "ping_address",
    ),
    causes=(
        Cause(
            "multimaster_filters of the robot of {observer} leave the test topic out",
            "nothing, if that is wanted; to have it tested, ignore less than everything",
            when=_left_out,
        ),
        Cause(
            "the talker on {target} does not run, so rostopic pub fails there, or verify_lifetime was too short",
            "see on {target}: journalctl -u multimaster-verify-talker; with many computers raise verify_lifetime",
            when=_talker_ended,
        ),
        Cause(
            "the subscriber on {observer} gave no result: the computer is overloaded, or rospy fails there",
            "try on {observer}: rostopic echo /rosout; with many computers raise verify_patience",
            when=_listener_failed,
        ),
        Cause(
            "the talker on {target} has not registered with the roscore on {master}",
            "see on {target}: journalctl -u multimaster-verify-talker; rosnode list",
            when=_not_registered_at_home,
        ),
        Cause(
            "{master} takes over the topics of {its_master}, but not those of {target}: its sync node, or the discovery node "
            "of {its_master}, leaves nodes of a robot's second computers out, as upstream's do unless told otherwise",
            "run site.yml, which installs the collection's nodes; with upstream's, set sync_remote_nodes to true",
            when=_only_the_master,
        ),
        Cause(
            "the sync node on {master} has not registered the topics of {target}",
            "see on {master}: journalctl -b -u multimaster-sync; rosservice call /master_sync/get_sync_info",
            when=_not_registered,
        ),
        Cause(
            "the topic is known, but no connection to its publisher opens: a firewall drops the TCP ports of nodes",
            "allow all TCP ports above 1024 between {observer} and {target}, in both directions",
        ),
    ),
)


# The connection is direct


def _publisher_on_loopback(case: Case) -> bool:
    return case.topic is not None and any(on_loopback(publisher.uri) for publisher in case.topic.publishers)


def _direct_connection(case: Case) -> Judgement | None:
    if case.topic is None or not case.topic.publishers:
        return None
    publishers = case.topic.publishers
    names = {case.target.lower(), str(case.address), *case.ways.names.get(case.address, ())}
    good = all(host_of(publisher.uri) in names for publisher in publishers)
    found = ", ".join(publisher.uri or f"{publisher.node} without a URI" for publisher in publishers)
    return Judgement(OK if good else FAILED, f"the publisher is on {case.target}", found)


DIRECT_CONNECTION = Check(
    id="direct_connection",
    title="rostopic info shows a direct connection",
    scope=MEMBER,
    judge=_direct_connection,
    documented=Documented("pair", "the publisher in `rostopic info` is a node on that computer", "3.3"),
    causes=(
        Cause(
            "nodes of {target} call themselves localhost",
            "run site.yml on {target}, and remove ROS_HOSTNAME=localhost from its shells' files",
            when=_publisher_on_loopback,
        ),
        Cause(
            "the publisher runs elsewhere, or calls itself otherwise than planned",
            "run site.yml on {target}, so that its nodes have the collection's ROS_HOSTNAME or ROS_IP",
        ),
    ),
)


# In the order in which one failure can explain the next.
CHECKS = (
    TOPIC_HEARD,
    DIRECT_CONNECTION,
)
