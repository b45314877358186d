# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The boot part of all routes as one change, over the back ends ifupdown and networkd on trees of files."""

import json

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.boot import Boot
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.kernel import RouteSpec
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.managers import contract
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.options import RouteRequest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.record import read_record
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.transaction import explain_failure
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from planned_routes import DROP_IN, ROUTES, machine

HOOK = "/etc/network/if-up.d/rosfleet-multimaster"


def boot(tree, record=None, choice=None):
    plan = Boot(machine(tree, "eth0", "eth1.5"), read_record({"boot": record or {}}))
    plan.plan(choice or {})
    return plan


def final(plan):
    return plan.final_record({}).to_json().get("boot", {})


CHOICE = {"ifupdown": {"eth0": ROUTES["eth0"]}, "networkd": {"eth1.5": ROUTES["eth1.5"]}}


def snapshot(tree):
    return {str(p.relative_to(tree)): p.read_bytes() if p.is_file() else None for p in sorted(tree.rglob("*"))}


def test_made_found_again_and_removed_without_a_trace(tree):
    before = snapshot(tree)
    first = boot(tree, choice=CHOICE)
    assert set(first.changes) == {"ifupdown", "networkd"}
    first.apply()
    memory = json.loads(json.dumps(final(first)))
    assert (tree / "etc/network/if-up.d/rosfleet-multimaster").stat().st_mode & 0o777 == 0o755
    assert memory["folders"] == [
        "/etc/systemd",
        "/etc/systemd/network",
        "/etc/systemd/network/50-robot.network.d",
        "/etc/network/if-up.d",
    ]
    second = boot(tree, memory, CHOICE)
    assert second.changes == {}
    assert final(second) == memory
    last = boot(tree, memory)
    last.apply()
    assert (snapshot(tree), final(last)) == (before, {})


def test_a_failure_half_way_puts_the_files_back(tree):
    before = snapshot(tree)
    (tree / "etc/network/if-up.d").write_text("in the way")
    plan = boot(tree, choice=CHOICE)
    with pytest.raises(OSError, match="if-up.d"):
        plan.apply()
    assert (tree / "etc/systemd").exists()
    (tree / "etc/network/if-up.d").unlink()
    assert plan.undo() == []
    assert snapshot(tree) == before


def test_a_place_that_cannot_be_put_back_is_a_sentence(tree):
    plan = boot(tree, choice=CHOICE)
    plan.apply()
    hook = tree / HOOK.lstrip("/")
    hook.unlink()
    hook.mkdir()
    told = f"{hook} cannot be written (Is a directory); expected a writable file: correct the path, or move the folder away."
    assert plan.undo() == [told]
    assert explain_failure(Problem("No."), plan.undo()) == f"No. Not put back: {told}"


@pytest.mark.parametrize("backend", ["netplan", "networkmanager"])
def test_what_a_back_end_has_no_word_for_is_one_sentence(tree, backend):
    routes = [RouteSpec("0.0.0.0/0", "192.168.11.101", "eth0", advmss=1360)]
    with pytest.raises(Problem, match=f"advmss 1360: the backend {backend} has no word for advmss"):
        boot(tree, choice={backend: {"eth0": routes}})


def test_the_finer_points_at_boot(tree):
    routes = [RouteSpec("10.1.0.0/16", "", "eth1.5", scope="host", mtu=1400, advmss=1360, initcwnd=20)]
    plan = boot(
        tree, choice={"networkd": {"eth1.5": routes}, "ifupdown": {"eth0": [routes[0]._replace(device="eth0")]}}
    )
    drop_in, hook = plan.wanted[DROP_IN.format("50-robot.network")], plan.wanted[HOOK]
    assert drop_in.endswith(
        "Destination=10.1.0.0/16\nScope=host\nMTUBytes=1400\nTCPAdvertisedMaximumSegmentSize=1360\n"
        "InitialCongestionWindow=20\n"
    )
    assert "10.1.0.0/16 dev eth0 proto static scope host mtu 1400 advmss 1360 initcwnd 20" in hook


def test_interfaces_of_one_file_are_named_in_their_order(tree):
    for number in (2, 3):
        link = tree / f"run/systemd/netif/links/{number}"
        link.write_text("ADMIN_STATE=configured\nNETWORK_FILE=/etc/systemd/network/all.network\n")
    plan = Boot(machine(tree, "eth0", "eth1"), read_record({}))
    choice = {name: [RouteSpec("10.1.0.0/16", "", name)] for name in ("eth1", "eth0")}
    with pytest.raises(
        Problem, match="^routes: eth0 is configured by /etc/systemd/network/all.network, and so is eth1"
    ):
        plan.plan({"networkd": choice})


def test_no_routes_and_no_files_give_no_place(tree):
    plan = boot(tree)
    assert (plan.wanted, plan.places, plan.changes) == ({}, {}, {})


def test_no_routes_no_hook(tree):
    plan = boot(tree, choice={"ifupdown": {"eth0": ROUTES["eth0"]}})
    plan.apply()
    assert boot(tree, final(plan)).wanted == {HOOK: None}


def test_a_drop_in_of_an_earlier_file_goes(tree):
    old, new = DROP_IN.format("10-old.network"), DROP_IN.format("50-robot.network")
    back_end = boot(tree).backends["networkd"]
    (tree / old.lstrip("/")).parent.mkdir(parents=True)
    back_end.write(old, contract.HEADER)
    plan = boot(tree, choice={"networkd": {"eth1.5": ROUTES["eth1.5"]}})
    assert plan.wanted == {old: None, new: back_end.render(new, {"eth1.5": ROUTES["eth1.5"]})}


def test_an_interface_that_changes_hands_leaves_no_hook(tree):
    plan = boot(tree, choice={"ifupdown": {"eth0": ROUTES["eth0"]}})
    plan.apply()
    moved = boot(tree, final(plan), {"networkd": {"eth1.5": ROUTES["eth0"]}})
    moved.apply()
    assert not (tree / "etc/network/if-up.d").exists()
    assert list(final(moved)["places"]) == [DROP_IN.format("50-robot.network")]


def test_what_a_killed_run_has_not_told_its_manager_is_told(tree):
    plan = boot(tree, choice=CHOICE)
    interim = plan.interim_record({}).to_json()["boot"]
    plan.apply()
    again = boot(tree, interim, CHOICE)
    assert set(again.changes) == {"ifupdown", "networkd"}
    assert set(interim["pending"]) == {"ifupdown", "networkd"}


@pytest.mark.parametrize(
    ("backend", "overrides", "carrier", "expected"),
    [
        ("auto", {}, "eth0", "ifupdown"),
        ("auto", {}, "eth1.5", "networkd"),
        ("auto", {"eth0": "none"}, "eth0", "none"),
        ("auto", {"eth0": "auto"}, "eth0", "ifupdown"),
        ("networkd", {"eth0": "none"}, "eth0", "networkd"),
    ],
)
def test_who_brings_a_route_back(tree, backend, overrides, carrier, expected):
    assert boot(tree).choose_backend(RouteRequest(ROUTES["eth0"][0], carrier, backend), overrides) == expected


@pytest.mark.parametrize("carrier", ["usb0", ""])
def test_an_interface_of_nobody_is_one_sentence(tree, carrier):
    with pytest.raises(Problem, match=r"none of .*ifupdown manages .* set backend to none"):
        boot(tree).choose_backend(RouteRequest(ROUTES["eth0"][0], carrier, "auto"), {})
