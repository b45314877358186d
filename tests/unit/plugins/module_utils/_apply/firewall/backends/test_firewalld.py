# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The policies of firewalld as text and as XML, and what a reload would lose.

tests/long/test_firewall.py has the real firewalld.
"""

import subprocess
import xml.etree.ElementTree as ET

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.backends import contract, firewalld
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.packet_filter import (
    OpenPort,
    PacketFilter,
)
from mentioned import mentions

WANTED = PacketFilter(("10.5.0.1", "fd00::1"), ("10.6.0.0/24",), (OpenPort("tcp", 2222),))
LISTING = """\
public (active)
  target: default
  interfaces: eth0
  ports: 8080/tcp

trusted
  target: ACCEPT
  interfaces:
  ports:
"""
OWN = "\n\nrosfleet-input (active)\n  priority: -14000\n"


@pytest.fixture(autouse=True)
def _inactive(monkeypatch):
    """No firewall-cmd of this computer is asked."""
    monkeypatch.setattr(firewalld.BackEnd, "is_active", lambda _self: False)


def test_rules_in_the_words_of_firewall_cmd():
    rules = firewalld.BackEnd(False, WANTED).after
    for rule in (
        'rosfleet-input: rule priority="-2" family="ipv4" source address="10.5.0.1" port port="1024-65535" protocol="tcp" accept',
        'rosfleet-input: rule priority="-2" family="ipv6" source address="fd00::1" port port="1024-65535" protocol="udp" accept',
        'rosfleet-input: rule priority="-2" protocol value="igmp" accept',
        'rosfleet-input: rule priority="-2" port port="2222" protocol="tcp" accept',
        'rosfleet-input: rule priority="-1" port port="1024-65535" protocol="udp" drop',
        'rosfleet-forward: rule priority="-2" family="ipv4" source address="10.5.0.1" destination address="10.6.0.0/24" accept',
        'rosfleet-forward: rule priority="-1" family="ipv4" destination address="10.6.0.0/24" port port="1024-65535" protocol="tcp" drop',
    ):
        assert rule in rules


def test_a_port_is_opened_to_the_protected_networks_alone():
    networks = ("10.6.0.0/24", "10.7.0.0/24")
    rules = firewalld.plan_policies(WANTED._replace(networks=networks))[firewalld.FORWARD]
    assert all(rule.destination for rule in rules)
    assert [rule.destination for rule in rules if rule.action == "accept" and rule.ports == "2222"] == list(networks)


def test_ports_of_ssh_are_neither_opened_nor_closed():
    rules = firewalld.BackEnd(False, WANTED._replace(open_ports=(), ssh=(2222,))).after
    assert not any('"2222"' in rule for rule in rules)
    for ports in ("1024-2221", "2223-65535"):
        assert f'rosfleet-input: rule priority="-1" port port="{ports}" protocol="tcp" drop' in rules
    assert 'rosfleet-input: rule priority="-1" port port="1024-65535" protocol="udp" drop' in rules


def test_files_hold_the_same_rules():
    files = {file["path"]: ET.fromstring(file["content"]) for file in firewalld.BackEnd(False, None).plan_files(WANTED)}
    assert sorted(files) == [
        "/etc/firewalld/policies/rosfleet-forward.xml",
        "/etc/firewalld/policies/rosfleet-input.xml",
    ]
    counted = sum(len(root.findall("rule")) for root in files.values())
    assert counted == len(firewalld.BackEnd(False, WANTED).after)
    root = files["/etc/firewalld/policies/rosfleet-input.xml"]
    assert root.attrib == {"target": "CONTINUE", "priority": "-14000"}
    assert root.find("egress-zone").attrib == {"name": "HOST"}
    assert root.find("rule/port").attrib == {"port": "1024-65535", "protocol": "tcp"}


def test_names_are_as_short_as_firewalld_wants_them():
    assert all(len(policy) <= 17 for policy in firewalld.plan_policies(WANTED))


def test_without_networks_nothing_is_said_about_what_passes():
    assert list(firewalld.plan_policies(WANTED._replace(networks=()))) == ["rosfleet-input"]


@pytest.mark.parametrize(
    ("permanent", "refused"),
    [
        (LISTING.replace(" (active)", "").replace("eth0", ""), False),
        (LISTING.replace(" 8080/tcp", ""), True),
    ],
)
def test_what_a_reload_would_lose_is_named(monkeypatch, tmp_path, permanent, refused):
    monkeypatch.setattr(firewalld, "FOLDER", str(tmp_path))
    monkeypatch.setattr(firewalld.BackEnd, "is_active", lambda _self: True)
    monkeypatch.setattr(contract, "run_or_fail", lambda argv: permanent if "--permanent" in argv else LISTING + OWN)
    sentence = firewalld.BackEnd(False, None).refusal()
    assert ("ports: 8080/tcp" in sentence) is refused
    assert bool(sentence) is refused


def test_a_firewalld_without_policies_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(firewalld, "FOLDER", str(tmp_path / "policies"))
    monkeypatch.setattr(firewalld.BackEnd, "is_active", lambda _self: True)
    assert mentions(firewalld.BackEnd(False, None).refusal(), "firewalld", f"{tmp_path}/policies", "0.9")


TOOL = """#!/bin/sh
case $0 in
*-save) cat "$STATE/${0##*/}" 2>/dev/null ;;
*-restore) cat >"$STATE/${0##*/}" ;;
*) echo "$@" >>"$STATE/calls"; exit $(cat "$STATE/status" 2>/dev/null || echo 0) ;;
esac
"""


@pytest.mark.parametrize("status", [0, 1])
def test_a_reload_takes_the_tables_of_iptables_over(tmp_path, status):
    """The script, with tools that keep what they are given."""
    for name in (
        "firewall-cmd",
        *(f"{tool}-{end}" for tool in ("iptables", "ip6tables") for end in ("save", "restore")),
    ):
        (tmp_path / name).write_text(TOOL)
        (tmp_path / name).chmod(0o755)
    (tmp_path / "iptables-save").with_name("state").mkdir()
    state = tmp_path / "state"
    (state / "iptables-save").write_text("*nat\n-A POSTROUTING -j MASQUERADE\nCOMMIT\n")
    (state / "status").write_text(str(status))
    environment = {"PATH": f"{tmp_path}:/usr/bin:/bin", "STATE": str(state)}
    assert subprocess.run(firewalld._RELOAD, env=environment, check=False).returncode == status
    assert (state / "calls").read_text() == "--reload\n"
    assert (state / "iptables-restore").read_text() == (state / "iptables-save").read_text()
    assert not (state / "ip6tables-restore").exists()  # it has none


def test_a_direct_rule_of_the_run_time_alone_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(firewalld, "FOLDER", str(tmp_path))
    monkeypatch.setattr(firewalld.BackEnd, "is_active", lambda _self: True)
    direct = "ipv4 filter INPUT 0 -p tcp --dport 82 -j DROP"
    monkeypatch.setattr(
        contract, "run_or_fail", lambda argv: direct if argv[1:] == ["--direct", "--get-all-rules"] else ""
    )
    assert (
        f"differs at run time from its files ({direct!r}".replace("'", '"') in firewalld.BackEnd(False, None).refusal()
    )
