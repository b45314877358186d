# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The back ends ifupdown and networkd, on trees of files."""

import os
import subprocess
from pathlib import Path

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.managers import (
    ifupdown,
    networkd,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from planned_routes import DROP_IN, ROUTES, machine

FIXTURES = Path(__file__).parents[5] / "fixtures" / "routes"


def end(kind, tree, names=("eth0", "eth1.5"), recorded=None):
    return kind.BackEnd(machine(tree, *names), recorded or {})


# ifupdown


def test_ifupdown_owns_what_ifup_brought_up(tree):
    assert end(ifupdown, tree).list_interfaces() == {"eth0"}


def test_an_alias_is_its_interface(tree):
    (tree / "run/network/ifstate").write_text("lo=lo\neth0:1=eth0:1\n")
    assert end(ifupdown, tree).list_interfaces() == {"eth0"}


@pytest.mark.parametrize("line", ["no-scripts eth0", "no-scripts lo eth*", " no-scripts \\\n eth0  "])
@pytest.mark.parametrize(
    "source", ["source lab/*", "source-directory lab", "source /etc/network/lab/a /etc/network/interfaces"]
)
def test_an_interface_without_hooks_is_refused(tree, line, source):
    (tree / "etc/network/lab").mkdir()
    (tree / "etc/network/lab/a").write_text(line + "\n")
    (tree / "etc/network/interfaces").write_text("# no-scripts eth1.5\nno-scripts /eth*\n")
    back_end = end(ifupdown, tree)
    wanted = {ifupdown.HOOK: back_end.render(ifupdown.HOOK, ROUTES)}
    back_end.check(wanted)
    with (tree / "etc/network/interfaces").open("a") as stream:
        stream.write(source + "\n")
    with pytest.raises(Problem, match='/etc/network/lab/a says "no-scripts .*ifup runs no hook for eth0'):
        back_end.check(wanted)


def test_the_hook_of_ifupdown(tree):
    hook = end(ifupdown, tree).render(ifupdown.HOOK, ROUTES)
    assert hook == (FIXTURES / "if-up.d").read_text()
    subprocess.run(["sh", "-n"], input=hook, text=True, check=True)


def test_the_name_of_the_hook_is_one_that_run_parts_runs(tree):
    back_end = end(ifupdown, tree)
    os.mkdir(tree / "etc/network/if-up.d")
    back_end.write(ifupdown.HOOK, back_end.render(ifupdown.HOOK, ROUTES))
    listed = subprocess.run(
        ["run-parts", "--test", tree / "etc/network/if-up.d"], capture_output=True, text=True, check=True
    )
    assert listed.stdout.split() == [str(tree / "etc/network/if-up.d/rosfleet-multimaster")]
    back_end.write(ifupdown.HOOK, None)
    assert os.listdir(tree / "etc/network/if-up.d") == []


def test_a_place_that_a_killed_run_has_emptied_is_gone_for_good(tree, synced):
    os.mkdir(tree / "etc/network/if-up.d")
    end(ifupdown, tree).write(ifupdown.HOOK, None)
    assert synced == [str(tree / "etc/network/if-up.d")]


def test_without_ifupdown_there_is_no_place(tmp_path):
    with pytest.raises(Problem, match="expected ifupdown installed"):
        end(ifupdown, tmp_path).find_place("eth0")


def test_a_hook_of_somebody_else_is_left(tree):
    (tree / "etc/network/if-up.d").mkdir()
    (tree / "etc/network/if-up.d/rosfleet-multimaster").write_text("#!/bin/sh\nroute add default gw 192.168.11.1\n")
    with pytest.raises(Problem, match="is there and not ours"):
        end(ifupdown, tree).read()


def test_a_hook_of_a_huge_size_is_a_sentence(tree):
    (tree / "etc/network/if-up.d").mkdir()
    with open(tree / "etc/network/if-up.d/rosfleet-multimaster", "wb") as stream:
        stream.truncate((64 << 20) + 1)  # a hole, which takes no room
    with pytest.raises(Problem, match="cannot be read .*larger than 64 MiB.* Nothing was changed"):
        end(ifupdown, tree).read()


# systemd-networkd


def test_networkd_owns_what_it_configures(tree):
    assert end(networkd, tree).list_interfaces() == {"eth1.5"}


def test_the_drop_in_of_networkd(tree):
    back_end = end(networkd, tree)
    place = back_end.find_place("eth1.5")
    assert place == DROP_IN.format("50-robot.network")
    wanted = back_end.render(place, {"eth1.5": [route for routes in ROUTES.values() for route in routes]})
    assert wanted == (FIXTURES / "networkd.conf").read_text()


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
        end(networkd, tree).find_place("eth0")
