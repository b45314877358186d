# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""routes: what the options mean, what `ip` shows, and the plan from one to the other. Pure."""

import json
from pathlib import Path

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.network import Address, Interface
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes import kernel
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes import plan as routes_plan
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.kernel import Route
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.plan import Entry
from hypothesis import given
from hypothesis import strategies as st

FIXTURES = Path(__file__).parents[3] / "fixtures" / "routes"


def link(*addresses, up=True, loopback=False):
    split = [address.split("/") for address in addresses]
    entries = [Address(text, int(length), "inet6" if ":" in text else "inet") for text, length in split]
    return Interface("", up=up, loopback=loopback, addresses=tuple(entries))


INTERFACES = {
    "lo": link("127.0.0.1/8", "::1/128", loopback=True),
    "eth0": link("192.168.11.100/24", "fd00:11::100/64", "fe80::1/64"),
    "eth1": link("192.168.1.201/24"),
    "eth2": link("192.168.1.130/25", "10.0.0.1/24"),
    "wlan0": link("10.0.0.2/24", up=False),
}
DEFAULTS = {
    "gateway": None,
    "device": None,
    "metric": None,
    "table": 254,
    "source": None,
    "on_link": False,
    "type": "unicast",
    "backend": "auto",
}


def items(*given):
    return routes_plan.items_of([{**DEFAULTS, **item} for item in given], INTERFACES)


def route(destination, gateway="", device="eth0", metric=None, **more):
    if metric is None:
        metric = 1024 if ":" in destination else 0
    return Route(destination, gateway, device, metric, **more)


def held(text, version=4, table=254):
    raw = kernel.from_text(text)[0]
    return kernel.held(raw, version, table)


def holding(*texts):
    current = {}
    for text in texts:
        found = held(text, 6 if ":" in text else 4)
        current.setdefault(found.route.key, []).append(found)
    return current


def planned(routes, current=None, entries=None, replace=False):
    return routes_plan.plan(routes, current or {}, entries or {}, replace, INTERFACES)


def commands(changes):
    return [" ".join([change.verb, *change.words]) for change in changes]


# What is wanted


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"destination": "default", "gateway": "192.168.11.101"}, route("0.0.0.0/0", "192.168.11.101")),
        ({"destination": "0.0.0.0/0", "gateway": "192.168.11.101"}, route("0.0.0.0/0", "192.168.11.101")),
        ({"destination": "::/0", "gateway": "FD00:11::0001"}, route("::/0", "fd00:11::1")),
        ({"destination": "::/0", "gateway": "fe80::9", "device": "eth0"}, route("::/0", "fe80::9")),
        (
            {"destination": "192.168.10.7", "gateway": "192.168.1.202"},
            route("192.168.10.7/32", "192.168.1.202", "eth2"),
        ),
        ({"destination": "10.1.0.0/16", "gateway": "192.168.1.20"}, route("10.1.0.0/16", "192.168.1.20", "eth1")),
        ({"destination": "fd00:5::/64", "device": "eth0", "metric": 0}, route("fd00:5::/64")),
        ({"destination": "10.5.0.0/16", "type": "blackhole"}, route("10.5.0.0/16", device="", type="blackhole")),
    ],
)
def test_what_an_item_means(given, expected):
    assert items(given)[0].route == expected


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"destination": "192.168.11.5/24", "device": "eth0"}, ["no network", "host bits"]),
        ({"destination": "dabo", "device": "eth0"}, ["no network", "dabo"]),
        ({"destination": "default"}, ["neither gateway nor device"]),
        (
            {"destination": "default", "gateway": "192.168.99.1"},
            ["no interface", "192.168.99.1", "eth0 192.168.11.100/24"],
        ),
        ({"destination": "default", "gateway": "10.0.0.9"}, ["eth2, wlan0", "device"]),
        ({"destination": "default", "gateway": "fd00:11::1"}, ["IPv6", "::/0"]),
        ({"destination": "::/0", "gateway": "fe80::9"}, ["link-local", "device"]),
        ({"destination": "default", "device": "eth9"}, ["no interface eth9"]),
        ({"destination": "default", "gateway": "x"}, ["no address"]),
        ({"destination": "default", "device": "eth0", "metric": -1}, ["metric -1"]),
        ({"destination": "default", "device": "eth0", "table": 255}, ["table 255"]),
        ({"destination": "default", "device": "eth0", "on_link": True}, ["on_link"]),
        ({"destination": "10.5.0.0/16", "type": "blackhole", "gateway": "192.168.11.1"}, ["blackhole", "gateway"]),
    ],
)
def test_an_item_that_cannot_be_meant_is_one_sentence(given, words):
    with pytest.raises(Problem) as caught:
        items(given)
    assert str(caught.value).startswith("routes: item 1 (")
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_the_same_item_twice_is_one_and_two_ways_of_one_key_are_refused():
    one = {"destination": "default", "gateway": "192.168.11.101"}
    assert len(items(one, {**one, "destination": "0.0.0.0/0"})) == 1
    assert len(items(one, {**one, "metric": 5})) == 2
    with pytest.raises(Problem, match="two routes to default with metric 0 in table 254"):
        items(one, {**one, "gateway": "192.168.11.102"})


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        (route("0.0.0.0/0", "10.0.0.9", "wlan0"), "wlan0 is down"),
        (route("0.0.0.0/0", "192.168.11.100"), "this computer itself"),
        (route("0.0.0.0/0", "172.16.0.1"), "not in a network of eth0"),
        (route("0.0.0.0/0", "192.168.11.1", source="192.168.11.7"), "no address of this computer"),
    ],
)
def test_what_the_kernel_would_refuse_is_said_before(wanted, words):
    with pytest.raises(Problem, match=words):
        routes_plan.check_usable([routes_plan.Item(wanted, "eth0", "auto")], INTERFACES, {})


