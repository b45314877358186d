# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What is registered."""

import fleets
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._judgement import content
from reports import make_report


def test_the_robots_of_a_document():
    one, two = make_report(fleets.plan()).document["robots"]
    assert (one["robot"], one["computers"], one["declares"], one["read"]) == ("kobuki1", [fleets.ONE], False, True)
    assert one["topics"] and not any(name.startswith(content.OWN_TOPICS) for name in one["topics"])
    assert one["takes"][0]["robot"] == "kobuki2" and set(one["takes"][0]["topics"]) <= set(two["topics"])
