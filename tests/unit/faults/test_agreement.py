# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The prediction is compared with what was measured, way by way."""

from agreement import agreement
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import Rule
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.plan_world import make_world
from worlds import change, fig12, info_of

PLAN = fig12()
ADDRESS = {member.name: str(member.address) for member in PLAN.members}


def recorded(world, ping=True, large=True, heard=True, means="", calls_itself="dabo-nav"):
    """tibi-nav has measured dabo-nav."""
    member = {"name": "dabo-nav", "address": ADDRESS["dabo-nav"], "addresses": [means or ADDRESS["dabo-nav"]]}
    member.update(ping_address={"ok": ping}, ping_large={"ok": large} if ping else None)
    topic = {"computer": "dabo-nav", "heard": heard, "publishers": [{"uri": f"http://{calls_itself}:40000/"}]}
    results = {name: {"verify_started": {"machine": info_of(world.machines[name])}} for name in PLAN.computers}
    results["tibi-nav"].update(verify_probe={"members": [member], "topics": [topic]})
    return {"fleet": to_plain(PLAN), "registered": results}


def test_what_was_measured_is_compared():
    world = make_world(PLAN)
    assert (agreement(recorded(world)).ways, agreement(recorded(world)).wrong) == (3, ())
    (wrong,) = agreement(recorded(world, heard=False)).wrong
    assert wrong == (("connections of nodes", "tibi-nav", "dabo-nav"), "reaches")


def test_a_fault_that_is_read_is_predicted():
    dropped = change(make_world(PLAN), "dabo-nav", rules=(Rule("in", "drop", "icmp"),))
    assert agreement(recorded(dropped, ping=False)).share == 1
    assert agreement(recorded(dropped)).wrong[0] == (("ping", "tibi-nav", "dabo-nav"), "fails")


def test_a_topic_tells_nothing_where_it_was_sought_elsewhere():
    assert agreement(recorded(make_world(PLAN), heard=False, means="192.168.10.77")).ways == 2
    assert agreement(recorded(make_world(PLAN), heard=False, calls_itself="localhost")).ways == 2


def test_nothing_measured_is_nothing_wrong():
    assert agreement({"fleet": to_plain(PLAN), "registered": {}}).share == 1
