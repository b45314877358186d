# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What is registered, and the difference to an earlier run."""

import copy

import fleets
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._report import content
from reported import reported


def test_the_robots_of_a_document():
    one, two = reported(fleets.plan()).document["robots"]
    assert (one["robot"], one["computers"], one["declares"], one["read"]) == ("kobuki1", [fleets.ONE], False, True)
    assert one["topics"] and not any(name.startswith(content.OWN_TOPICS) for name in one["topics"])
    assert one["takes"][0]["robot"] == "kobuki2" and set(one["takes"][0]["topics"]) <= set(two["topics"])


def test_nothing_is_different_where_nothing_is():
    document = reported(fleets.plan()).document
    assert content.differences(document, copy.deepcopy(document)) == []


def test_what_is_new_and_what_is_gone():
    now = reported(fleets.fig12(), fleets.wall).document
    before = reported(fleets.fig12()).document
    before["computers"].remove("tibi-nav")
    before["robots"][0]["topics"].append("/scan")
    told = content.differences(before, now)
    assert told[:2] == ["tibi-nav is new", "topics of tibi: /scan is gone"]
    assert told[2].startswith("new: a packet filter on tibi-visio")
    assert content.differences(before=now, now=before)[-1].startswith("no longer: a packet filter on tibi-visio")


def test_a_document_of_another_shape_has_no_difference():
    now = reported(fleets.plan()).document
    for before in ({}, {"computers": 3}, [], {"computers": [], "robots": [3], "findings": []}):
        assert content.differences(before, now) == []
