# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The content of the report: its robots, and the registrations that cross."""

import fleets
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.registrations import RELAY
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    Exchange,
    NodeTraffic,
    RegisteredService,
    RegisteredTopic,
    SentTopic,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report import content
from reports import make_report


def test_the_robots_of_a_document():
    one, two = make_report(fleets.plan()).document["robots"]
    assert (one["robot"], one["computers"], one["declares"], one["read"]) == ("kobuki1", [fleets.ONE], False, True)
    assert one["topics"] and not any(name.startswith(content.OWN_TOPICS) for name in one["topics"])
    assert one["takes"][0]["robot"] == "kobuki2" and set(one["takes"][0]["topics"]) <= set(two["topics"])


def test_what_crosses_by_the_relay_is_given_and_taken():
    entry = {
        "topics": ["/scan"],
        "back": ["/cmd_vel"],
        "services": ["/reset"],
        "as": "/kobuki1",
        "to": ["kobuki2"],
    }
    commands = {"topics": ["/kobuki1/cmd_vel"], "to": ["kobuki1"]}

    def change(seen):
        own = (RegisteredTopic("/scan", "x/Scan", ("/laser",)), RegisteredTopic("/cmd_vel", "x/Twist", (RELAY,)))
        update = fleets.update
        update(seen[fleets.ONE].probe, exchange=Exchange(topics=own))
        there = (RegisteredTopic("/kobuki1/scan", "x/Scan", (RELAY,)), RegisteredTopic("/own", "x/Own", ("/own",)))
        service = (RegisteredService("/kobuki1/reset", RELAY),)
        update(seen[fleets.TWO].probe, exchange=Exchange(topics=there, services=service))

    plan = fleets.plan(exports={"kobuki1": [entry], "kobuki2": [commands]})
    one, two = make_report(plan, change).document["robots"]
    outer = {"topics": ["/kobuki1/scan"], "services": ["/kobuki1/reset"]}
    changed = {"/kobuki1/scan": "here /scan", "/kobuki1/reset": "here /reset"}
    assert one["gives"] == [{"to": ["kobuki2"], **outer, "changed": changed}]
    (back,) = two["gives"]  # and no row of /kobuki1/cmd_vel, which crosses by the relay alone
    assert (back["to"], back["topics"], back["services"]) == (["kobuki1"], ["/cmd_vel"], [])
    assert back["changed"]["/cmd_vel"].startswith("here /kobuki1/cmd_vel")
    html = make_report(plan, change).html
    assert "/kobuki1/scan (here /scan)" in html
    assert one["takes"] == [{"robot": "kobuki2", "topics": ["/cmd_vel"], "services": []}]
    assert two["takes"] == [{"robot": "kobuki1", "topics": ["/kobuki1/scan"], "services": ["/kobuki1/reset"]}]


def test_the_rate_of_a_topic_stands_beside_its_names():
    entries = {
        "kobuki1": [{"topics": ["/scan"], "as": "/kobuki1", "rate": 5, "newest": True, "to": ["kobuki2"]}],
        "kobuki2": [],
    }
    html = make_report(fleets.plan(exports=entries)).html
    assert "/kobuki1/scan (here /scan, at 5 messages/s, only the newest)" in html


def test_the_traffic_is_summed_by_topic_and_robot():
    def change(seen):
        flows = (
            SentTopic("/eye", "/image", "kobuki2", 2, 600.0, 6.0),
            SentTopic("/ear", "/sound", "kobuki2", 1, 900.0, 9.0),
            SentTopic("/eye2", "/image", "kobuki2", 1, 600.04, 6.0),
            SentTopic("/eye", "/image", "nobody", 1, 1e9, 1.0),
        )
        fleets.update(seen[fleets.ONE].probe, traffic=NodeTraffic(3.1, flows))
        fleets.update(
            seen[fleets.TWO].probe, traffic=NodeTraffic(2.9, (SentTopic("/eye", "/image", "kobuki1", 1, 5.0, 1.0),))
        )

    assert make_report(fleets.plan(), change).document["traffic"] == {
        "seconds": 3.1,
        "topics": [
            {
                **{"topic": "/image", "from": "kobuki1", "nodes": ["/eye", "/eye2"], "to": {"kobuki2": 3}},
                **{"messages_s": 12.0, "bytes_s": 1200.0},
            },
            {
                **{"topic": "/sound", "from": "kobuki1", "nodes": ["/ear"], "to": {"kobuki2": 1}},
                **{"messages_s": 9.0, "bytes_s": 900.0},
            },
            {
                **{"topic": "/image", "from": "kobuki2", "nodes": ["/eye"], "to": {"kobuki1": 1}},
                **{"messages_s": 1.0, "bytes_s": 5.0},
            },
        ],
    }


def test_no_traffic_where_nothing_crosses():
    assert make_report(fleets.plan()).document["traffic"] == {"seconds": 0.0, "topics": []}
