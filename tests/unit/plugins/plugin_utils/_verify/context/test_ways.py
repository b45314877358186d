# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Ways and masters: faults of a roscore on a sealed computer are told of that computer."""

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import Component
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.needs import make_components
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.ways import Ways
from fleets import COMPANION, ONE, SEALED, plan, sealed
from mentioned import mentions


def test_faults_of_a_sealed_roscore_are_of_its_computer():
    ways = Ways(sealed())
    assert ways.seal(make_components("roscore", COMPANION, "dead", "hung")) == {Component("roscore", SEALED, "sealed")}
    others = make_components("roscore", ONE, "dead") | make_components("sync", COMPANION, "dead")
    assert ways.seal(others) == others
    (named,) = ways.seal(make_components("roscore", COMPANION, "name", what="http://localhost:11311/"))
    assert mentions(named.sentence(), "hsrb", "http://localhost:11311/")


def test_faults_stay_where_nothing_is_sealed():
    dead = make_components("roscore", ONE, "dead")
    assert Ways(plan()).seal(dead) is dead
