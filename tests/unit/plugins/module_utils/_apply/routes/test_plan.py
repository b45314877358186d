# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The plan for the kernel's routes: changes, undo, record and results. Pure."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes import plan as routes_plan
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.plan import RouteEntry
from planned_routes import held, route

INTERFACES = {"lo", "eth0", "eth1", "eth2", "wlan0"}


def holding(*texts):
    current = {}
    for text in texts:
        found = held(text, 6 if ":" in text else 4)
        current.setdefault(found.route.key, []).append(found)
    return current


def planned(routes, current=None, entries=None, replace=False):
    return routes_plan.plan_routes(routes, current or {}, entries or {}, replace, INTERFACES)


def commands(changes):
    return [" ".join([change.verb, *change.words]) for change in changes]


def test_a_new_route_a_right_one_and_another_way():
    wanted = route("0.0.0.0/0", "192.168.11.101")
    new = planned([wanted])
    assert commands(new.changes) == ["replace default via 192.168.11.101 dev eth0 proto static"]
    assert [r.state for r in new.results] == ["changed"]
    assert new.final == {wanted.key: RouteEntry((wanted,), ())}

    current = holding("unicast default via 192.168.11.101 dev eth0 proto static scope global")
    ours = planned([wanted], current, new.final)
    assert ours.changes == []
    assert ours.final == new.final

    moved = wanted._replace(gateway="192.168.11.102")
    other = planned([moved], current, new.final)
    assert commands(other.changes) == ["replace default via 192.168.11.102 dev eth0 proto static"]
    assert commands(other.undo) == ["replace default via 192.168.11.101 dev eth0 proto static"]
    assert other.interim[wanted.key].made == (wanted, moved)
    assert other.final[wanted.key].made == (moved,)


@pytest.mark.parametrize("change", [{"metric": 7}, {"table": 100}])
def test_a_moved_routes_new_entry_comes_before_the_old_goes(change):
    old, new = route("10.1.0.0/16", "192.168.11.1"), route("10.1.0.0/16", "192.168.11.1")._replace(**change)
    current = holding("unicast 10.1.0.0/16 via 192.168.11.1 dev eth0 proto static scope global")
    plan = planned([new], current, {old.key: RouteEntry((old,), ())})
    assert [change.verb for change in plan.changes] == ["replace", "del"]
    assert [change.verb for change in plan.undo] == ["replace", "del"]
    assert [t["state"] for t in plan.taken_back] == ["removed"]


def test_a_foreign_route_that_is_right_is_adopted_and_stays():
    wanted = route("0.0.0.0/0", "192.168.11.101")
    current = holding("unicast default via 192.168.11.101 dev eth0 proto boot scope global onlink mtu 1400")
    plan = planned([wanted], current)
    assert (plan.changes, plan.final, plan.results[0].state) == ([], {}, "ok")
    assert planned([], current, plan.final).changes == []


def test_a_foreign_route_in_its_place_conflicts_or_comes_back():
    wanted = route("0.0.0.0/0", "192.168.11.101")
    current = holding("unicast default via 192.168.11.1 dev eth0 proto boot scope global mtu 1400")
    refused = planned([wanted], current)
    assert refused.results[0].state == "conflict"
    assert '"default via 192.168.11.1 dev eth0 proto boot mtu 1400"' in refused.results[0].problem

    plan = planned([wanted], current, replace=True)
    assert plan.results[0].state == "changed"
    after = holding("unicast default via 192.168.11.101 dev eth0 proto static scope global")
    back = planned([], after, plan.final)
    assert commands(back.changes) == [
        "replace default via 192.168.11.1 dev eth0 proto boot mtu 1400",
        "del default via 192.168.11.101 dev eth0 proto static",  # there still, where the other could not be given back
    ]
    assert back.taken_back[0]["state"] == "restored"
    assert back.final == {}


def test_a_route_whose_interface_is_gone_does_not_come_back():
    wanted = route("0.0.0.0/0", "192.168.11.101")
    entry = RouteEntry((wanted,), (("default", "via", "10.9.0.1", "dev", "usb0"),))
    current = holding("unicast default via 192.168.11.101 dev eth0 proto static scope global")
    plan = planned([], current, {wanted.key: entry})
    assert commands(plan.changes) == ["del default via 192.168.11.101 dev eth0 proto static"]


