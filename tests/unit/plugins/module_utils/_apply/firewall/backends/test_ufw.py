# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The rules of ufw, and where they go among those of others, over the files of ufw as it writes them.

tests/long/test_firewall.py has the real ufw.
"""

import json
import subprocess
import sys
import threading

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.backends import contract, ufw
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.packet_filter import (
    OpenPort,
    PacketFilter,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.deadman import FileBefore
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from namespaces import why_not

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
    monkeypatch.setattr(ufw, "LOCK", str(tmp_path / "lock"))
    monkeypatch.setattr(contract, "find_program", lambda name: "/usr/sbin/" + name)
    (tmp_path / "defaults").write_text("IPV6=no\n")
    asked = []
    monkeypatch.setattr(contract, "run_or_fail", asked.append)

    def hold(*texts):
        text = "".join(f"\n### tuple ### {rule}\n-A ufw-user-input -j X\n" for rule in texts)
        (tmp_path / "user.rules").write_text(f"*filter\n### RULES ###\n{text}\n### END RULES ###\nCOMMIT\n")
        return asked

    return hold


@pytest.fixture
def rules(tmp_path):
    """The rules in the file of IPv4, in their order."""
    return lambda: [line[14:] for line in (tmp_path / "user.rules").read_text().splitlines() if "tuple" in line]


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


# By ufw 0.36.2 of Debian 12, of the commands `ufw prepend allow proto tcp from 10.5.0.1 to any port 1024:65535`, `ufw route prepend allow
# from 10.5.0.1 to 10.6.0.0/24`, `ufw allow proto igmp` and so on, each with our comment.
WRITTEN = """
### tuple ### allow tcp 1024:65535 0.0.0.0/0 any 10.5.0.1 in{0}
-A ufw-user-input -p tcp -m multiport --dports 1024:65535 -s 10.5.0.1 -j ACCEPT

### tuple ### allow udp 2222 ::/0 any ::/0 in{0}
-A ufw6-user-input -p udp --dport 2222 -j ACCEPT

### tuple ### allow igmp any 0.0.0.0/0 any 0.0.0.0/0 in{0}
-A ufw-user-input -p igmp -j ACCEPT

### tuple ### route:allow any any 10.6.0.0/24 any 10.5.0.1 in{0}
-A ufw-user-forward -d 10.6.0.0/24 -s 10.5.0.1 -j ACCEPT

### tuple ### route:deny udp 1024:65535 10.6.0.0/24 any 0.0.0.0/0 in{0}
-A ufw-user-forward -p udp -m multiport --dports 1024:65535 -d 10.6.0.0/24 -j DROP

