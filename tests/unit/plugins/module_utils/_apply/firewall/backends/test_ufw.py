# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The rules of ufw, and where they go among those of others, over the files of ufw as it writes them.

tests/long/test_firewall.py has the real ufw.
"""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.backends import contract, ufw
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.packet_filter import (
    OpenPort,
    PacketFilter,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.deadman import FileBefore
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem

WANTED = PacketFilter(("10.5.0.1", "fd00::1"), ("10.6.0.0/24",), (OpenPort("tcp", 2222),))
OTHERS = "allow tcp 22 0.0.0.0/0 any 0.0.0.0/0 in"
ALLOW = "allow tcp 1024:65535 0.0.0.0/0 any 10.5.0.1 in"
DENY = "deny tcp 1024:65535 0.0.0.0/0 any 0.0.0.0/0 in"
OURS = " comment=726f73666c6565742e6d756c74696d6173746572"


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """A ufw whose rules are given, and the commands that it is asked to do."""
    files = {4: str(tmp_path / "user.rules"), 6: str(tmp_path / "user6.rules")}
    monkeypatch.setattr(ufw, "FILES", files)
    monkeypatch.setattr(ufw, "DEFAULTS", str(tmp_path / "defaults"))
    monkeypatch.setattr(contract, "find_program", lambda name: "/usr/sbin/" + name)
    (tmp_path / "defaults").write_text("IPV6=no\n")
    asked = []
    monkeypatch.setattr(contract, "run_or_fail", lambda argv: asked.append(" ".join(argv)))

    def hold(*texts):
        text = "".join(f"### tuple ### {rule}\n-A ufw-user-input ...\n\n" for rule in texts)
        (tmp_path / "user.rules").write_text("*filter\n### RULES ###\n\n" + text)
        return asked

    return hold


def test_rules_let_in_first_and_keep_out_last():
    found = ufw.list_rules(WANTED, [4, 6])
    assert [rule.is_allow for rule in found] == sorted((rule.is_allow for rule in found), reverse=True)
    texts = [rule.text for rule in found]
    assert ALLOW in texts and DENY in texts
    assert "allow udp 1024:65535 ::/0 any fd00::1 in" in texts
    assert "allow igmp any 0.0.0.0/0 any 0.0.0.0/0 in" in texts
    assert "route:allow any any 10.6.0.0/24 any 10.5.0.1 in" in texts
    assert "route:allow any any 10.5.0.1 any 10.6.0.0/24 in" in texts
    assert "route:deny udp 1024:65535 10.6.0.0/24 any 0.0.0.0/0 in" in texts
    assert "allow tcp 2222 ::/0 any ::/0 in" in texts


def test_ports_of_ssh_are_neither_opened_nor_closed():
    texts = [rule.text for rule in ufw.list_rules(WANTED._replace(open_ports=(), ssh=(2222,)), [4])]
    assert DENY not in texts and not any(" tcp 2222 " in text for text in texts)
    for ports in ("1024:2221", "2223:65535"):
        assert f"deny tcp {ports} 0.0.0.0/0 any 0.0.0.0/0 in" in texts
        assert f"route:deny tcp {ports} 10.6.0.0/24 any 0.0.0.0/0 in" in texts
    assert "deny udp 1024:65535 0.0.0.0/0 any 0.0.0.0/0 in" in texts


def test_the_words_of_ufw():
    rule = ufw.UfwRule("route:deny", "udp", "1024:65535", "10.6.0.0/24", "0.0.0.0/0")
    words = "from 0.0.0.0/0 to 10.6.0.0/24 port 1024:65535"
    assert " ".join(rule.command("insert", "3")) == (
        f"ufw route insert 3 deny proto udp {words} comment rosfleet.multimaster"
    )
    assert " ".join(rule.command("delete")) == f"ufw --force route delete deny proto udp {words}"
    assert ufw._parse_rule(rule.text) == rule


def test_only_ours_are_read(machine):
    machine(OTHERS, ALLOW + OURS, ALLOW + " comment=78")
    assert ufw.BackEnd(False, None).before == [ALLOW]


def test_a_robot_that_is_new_goes_on_top(machine):
    asked = machine(ALLOW + OURS, DENY + OURS, OTHERS)
    ufw.BackEnd(False, PacketFilter(("10.5.0.1", "10.5.0.2"), (), ())).load()
    news = [line for line in asked if "10.5.0.2" in line]
    assert news == [
        f"ufw prepend allow proto {protocol} from 10.5.0.2 to 0.0.0.0/0 port 1024:65535 comment rosfleet.multimaster"
        for protocol in ("udp", "tcp")
    ]
    assert not any("delete" in line for line in asked)


def test_a_closing_rule_goes_below_ours_and_above_others(machine):
    machine(ALLOW + OURS, OTHERS)
    assert ufw.BackEnd(False, None)._choose_position(4) == ("insert", "2")
    machine(OTHERS, ALLOW + OURS)
    assert ufw.BackEnd(False, None)._choose_position(4) == ()
    machine(OTHERS)
    assert ufw.BackEnd(False, None)._choose_position(4) == ("prepend",)


def test_a_rule_in_the_wrong_place_is_moved(machine):
    asked = machine(DENY + OURS, ALLOW + OURS, OTHERS)
    back_end = ufw.BackEnd(False, PacketFilter(("10.5.0.1",), (), ()))
    assert not back_end.is_ready_for_boot()
    back_end.load()
    assert asked[0] == "ufw --force delete deny proto tcp from 0.0.0.0/0 to 0.0.0.0/0 port 1024:65535"


def test_the_rules_that_keep_out_go_first(machine):
    asked = machine(ALLOW + OURS, DENY + OURS, OTHERS)
    ufw.BackEnd(False, None).load()
    assert [line.split()[3] for line in asked] == ["deny", "allow"]


def test_missing_rules_are_restored_in_their_places(machine):
    machine(ALLOW + OURS, ALLOW.replace("10.5.0.1", "10.5.0.2") + OURS, DENY + OURS, OTHERS)
    back_end = ufw.BackEnd(False, None)
    asked = machine(ALLOW + OURS, OTHERS)
    back_end.restore()
    assert [line.split(" proto")[0] for line in asked] == ["ufw prepend allow", "ufw insert 2 deny"]


def test_rules_that_were_not_there_are_taken_back(machine):
    machine(OTHERS)
    back_end = ufw.BackEnd(False, None)
    asked = machine(ALLOW + OURS, DENY + OURS, OTHERS)
    back_end.restore()
    assert [line.split()[3] for line in asked] == ["deny", "allow"]


def test_a_strange_rule_with_our_comment_is_named(machine):
    machine("limit tcp 22 0.0.0.0/0 any 0.0.0.0/0 in_eth0 x" + OURS)
    with pytest.raises(Problem, match="ufw has a rule with the comment rosfleet.multimaster that this module has not"):
        ufw.BackEnd(False, None).is_ready_for_boot()


def test_a_trial_leaves_the_files_as_they_were(machine, tmp_path, monkeypatch):
    machine(OTHERS)
    before = (tmp_path / "user.rules").read_bytes()
    monkeypatch.setattr(contract, "run_or_fail", lambda _argv: (tmp_path / "user.rules").write_text("new"))
    ufw.BackEnd(False, PacketFilter(("10.5.0.1",), (), ())).try_out()
    assert (tmp_path / "user.rules").read_bytes() == before


def test_a_file_that_was_not_there_goes_again(machine, tmp_path, monkeypatch):
    machine(OTHERS)
    new = tmp_path / "user6.rules"
    end = ufw.BackEnd(False, PacketFilter(("10.5.0.1",), (), ()))
    assert end.undo_steps()[1:] == [FileBefore(str(new), None), ["ufw", "reload"]]
    monkeypatch.setattr(contract, "run_or_fail", lambda _argv: new.write_text("new"))
    end.try_out()
    assert not new.exists()


def test_the_way_back_reloads_nothing_of_others(machine, tmp_path):
    machine(OTHERS)
    (tmp_path / "user6.rules").write_text("*filter\nCOMMIT\n")
    steps = ufw.BackEnd(False, PacketFilter(("10.5.0.1",), (), ())).undo_steps()
    assert [step[4:] for step in steps[2:]] == [
        ["iptables", "ufw", str(tmp_path / "user.rules")],
        ["ip6tables", "ufw6", str(tmp_path / "user6.rules")],
    ]
    assert ["ufw", "reload"] not in steps
