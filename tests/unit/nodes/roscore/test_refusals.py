# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Refusals of the roscore: counted, told at most every two seconds, and read where the roscore is followed."""

from rosfleet_multimaster.discovery.core.report import roscore
from rosfleet_multimaster.protocol.messages import OK
from rosfleet_multimaster.protocol.mirror import REFUSED, Mirror
from rosfleet_multimaster.roscore.core.bounds import BoundRefusal
from rosfleet_multimaster.roscore.core.registry import to_feed
from rosfleet_multimaster.roscore.refusals import Refusals

from tests.unit.nodes.roscore.records import rec


def test_the_counts_are_told_and_shown(caplog):
    told = []
    refusals = Refusals(told.append)
    refusals.tick(1.0)
    assert told == [] and refusals.records() == []
    for bound in ("depth", "depth", ""):
        refusals.add(BoundRefusal("too much\nof it", bound))
    refusals.tick(1.0)
    refusals.add(BoundRefusal("too much", "depth"))
    refusals.tick(2.0)
    assert told == [[rec("parameter", REFUSED, {"depth": 2, "value": 1})]]
    refusals.tick(3.1)
    assert refusals.records() == [rec("parameter", REFUSED, {"depth": 3, "value": 1})]
    mirror = Mirror("http://robot:11311/", "robot")
    mirror.take(False, to_feed(told[-1]))
    shown = roscore("http://robot:11311/", "", mirror.parameters[REFUSED])
    assert (
        shown.values[1:] == [("refused requests, depth", "3"), ("refused requests, value", "1")] and shown.level == OK
    )


def test_a_roscore_that_tells_none_has_none():
    assert roscore("http://robot:11311/", "", None).values == [("uri", "http://robot:11311/")]
