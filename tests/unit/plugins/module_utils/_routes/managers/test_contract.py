# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""routes: the back ends ifupdown and networkd, and all back ends together, on trees of files."""

import json
import os
import subprocess
from pathlib import Path

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.network import Interface
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.kernel import Route
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.managers import (
    contract,
    ifupdown,
    networkd,
    table,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.plan import Item

FIXTURES = Path(__file__).parents[4] / "fixtures" / "routes"
DROP_IN = "/etc/systemd/network/{}.d/90-rosfleet-multimaster.conf"

ROUTES = {
    "eth0": [
        Route("0.0.0.0/0", "192.168.11.101", "eth0"),
        Route("::/0", "fd00:11::101", "eth0", 1024),
        Route("10.66.0.0/16", type="blackhole"),
    ],
    "eth1.5": [
        Route("10.67.0.0/16", "10.9.9.9", "eth1.5", 50, 100, "192.168.1.201", on_link=True),
        Route("226.0.0.0/8", "", "eth1.5"),
    ],
}


def machine(*names):
    links = {name: Interface(name, number, up=True) for number, name in enumerate(names, 2)}
    return contract.Machine(links, booted=False)


@pytest.fixture
def tree(tmp_path):
    """A root folder, with eth0 managed by ifupdown and eth1.5 by networkd."""

    def put(path, text=""):
        target = tmp_path / path.lstrip("/")
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text)
        return target

    put("run/network/ifstate", "lo=lo\neth0=home\nppp0=ppp0\n")
    put("run/network/.ifstate.lock")
    (tmp_path / "etc/network").mkdir(parents=True)
    put("run/systemd/netif/links/2", "ADMIN_STATE=unmanaged\nOPER_STATE=routable\n")
    put("run/systemd/netif/links/3", "ADMIN_STATE=configured\nNETWORK_FILE=/usr/lib/systemd/network/50-robot.network\n")
    return tmp_path


def end(kind, tree, names=("eth0", "eth1.5"), recorded=None):
    return kind.BackEnd(machine(*names), str(tree), recorded or {})


# ifupdown


def test_ifupdown_owns_what_ifup_brought_up(tree):
    assert end(ifupdown, tree).owns() == {"eth0"}


def test_the_hook_of_ifupdown(tree):
    hook = end(ifupdown, tree).render(ROUTES)[ifupdown.HOOK]
    assert hook == (FIXTURES / "if-up.d").read_text()
    subprocess.run(["sh", "-n"], input=hook, text=True, check=True)


def test_no_routes_no_hook(tree):
    assert end(ifupdown, tree).render({"eth0": []}) == {ifupdown.HOOK: None}


def test_the_name_of_the_hook_is_one_that_run_parts_runs(tree):
    back_end = end(ifupdown, tree)
    os.mkdir(tree / "etc/network/if-up.d")
    back_end.write(ifupdown.HOOK, back_end.render(ROUTES)[ifupdown.HOOK])
    listed = subprocess.run(
        ["run-parts", "--test", tree / "etc/network/if-up.d"], capture_output=True, text=True, check=True
    )
    assert listed.stdout.split() == [str(tree / "etc/network/if-up.d/rosfleet-multimaster")]
    back_end.write(ifupdown.HOOK, None)
    assert os.listdir(tree / "etc/network/if-up.d") == []


def test_without_ifupdown_there_is_no_place(tmp_path):
    with pytest.raises(Problem, match="expected ifupdown installed"):
        end(ifupdown, tmp_path).place("eth0")


def test_a_hook_of_somebody_else_is_left(tree):
    (tree / "etc/network/if-up.d").mkdir()
    (tree / "etc/network/if-up.d/rosfleet-multimaster").write_text("#!/bin/sh\nroute add default gw 192.168.11.1\n")
    with pytest.raises(Problem, match="is there and not ours"):
        end(ifupdown, tree).read()


# systemd-networkd


def test_networkd_owns_what_it_configures(tree):
    assert end(networkd, tree).owns() == {"eth1.5"}