### tuple ### deny tcp 1024:65535 ::/0 any ::/0 in{0}
-A ufw6-user-input -p tcp -m multiport --dports 1024:65535 -j DROP
"""


def test_rules_are_written_as_ufw_writes_them():
    written = WRITTEN.format(OURS)
    found = [ufw._parse_rule(line[14 : -len(OURS)]) for line in written.splitlines() if "tuple" in line]
    assert "".join(rule.render() for rule in found) == written


def test_only_ours_are_read(machine):
    machine(OTHERS, ALLOW + OURS, ALLOW + " comment=78")
    assert ufw.BackEnd(False, None).before == [ALLOW]


def test_a_robot_that_is_new_goes_on_top(machine, rules):
    machine(ALLOW + OURS, DENY + OURS, OTHERS)
    ufw.BackEnd(False, PacketFilter(("10.5.0.1", "10.5.0.2"), (), ())).load()
    news = [f"allow {protocol} 1024:65535 0.0.0.0/0 any 10.5.0.2 in{OURS}" for protocol in ("tcp", "udp")]
    assert [rule for rule in rules() if "10.5.0.2" in rule] == news
    assert rules()[-4:] == [ALLOW + OURS, DENY.replace("tcp", "udp") + OURS, DENY + OURS, OTHERS]


def test_a_closing_rule_goes_below_ours_and_above_others(machine, rules):
    wanted = [ufw._parse_rule(rule) for rule in (ALLOW, DENY)]
    for before, after in (
        ([ALLOW + OURS, OTHERS], [ALLOW + OURS, DENY + OURS, OTHERS]),
        ([OTHERS, ALLOW + OURS], [OTHERS, ALLOW + OURS, DENY + OURS]),
        ([OTHERS], [ALLOW + OURS, DENY + OURS, OTHERS]),
    ):
        machine(*before)
        ufw.BackEnd(False, None)._arrange(wanted)
        assert rules() == after


def test_a_rule_in_the_wrong_place_is_moved(machine, rules):
    machine(DENY + OURS, ALLOW + OURS, OTHERS)
    back_end = ufw.BackEnd(False, PacketFilter(("10.5.0.1",), (), ()))
    assert not back_end.is_ready_for_boot()
    back_end.load()
    assert back_end.is_ready_for_boot() and rules().count(DENY + OURS) == 1 and rules()[-1] == OTHERS


def test_missing_rules_are_restored_in_their_places(machine, rules):
    before = [ALLOW + OURS, ALLOW.replace("10.5.0.1", "10.5.0.2") + OURS, DENY + OURS, OTHERS]
    machine(*before)
    back_end = ufw.BackEnd(False, None)
    machine(ALLOW + OURS, OTHERS)
    back_end.restore()
    assert sorted(rules()) == sorted(before) and rules()[2:] == [DENY + OURS, OTHERS]


def test_what_is_not_ours_stays_to_the_byte(machine, tmp_path):
    asked = machine(OTHERS, ALLOW + " comment=78", DENY)
    file = tmp_path / "user.rules"
    before = file.read_bytes()
    ufw.BackEnd(False, WANTED).load()
    assert ALLOW + OURS in file.read_text() and len(asked) == 1
    ufw.BackEnd(False, None).load()
    assert file.read_bytes() == before


def test_a_large_fleet_is_one_step_of_the_kernel_for_each_version(machine, tmp_path):
    asked = machine(OTHERS)
    (tmp_path / "user6.rules").write_text("*filter\n### RULES ###\nCOMMIT\n")
    (tmp_path / "defaults").write_text("IPV6=yes\n")
    members = tuple(f"10.5.0.{number}" for number in range(1, 31)) + ("fd00::1",)
    ufw.BackEnd(False, WANTED._replace(members=members)).load()
    assert [argv[4:6] for argv in asked] == [["iptables", "ufw"], ["ip6tables", "ufw6"]]
    assert "fd00::1" in (tmp_path / "user6.rules").read_text()


def test_a_file_of_another_form_is_named(machine, tmp_path):
    machine(OTHERS)
    (tmp_path / "user.rules").write_text("*filter\nCOMMIT\n")
    with pytest.raises(Problem, match="user.rules has no line '### RULES ###'"):
        ufw.BackEnd(False, WANTED).load()


def test_a_command_of_ufw_that_holds_its_lock_is_waited_for(machine, rules, tmp_path, monkeypatch):
    machine(OTHERS)
    monkeypatch.setattr(ufw, "_WAIT", 0.2)
    held = "import fcntl, sys\nf = open(sys.argv[1], 'w')\nfcntl.lockf(f, fcntl.LOCK_EX)\nprint(flush=True)\ninput()"
    words = [sys.executable, "-c", held, str(tmp_path / "lock")]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        other.stdout.readline()
        with pytest.raises(Problem, match="A command of ufw holds .*lock"):
            ufw.BackEnd(False, WANTED).load()
        assert rules() == [OTHERS]
        monkeypatch.setattr(ufw, "_WAIT", 60)
        end = threading.Timer(0.3, other.stdin.close)
        end.start()
        ufw.BackEnd(False, WANTED).load()
        assert ALLOW + OURS in rules()
        end.join()


def test_a_strange_rule_with_our_comment_is_named(machine):
    machine("limit tcp 22 0.0.0.0/0 any 0.0.0.0/0 in_eth0 x" + OURS)
    with pytest.raises(Problem, match="ufw has a rule with the comment rosfleet.multimaster that this module has not"):
        ufw.BackEnd(False, None).is_ready_for_boot()


def test_a_trial_leaves_the_files_as_they_were(machine, tmp_path, monkeypatch):
    machine(OTHERS)
    before = (tmp_path / "user.rules").read_bytes()
    seen = []
    monkeypatch.setattr(contract, "run_or_fail", lambda _argv: seen.append((tmp_path / "user.rules").read_bytes()))
    ufw.BackEnd(False, PacketFilter(("10.5.0.1",), (), ())).try_out()
    assert (tmp_path / "user.rules").read_bytes() == before != seen[0]


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
        ["iptables", "ufw", str(tmp_path / "user.rules"), ""],
        ["ip6tables", "ufw6", str(tmp_path / "user6.rules"), ""],
    ]
    assert ["ufw", "reload"] not in steps


# A program on a computer of its own: the real iptables, the old one, with its one lock for all programs.
REAL = """
import json, subprocess, sys, time
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.backends import ufw
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.packet_filter import PacketFilter
folder = sys.argv[1]
ufw.FILES = {4: folder + "/user.rules", 6: folder + "/user6.rules"}
ufw.LOCK = folder + "/lock"
ufw._TOOLS = {4: ("iptables-legacy", "ufw"), 6: ("ip6tables-legacy", "ufw6")}
run = lambda *words: subprocess.run(words, check=True, capture_output=True, text=True).stdout
for version, (tool, name) in ufw._TOOLS.items():
    with open(ufw.FILES[version], "w") as stream:
        chains = "".join(f":{name}-user-{chain} - [0:0]\\n" for chain in ("input", "forward"))
        stream.write(f"*filter\\n{chains}### RULES ###\\n\\n### END RULES ###\\nCOMMIT\\n")
    run(tool + "-restore", "-n", ufw.FILES[version])