def test_a_gateway_behind_a_route_of_the_list_or_on_link_is_usable():
    behind = route("0.0.0.0/0", "172.16.0.1")
    near = route("172.16.0.0/24")
    routes_plan.check_usable([routes_plan.Item(r, "eth0", "auto") for r in (behind, near)], INTERFACES, {})
    routes_plan.check_usable([routes_plan.Item(behind._replace(on_link=True), "eth0", "auto")], INTERFACES, {})


# What the kernel shows


@pytest.mark.parametrize("version", [4, 6])
def test_the_text_of_an_old_iproute2_says_the_same_as_json(version):
    raws = json.loads((FIXTURES / f"show{version}.json").read_text())
    lines = kernel.from_text((FIXTURES / f"show{version}.txt").read_text())
    assert [kernel.held(raw, version, 254) for raw in lines] == [kernel.held(raw, version, 254) for raw in raws]


def test_the_words_of_a_route_bring_it_back_whole():
    texts = [kernel.held(raw, 4, 100).text for raw in json.loads((FIXTURES / "show4.json").read_text())]
    assert texts == (FIXTURES / "words4.txt").read_text().splitlines()


def test_what_the_words_do_not_say_is_named():
    found = held("unicast default via 192.168.11.1 dev eth0 proto boot scope global encap mpls 100 mtu lock 1400")
    assert {"encap", "lock"} <= set(found.strange)


GATEWAYS = st.sampled_from(["", "192.168.11.1", "192.168.11.2"])


@given(
    st.builds(
        route,
        st.sampled_from(["0.0.0.0/0", "10.1.0.0/16", "10.2.3.4/32"]),
        GATEWAYS,
        metric=st.integers(0, 2**32 - 1),
        table=st.integers(1, 2**32 - 1),
        source=st.sampled_from(["", "192.168.11.100"]),
    )
)
def test_a_route_of_ours_is_read_as_it_was_made(wanted):
    words = kernel.words_of(wanted)
    if "table" in words:  # a listing of one table does not name it
        at = words.index("table")
        del words[at : at + 2]
    shown = " ".join(["unicast", *words])
    assert held(shown.replace("/32", ""), table=wanted.table).route == wanted


# The plan


def test_a_new_route_a_right_one_and_another_way():
    wanted = route("0.0.0.0/0", "192.168.11.101")
    new = planned([wanted])
    assert commands(new.changes) == ["replace default via 192.168.11.101 dev eth0 proto static"]
    assert [r["state"] for r in new.results] == ["changed"]
    assert new.final == {wanted.key: Entry((wanted,), ())}

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
def test_what_moves_to_another_metric_or_table_comes_before_the_old_goes(change):
    old, new = route("10.1.0.0/16", "192.168.11.1"), route("10.1.0.0/16", "192.168.11.1")._replace(**change)
    current = holding("unicast 10.1.0.0/16 via 192.168.11.1 dev eth0 proto static scope global")
    plan = planned([new], current, {old.key: Entry((old,), ())})
    assert [change.verb for change in plan.changes] == ["replace", "del"]
    assert [change.verb for change in plan.undo] == ["replace", "del"]
    assert [t["state"] for t in plan.taken_back] == ["removed"]


def test_a_foreign_route_that_is_right_is_adopted_and_stays():
    wanted = route("0.0.0.0/0", "192.168.11.101")
    current = holding("unicast default via 192.168.11.101 dev eth0 proto boot scope global onlink mtu 1400")
    plan = planned([wanted], current)
    assert (plan.changes, plan.final, plan.results[0]["state"]) == ([], {}, "ok")
    assert planned([], current, plan.final).changes == []