def test_unrestorable_routes_are_never_replaced():
    connected = holding("unicast 192.168.11.0/24 dev eth0 proto kernel scope link src 192.168.11.100")
    refused = planned([route("192.168.11.0/24")], connected, replace=True).results[0]
    assert (refused.state, "kernel itself" in refused.problem) == ("refused", True)
    strange = holding("unicast ::/0 via fe80::9 dev eth0 proto ra scope global metric 1024 expires 1700sec pref medium")
    refused = planned([route("::/0", "fd00:11::1")], strange, replace=True).results[0]
    assert (refused.state, "expires" in refused.problem) == ("refused", True)


@pytest.mark.parametrize(
    ("current", "state"),
    [
        ([], "gone"),
        (["unicast default via 192.168.11.7 dev eth0 proto boot scope global"], "left"),
    ],
)
def test_what_somebody_else_has_changed_since_is_left(current, state):
    wanted = route("0.0.0.0/0", "192.168.11.101")
    plan = planned([], holding(*current), {wanted.key: RouteEntry((wanted,), ())})
    assert (plan.changes, plan.taken_back[0]["state"], plan.final) == ([], state, {})


def test_several_routes_of_one_key_become_one():
    wanted = route("fd00:5::/64", "fd00:11::1")
    both = holding(
        "unicast fd00:5::/64 proto boot scope global metric 1024 pref medium\\"
        "\tnexthop via fd00:11::3 dev eth0 weight 1 \\\tnexthop via fd00:11::4 dev eth0 weight 1"
    )
    plan = planned([wanted], both, replace=True)
    assert plan.changes[0].verb == "replace"
    assert commands(plan.undo) == [
        "replace fd00:5::/64 proto boot metric 1024 nexthop via fd00:11::3 dev eth0 weight 1 "
        "nexthop via fd00:11::4 dev eth0 weight 1"
    ]
    four = holding(
        "unicast 10.1.0.0/16 via 192.168.11.1 dev eth0 proto boot scope global",
        "unicast 10.1.0.0/16 via 192.168.11.2 dev eth0 proto boot scope global",
    )
    plan = planned([route("10.1.0.0/16", "192.168.11.9")], four, replace=True)
    assert [change.verb for change in plan.changes] == ["replace", "del"]
    assert [change.verb for change in plan.undo] == ["replace", "append"]


def test_a_foreign_item_is_not_given_back():
    wanted = route("0.0.0.0/0", "192.168.11.101")
    both = holding(
        "unicast default via 192.168.11.1 dev eth0 proto boot scope global",
        "unicast default via 192.168.11.101 dev eth0 proto static scope global",
    )
    theirs = ("default", "via", "192.168.11.1", "dev", "eth0", "proto", "boot")
    plan = planned([wanted], both, {wanted.key: RouteEntry((wanted,), ())}, replace=True)
    assert commands(plan.changes) == ["del " + " ".join(theirs)]
    assert plan.final[wanted.key].replaced == (theirs,)
    assert len(planned([wanted], both, replace=True).final[wanted.key].replaced) == 2  # none of them is ours


def test_after_a_killed_run_both_ways_are_ours():
    old, new = route("0.0.0.0/0", "192.168.11.1"), route("0.0.0.0/0", "192.168.11.2")
    entries = {old.key: RouteEntry((old, new), ())}
    for gateway in ("192.168.11.1", "192.168.11.2"):
        current = holding(f"unicast default via {gateway} dev eth0 proto static scope global")
        assert planned([new], current, entries).results[0].problem is None
        assert [t["state"] for t in planned([], current, entries).taken_back] == ["removed"]


def test_links_come_before_what_is_behind_them():
    plan = planned([route("0.0.0.0/0", "172.16.0.1"), route("172.16.0.0/24")])
    assert [change.words[0] for change in plan.changes] == ["172.16.0.0/24", "default"]
    assert [result.after.split()[0] for result in plan.results] == ["default", "172.16.0.0/24"]


def test_a_second_default_route_is_found():
    wanted = [route("0.0.0.0/0", "192.168.11.101"), route("10.0.0.0/8", "192.168.11.101")]
    others = holding(
        "unicast default via 10.0.0.1 dev eth2 proto dhcp scope global metric 100",
        "unicast 10.0.0.0/8 via 10.0.0.1 dev eth2 proto dhcp scope global metric 100",
        "unicast ::/0 via fd00:11::9 dev eth0 proto static scope global metric 5",
    )
    found = routes_plan.find_other_defaults(wanted, [one for there in others.values() for one in there])
    assert [one.text for one in found] == ["default via 10.0.0.1 dev eth2 proto dhcp metric 100"]
    assert routes_plan.find_other_defaults(wanted[1:], [one for there in others.values() for one in there]) == []