def test_the_drop_in_of_networkd(tree):
    wanted = end(networkd, tree).render({"eth1.5": [route for routes in ROUTES.values() for route in routes]})
    assert list(wanted) == [DROP_IN.format("50-robot.network")]
    assert next(iter(wanted.values())) == (FIXTURES / "networkd.conf").read_text()


def test_a_drop_in_of_an_earlier_file_goes(tree):
    back_end = end(networkd, tree)
    old = DROP_IN.format("10-old.network")
    os.makedirs(os.path.dirname(back_end.path(old)))
    back_end.write(old, contract.HEADER)
    assert back_end.render(ROUTES | {"eth0": []}) == {
        old: None,
        DROP_IN.format("50-robot.network"): back_end.render({"eth1.5": ROUTES["eth1.5"]})[
            DROP_IN.format("50-robot.network")
        ],
    }


@pytest.mark.parametrize(
    ("state", "words"),
    [
        ("ADMIN_STATE=unmanaged\nNETWORK_FILE=/x/50-robot.network\n", "by no .network file"),
        ("", "by no .network file"),
        ("ADMIN_STATE=configured\nNETWORK_FILE=/run/systemd/network/10-netplan-eth0.network\n", "written by netplan"),
        ("ADMIN_STATE=configured\nNETWORK_FILE=/usr/lib/systemd/network/50-robot.network\n", "and so is eth1.5"),
    ],
)
def test_where_networkd_has_no_place_for_one_interface(tree, state, words):
    (tree / "run/systemd/netif/links/2").write_text(state)
    with pytest.raises(Problem, match=words):
        end(networkd, tree).place("eth0")


# Together


def boot(tree, record=None, choice=None):
    plan = table.Boot(machine("eth0", "eth1.5"), str(tree), record or {})
    plan.want(choice or {})
    return plan


CHOICE = {"ifupdown": {"eth0": ROUTES["eth0"]}, "networkd": {"eth1.5": ROUTES["eth1.5"]}}


def snapshot(tree):
    return {str(p.relative_to(tree)): p.read_bytes() if p.is_file() else None for p in sorted(tree.rglob("*"))}


def test_made_found_again_and_removed_without_a_trace(tree):
    before = snapshot(tree)
    first = boot(tree, choice=CHOICE)
    assert set(first.changes) == {"ifupdown", "networkd"}
    first.apply()
    memory = json.loads(json.dumps(first.memory()))
    assert (tree / "etc/network/if-up.d/rosfleet-multimaster").stat().st_mode & 0o777 == 0o755
    assert memory["folders"] == [
        "/etc/systemd",
        "/etc/systemd/network",
        "/etc/systemd/network/50-robot.network.d",
        "/etc/network/if-up.d",
    ]
    second = boot(tree, memory, CHOICE)
    assert second.changes == {}
    assert second.memory() == memory
    last = boot(tree, memory)
    last.apply()
    assert (snapshot(tree), last.memory()) == (before, {})


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


def test_an_interface_that_changes_hands_leaves_no_hook(tree):
    plan = boot(tree, choice={"ifupdown": {"eth0": ROUTES["eth0"]}})
    plan.apply()
    moved = boot(tree, plan.memory(), {"networkd": {"eth1.5": ROUTES["eth0"]}})
    moved.apply()
    assert not (tree / "etc/network/if-up.d").exists()
    assert list(moved.memory()["places"]) == [DROP_IN.format("50-robot.network")]


def test_what_a_killed_run_has_not_told_its_manager_is_told(tree):
    plan = boot(tree, choice=CHOICE)
    interim = plan.interim()
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
    assert boot(tree).backend_of(Item(ROUTES["eth0"][0], carrier, backend), overrides) == expected


@pytest.mark.parametrize("carrier", ["usb0", ""])
def test_an_interface_of_nobody_is_one_sentence(tree, carrier):
    with pytest.raises(Problem, match=r"none of .*ifupdown manages .* set backend to none"):
        boot(tree).backend_of(Item(ROUTES["eth0"][0], carrier, "auto"), {})
