# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A command in advice has the words that we gave it, whatever the values are; and nobody else makes one."""

import ast
import pathlib
import re
import shlex
import subprocess
from ipaddress import IPv4Network

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base import advice
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.fault import HANDS, INVENTORY
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.filters import DROPPED
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import FAULTS, Component
from hypothesis import given, settings
from hypothesis import strategies as st

TREE = pathlib.Path(__file__).resolve().parents[5] / "plugins/plugin_utils"
GOOD = {
    "device": ["eth0", "wlp3s0.100", "br-lan"],
    "number": ["0", "1500"],
    "address": ["192.168.1.5"],
    "name": ["dabo-nav", "dabo.nav"],
    "person": ["ann", "_apt", "ann.lee-2"],
    "unit": ["multimaster-sync.service", "user@1000.service"],
    "setting": ["net.ipv4.ip_forward", "net.ipv4.conf.eth0-1.rp_filter"],
    "file": ["/etc/sysctl.d/99-z.conf"],
    "drop-in": ["/run/systemd/system/multimaster-sync.service.d/a.conf"],
    "route": ["blackhole 1.2.3.0/24 table 7", "prohibit default"],
    "rule": ["priority 5 from all to 1.2.3.4 table 7", "priority 5 from all to 1.2.3.4 unreachable"],
    "chain": ["inet filter input", "ip filter ufw-user-input"],
    "graph": ["/cmd_vel", "/kobuki1/talker_17_1700000000"],
    "type": ["std_msgs/String", "actionlib_msgs/GoalID"],
    "what": ["multimaster-sync.service", "http://robot1:11311/", "robot1", "net.ipv4.ip_forward"],
}
PARTS = (
    "; reboot",
    "$(reboot)",
    "`id`",
    "\n",
    " ",
    "'",
    '"',
    "\\",
    "|sh",
    "&",
    "-f",
    "--",
    "*",
    "../",
    "\u0661",
    "{}",
    "~",
    "#",
)


@st.composite
def hostile(draw, form):
    """A good value with something put into it."""
    good = draw(st.sampled_from(GOOD[form]))
    at = draw(st.integers(0, len(good)))
    return good[:at] + draw(st.sampled_from(PARTS) | st.text(max_size=8)) + good[at:]


def test_each_form_has_its_good_values():
    assert set(GOOD) == set(advice.FORMS)
    for form, values in GOOD.items():
        for value in values:
            assert advice.command("do {} now", (form, value)), (form, value)
    assert advice.command("s/{}/x/", ("name", "a.b")) == r"s/a\.b/x/"


@pytest.mark.slow
@pytest.mark.parametrize("form", GOOD)
@given(st.data())
def test_a_command_has_the_words_that_it_was_given_or_is_none(form, data):
    text = data.draw(hostile(form) | st.text(max_size=30))
    made = advice.command("do '{}' {} now", (form, text), (form, text))
    if made:
        written = text.replace(*advice.SED_DOTS[form]) if form in advice.SED_DOTS else text
        quoted, *plain, last = shlex.split(made)[1:]
        assert (quoted, last) == (written, "now")
        assert form in advice.SED_DOTS or plain == text.split(" ")
        assert text.isascii() and not text.startswith(("-", "~", "#"))


@pytest.mark.parametrize("value", ["", None, "a" * 300, "256.1.1.1", "1.2.3", "\u0661"])
def test_what_has_not_its_form_makes_no_command(value):
    assert advice.command("ip address del {}/24", ("address", value)) == ""


TWO = [IPv4Network("192.168.20.0/24"), IPv4Network("192.168.1.0/24")]


def test_the_rules_between_networks_have_each_at_both_ends_in_their_order():
    made, nets = advice.accept_between(TWO, "ip nat POSTROUTING"), "192.168.1.0/24 192.168.20.0/24"
    rule = "nft insert rule ip nat POSTROUTING ip saddr $from ip daddr $to accept"
    assert made == f"for from in {nets}; do for to in {nets}; do {rule}; done; done"
    assert advice.accept_between(TWO, "ip nat POST;reboot") == ""
    assert advice.accept_at("daddr", TWO[:1], "", "ip t c") == "nft insert rule ip t c ip daddr 192.168.20.0/24 accept"


def test_no_match_is_more_than_words_to_a_shell():
    assert not [one.match for one in DROPPED.values() if set(one.match) & set("<>|&;()$`'\"\\")]


