# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Other names and addresses: the same ones everywhere, and none of the old ones."""

import json

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._bundle.anonymous import Anonymous
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.units import NODES, OTHERS


@pytest.fixture(name="other", scope="module")
def _other():
    return Anonymous(
        fleets.fig12(),
        {"tibi-nav": ["upstairs-nuc.lab.example.org"]},
        {"anna", "root"},
        ["http://annas-laptop:11311/ and /home/bert/ws", "http://wiki.ros.org/x"],
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("tibi-nav", "robot1-computer1"),
        ("TIBI-NAV is online; car is not", "robot1-computer1 is online; robot3 is not"),
        ("/multimaster_verify/tibi_nav of /tibi/base", "/multimaster_verify/robot1_computer1 of /robot1/base"),
        ("/tibi_base cart scar", "/robot1_base cart scar"),
        ("http://tibi-visio:11311/", "http://robot1-computer2:11311/"),
        ("upstairs-nuc.lab.example.org", "robot1-computer1-name1"),
        ("annas-laptop, annas_laptop", "host1, host1"),
        ("http://wiki.ros.org/x", "http://wiki.ros.org/x"),
        (
            "/home/bert/x /home/anna; user anna; anna@x; the anna",
            "/home/user2/x /home/user1; user user1; user1@x; the anna",
        ),
        (
            "user root, master_sync, multimaster-sync.service, /rosout",
            "user root, master_sync, multimaster-sync.service, /rosout",
        ),
        ("at 12:31:05, ::1, 127.0.0.1 and 226.0.0.0", "at 12:31:05, ::1, 127.0.0.1 and 226.0.0.0"),
        ("aa:bb:cc:dd:ee:ff AA:BB:CC:DD:EE:FF", "02:00:00:00:00:01 02:00:00:00:00:01"),
        ("via inet6 fe80::a8bb:ccff:fedd:eeff on eth0", "via inet6 fe80::1 on eth0"),
        ("2001:4c80::7", "2001:db8::1"),
        ("1.2.3.4.5, 999.1.1.1, 2026-11-22", "1.2.3.4.5, 999.1.1.1, 2026-11-22"),
    ],
)
def test_words(text, expected):
    fresh = Anonymous(
        fleets.fig12(),
        {"tibi-nav": ["upstairs-nuc.lab.example.org"]},
        {"anna", "root"},
        ["http://annas-laptop:11311/ and /home/bert/ws", "http://wiki.ros.org/x"],
    )
    assert fresh.text(text) == expected


@pytest.mark.parametrize("name", [*NODES, *OTHERS])
def test_units_and_nodes_keep_their_names_beside_a_host_of_it(name):
    text = f"multimaster-{name}.service and /master_{name}" if name in NODES else f"multimaster-{name}.service"
    assert Anonymous(fleets.fig12(), {"tibi-nav": [name]}).text(text) == text


def test_addresses_in_texts_are_those_of_the_plan(other):
    fleet = fleets.fig12()
    new = other.data(fleet)
    for name, plan in fleet.computers.items():
        changed = new.computers[other.text(name)]
        assert other.text(f"from {plan.address}: x_{str(plan.address).replace('.', '_')}") == (
            f"from {changed.address}: x_{str(changed.address).replace('.', '_')}"
        )
        assert other.text(str(plan.network)) == str(changed.network) and changed.address in changed.network


@pytest.mark.parametrize("fleet", [fleets.fig12(), fleets.plan(12)], ids=["fig12", "plan"])
def test_nothing_of_the_old_names_and_addresses_is_left(fleet):
    seen = fleets.observed(fleet)
    other = Anonymous(fleet)
    text = json.dumps([to_plain(other.data(fleet)), [to_plain(entry) for entry in other.data(seen).values()]])
    before = json.dumps([to_plain(fleet), [to_plain(entry) for entry in seen.values()]])
    for name, plan in fleet.computers.items():
        for old in (name, plan.robot, str(plan.address), str(plan.common_address or plan.address)):
            if old not in ("", "router"):
                assert old in before and f'"{old}"' not in text and f"/{old}:" not in text, old
    assert "kobuki" not in text and "tibi" not in text


def test_a_name_in_capitals_is_replaced_also_as_a_key():
    other = Anonymous(fleets.fig12(), {"tibi-nav": ["PC1", "ROS"]})
    seen = {"PC1": {"ROS_MASTER_URI": "http://PC1:11311/"}, "TIBI": "", "TIBI-NAV": "", "ROS": "", "/TIBI/CMD": ""}
    assert other.data(seen) == {
        "robot1-computer1-name1": {"ROS_MASTER_URI": "http://robot1-computer1-name1:11311/"},
        **dict.fromkeys(["robot1", "robot1-computer1", "robot1-computer1-name2", "/robot1/CMD"], ""),
    }


def test_a_name_in_the_name_of_a_variable_is_replaced():
    """The set-up file of a robot may set such a variable; those of ROS stay."""
    other = Anonymous(fleets.plan(2), {"kobuki1computer": ["ros", "hostname"]})
    seen = {"KOBUKI1COMPUTER_IP": "", "ROS_IP_KOBUKI2": "", "ROS_HOSTNAME": "", "ROS_MASTER_URI": ""}
    found = other.data(seen)
    assert not any("kobuki" in name.lower() for name in found) and len(found) == 4
    assert list(found)[2:] == ["ROS_HOSTNAME", "ROS_MASTER_URI"]


def test_a_robot_named_like_a_word_of_ours_leaves_our_names(other):
    fleet = fleets.plan(2)
    assert "master_discovery" in Anonymous(fleet, {"kobuki1computer": ["master"]}).text("master_discovery of master")


@pytest.mark.parametrize("word", ["active", "Files", "up", "in", "accept", "tcp", "answered"])
def test_a_host_named_like_a_verdict_changes_no_answer(word):
    """Else one node with such a URI would change what all computers have seen."""
    other = Anonymous(fleets.fig12(), texts=[f"http://{word}:1/ http://lab-pc:1/"])
    assert other.data([word, word.lower(), "lab-pc"]) == [word, word.lower(), "host1"]
