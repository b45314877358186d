# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Kernel settings on a robot: what the kernel changes beside a key. With a drop-in and a record beside those of the fleet."""

from setups.links import wait_until

HOST = "kobuki2computer"
TAKEN_BACK = "/run/rosfleet-multimaster/rollback-sysctl/rolled_back"
PLACES = {"drop_in": "/etc/sysctl.d/91-test.conf", "records": "/var/lib/test-of-kernel-settings"}
RP_FILTER = [
    {"name": "net.ipv4.conf.eth0.rp_filter", "value": 0},
    {"name": "net.ipv4.conf.default.rp_filter", "value": 2},
]


def values(lab, *names):
    return lab.run(HOST, f"sysctl -n {' '.join(names)}").split()


def settings(lab, *listed):
    return lab.module(HOST, "sysctl", {"settings": list(listed), **PLACES})


def test_a_default_of_all_interfaces_but_one_also_after_a_boot(lab):
    names = [f"net.ipv4.conf.{name}.rp_filter" for name in ("default", "eth0", "lo")]
    before = values(lab, *names)
    status, output = settings(lab, *RP_FILTER)
    assert status == 0 and "CHANGED" in output, output
    assert values(lab, *names)[:2] == ["2", "0"]
    status, output = settings(lab, *RP_FILTER)
    assert status == 0 and "SUCCESS" in output, output

    lab.reboot(HOST)
    lab.wait_until_up(HOST)
    assert values(lab, *names)[:2] == ["2", "0"]
    assert settings(lab)[0] == 0
    assert values(lab, *names) == before


def test_a_failure_brings_back_an_interface_that_was_set_by_hand(lab):
    names = [f"net.ipv6.conf.{name}.disable_ipv6" for name in ("all", "default", "eth0", "lo")]
    lab.run(HOST, "sysctl -qw net.ipv6.conf.all.disable_ipv6=1 net.ipv6.conf.all.disable_ipv6=0")
    lab.run(HOST, "sysctl -qw net.ipv6.conf.eth0.disable_ipv6=1")
    status, output = settings(
        lab,
        {"name": "net.ipv6.conf.all.disable_ipv6", "value": True},
        {"name": "net.ipv4.ip_local_port_range", "value": "9 1"},
    )
    assert status != 0 and "the kernel refuses the value 9 1" in output, output
    assert values(lab, *names) == ["0", "0", "1", "0"]
    assert lab.run(HOST, f"ls -d {PLACES['drop_in']} {PLACES['records']} 2>/dev/null", check=False) == ""


OFF = {"name": "net.ipv6.conf.all.disable_ipv6", "value": True}
REFUSED = {"name": "net.ipv4.ip_local_port_range", "value": "9 1"}
LOOK = "ip -6 rule; ip -6 route show table all | grep -v 'proto kernel'; ip -6 address show dev eth0 scope global"


def test_what_others_made_comes_back_with_ipv6(lab, run_by_hand):
    """The kernel removes all addresses and routes of IPv6 where it is turned off."""
    lab.run(
        HOST,
        "sysctl -qw net.ipv6.conf.eth0.disable_ipv6=0; ip address add fd00:77::9/64 dev eth0 nodad; ip -6 route add fd00:78::/64 via fd00:77::1; "
        "ip -6 route add default via fd00:77::1 table 100; ip -6 rule add from fd00:77::/64 lookup 100",
    )
    before = lab.run(HOST, LOOK)
    assert before.count("fd00:77::1") == 2
    status, output = settings(lab, OFF, REFUSED)
    assert status != 0 and "and so are the addresses and routes of IPv6 that the kernel removed" in output, output
    assert lab.run(HOST, LOOK) == before

    # The machine takes it back by itself; the run that confirms too late looks, and puts back what the script cannot know.
    switch = {**PLACES, "confirmation": "test"}
    assert run_by_hand("sysctl", settings=[OFF], **switch, confirm_within=3)["unconfirmed"]
    assert "fd00:77" not in lab.run(HOST, "ip -6 address; ip -6 route show table all")
    wait_until(lambda: lab.run(HOST, f"ls {TAKEN_BACK}", check=False), 120, "the machine has taken the setting back")
    answer = run_by_hand("sysctl", settings=[OFF], **switch)
    assert answer["failed"] and "has taken them back and is as it was before" in answer["msg"], answer
    assert lab.run(HOST, LOOK) == before
    lab.run(HOST, "ip -6 rule del from fd00:77::/64 lookup 100; ip address del fd00:77::9/64 dev eth0")