# A rule of nft for a size makes its table unreadable for iptables, so no table of iptables has one.
MATCHES = sorted({one.match.format(what=11311) for one in DROPPED.values() if "meta length" not in one.match})


@pytest.mark.root
@pytest.mark.parametrize("match", MATCHES)
def test_iptables_saves_and_loads_the_rules_with_their_networks(match, tmp_path):
    """A chain of iptables is saved at the next boot, or by the next program that has a rule: iptables-save prints no set of nft."""
    inserted = [
        advice.accept_at("saddr", TWO, match, "ip filter INPUT"),
        advice.accept_between(TWO, "ip nat POSTROUTING"),
    ]
    script = "iptables -P INPUT DROP; iptables -t nat -A POSTROUTING -j MASQUERADE; {}; iptables-save > $0; iptables-restore < $0; iptables-save"
    run = ["unshare", "--net", "sh", "-ec", script.format("; ".join(inserted)), str(tmp_path / "saved")]
    done = subprocess.run(run, capture_output=True, text=True, check=True)
    accepting = [line for line in done.stdout.splitlines() if line.endswith("-j ACCEPT")]
    own = [line for line in accepting if line.startswith("-A INPUT -s 192.168.")]
    between = [line for line in accepting if re.match(r"-A POSTROUTING -s 192[0-9./]+ -d 192[0-9./]+ ", line)]
    assert (len(own), len(between), len(accepting)) == (2, 4, 6), done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS, ids="-".join)
@given(what=st.text(min_size=1) | hostile("what"))
@settings(max_examples=20)  # of each finding
def test_a_remedy_holds_no_name_of_others_but_as_one_word(fault, what):
    good, part = Component(fault[0], "robot1", fault[1], "good"), Component(fault[0], "robot1", fault[1], what)
    for one, told in zip((*good.do(), *good.look()), (*part.do(), *part.look()), strict=True):
        if told.where == HANDS and one.where != HANDS:
            assert re.fullmatch(r'look at it on robot1: ("[^"]*"|[^" ]+) fits into no command', told.text)
        elif told.where not in (HANDS, INVENTORY):  # words may say anything: observations are quoted as they come in
            assert told.text == re.sub(r"\bgood\b", lambda _found: what, one.text)
            assert told == one or shlex.quote(what) == what and not what.startswith("-")


#: a program that people are told to run, with what follows it
PROGRAM = re.compile(
    r"\b(?:ip|ss|iw|nft|sed|grep|mv|rm|cp|cat|chmod|getent|runuser|sysctl|systemctl|journalctl|iptables|arping|ping|tcpdump|chronyc|"
    r"ros(?:node|topic|service|param|msg)|ansible|ansible-playbook|sudo|sh|bash|ufw|firewall-cmd|nmcli|netplan|curl|apt|apt-get) "
    r"(?:[-a-z/{]|$)"
)
#: file -> why it may put values into a text that begins as a command
OTHERS = {
    "_base/advice.py": "it is the one",
    "_faults/fault.py": "texts of ours, filled by Advice.fill, which asks it",
    "_verify/diagnose/commands.py": "the place is planned, and each command is one of advice.command",
    "_verify/diagnose/node_remedies.py": "variables of ours; the unit is put in by advice.command",
    "_plan/preflight.py": "before and after a command of ours; the one with an interface is of advice.command",
    "_plan/providers.py": "before a command of ours",
    "_features/multicast_routing/plan.py": "before a command of ours",
    "_plan/environment.py": "before a command of ours",
    "_plan/parameters.py": "before a command of ours",
    "_predict/prediction.py": "before a command of ours",
}


def formatted(path):
    """The texts with values in a file: f-strings and .format()."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.JoinedStr) and any(isinstance(part, ast.FormattedValue) for part in node.values):
            yield "".join(part.value if isinstance(part, ast.Constant) else "{" for part in node.values)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "format":
            yield ast.unparse(node.func.value)


def test_nobody_else_puts_values_into_a_command():
    found = {
        path.relative_to(TREE).as_posix(): text
        for path in sorted(TREE.rglob("*.py"))
        for text in formatted(path)
        if PROGRAM.search(text)
    }
    assert set(found) <= set(OTHERS), {name: text for name, text in found.items() if name not in OTHERS}