def test_a_foreign_route_in_its_place_is_a_conflict_or_comes_back_later():
    wanted = route("0.0.0.0/0", "192.168.11.101")
    current = holding("unicast default via 192.168.11.1 dev eth0 proto boot scope global mtu 1400")
    refused = planned([wanted], current)
    assert refused.results[0]["state"] == "conflict"
    assert "'default via 192.168.11.1 dev eth0 proto boot mtu 1400'" in refused.results[0]["problem"]

    plan = planned([wanted], current, replace=True)
    assert plan.results[0]["state"] == "changed"
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
    entry = Entry((wanted,), (("default", "via", "10.9.0.1", "dev", "usb0"),))
    current = holding("unicast default via 192.168.11.101 dev eth0 proto static scope global")
    plan = planned([], current, {wanted.key: entry})
    assert commands(plan.changes) == ["del default via 192.168.11.101 dev eth0 proto static"]


def test_connected_routes_and_what_cannot_be_given_back_are_never_replaced():
    connected = holding("unicast 192.168.11.0/24 dev eth0 proto kernel scope link src 192.168.11.100")
    refused = planned([route("192.168.11.0/24")], connected, replace=True).results[0]
    assert (refused["state"], "kernel itself" in refused["problem"]) == ("refused", True)
    strange = holding("unicast ::/0 via fe80::9 dev eth0 proto ra scope global metric 1024 expires 1700sec pref medium")
    refused = planned([route("::/0", "fd00:11::1")], strange, replace=True).results[0]
    assert (refused["state"], "expires" in refused["problem"]) == ("refused", True)


@pytest.mark.parametrize(
    ("current", "state"),
    [
        ([], "gone"),
        (["unicast default via 192.168.11.7 dev eth0 proto boot scope global"], "left"),
    ],
)
def test_what_somebody_else_has_changed_since_is_left(current, state):
    wanted = route("0.0.0.0/0", "192.168.11.101")
    plan = planned([], holding(*current), {wanted.key: Entry((wanted,), ())})
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


def test_ours_beside_somebody_elses_is_not_among_what_is_given_back():
    wanted = route("0.0.0.0/0", "192.168.11.101")
    both = holding(
        "unicast default via 192.168.11.1 dev eth0 proto boot scope global",
        "unicast default via 192.168.11.101 dev eth0 proto static scope global",
    )
    theirs = ("default", "via", "192.168.11.1", "dev", "eth0", "proto", "boot")
    plan = planned([wanted], both, {wanted.key: Entry((wanted,), ())}, replace=True)
    assert commands(plan.changes) == ["del " + " ".join(theirs)]
    assert plan.final[wanted.key].replaced == (theirs,)
    assert len(planned([wanted], both, replace=True).final[wanted.key].replaced) == 2  # none of them is ours


def test_after_a_killed_run_both_ways_are_ours():
    old, new = route("0.0.0.0/0", "192.168.11.1"), route("0.0.0.0/0", "192.168.11.2")
    entries = {old.key: Entry((old, new), ())}
    for gateway in ("192.168.11.1", "192.168.11.2"):
        current = holding(f"unicast default via {gateway} dev eth0 proto static scope global")
        assert planned([new], current, entries).results[0]["problem"] is None
        assert [t["state"] for t in planned([], current, entries).taken_back] == ["removed"]


def test_links_come_before_what_is_behind_them():
    plan = planned([route("0.0.0.0/0", "172.16.0.1"), route("172.16.0.0/24")])
    assert [change.words[0] for change in plan.changes] == ["172.16.0.0/24", "default"]
    assert [result["route"].destination for result in plan.results] == ["0.0.0.0/0", "172.16.0.0/24"]


def test_a_second_default_route_is_found():
    wanted = [route("0.0.0.0/0", "192.168.11.101"), route("10.0.0.0/8", "192.168.11.101")]
    others = holding(
        "unicast default via 10.0.0.1 dev eth2 proto dhcp scope global metric 100",
        "unicast 10.0.0.0/8 via 10.0.0.1 dev eth2 proto dhcp scope global metric 100",
        "unicast ::/0 via fd00:11::9 dev eth0 proto static scope global metric 5",
    )
    found = routes_plan.other_defaults(wanted, [one for there in others.values() for one in there])
    assert [one.text for one in found] == ["default via 10.0.0.1 dev eth2 proto dhcp metric 100"]
    assert routes_plan.other_defaults(wanted[1:], [one for there in others.values() for one in there]) == []