run("iptables-legacy", "-N", "ENGINE")
run("iptables-legacy", "-A", "ENGINE", "-p", "tcp", "--dport", "9", "-j", "DROP")
fleet = PacketFilter(tuple(f"10.5.0.{number}" for number in range(1, 31)) + ("fd00::1",), ("10.6.0.0/24",), ())
lock = subprocess.Popen(["flock", "/run/xtables.lock", "sh", "-c", "echo; sleep 1"], stdout=subprocess.PIPE)
lock.stdout.readline()
started = time.monotonic()
wanted = ufw.list_rules(fleet, [4, 6])
ufw.BackEnd(False, None)._arrange(wanted)
took = time.monotonic() - started
both = lambda: "".join(run(tool + "-save") for tool in ("iptables-legacy", "ip6tables-legacy")).splitlines()
loaded = [line for line in both() if line.startswith("-A")]
ufw.BackEnd(False, None)._arrange([])
print(json.dumps({"wanted": len(wanted), "took": took, "loaded": loaded, "left": [line for line in both() if line.startswith("-A")]}))
"""
WITH_LEGACY = ("sh", "-c", "iptables-legacy -S && ip6tables-legacy -S")


@pytest.mark.root
@pytest.mark.skipif(bool(why_not(*WITH_LEGACY)), reason=why_not(*WITH_LEGACY))
def test_the_lock_of_iptables_is_waited_for_and_rules_of_others_stay(tmp_path):
    words = ["sh", "-c", 'mount -t tmpfs none /run && exec "$@"', "sh", sys.executable, "-c", REAL, str(tmp_path)]
    answer = subprocess.run(["unshare", "--net", "--mount", *words], check=True, capture_output=True, text=True)
    seen = json.loads(answer.stdout)
    engine = "-A ENGINE -p tcp -m tcp --dport 9 -j DROP"
    assert seen["took"] > 0.5 and seen["left"] == [engine]
    assert len(seen["loaded"]) == seen["wanted"] + 1 == 130 and engine in seen["loaded"]
    assert "-A ufw-user-forward -s 10.5.0.30/32 -d 10.6.0.0/24 -j ACCEPT" in seen["loaded"]
    assert "-A ufw6-user-input -s fd00::1/128 -p tcp -m multiport --dports 1024:65535 -j ACCEPT" in seen["loaded"]
