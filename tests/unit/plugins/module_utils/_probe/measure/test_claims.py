# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The computers that answer for an address: real questions on a real network of three computers, and what is read of messages."""

import json
import subprocess
import sys
import threading
import time

import namespaces
import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.network import Address, NetworkInterface
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import claims

ASK = """
import json, sys
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import claims
print(json.dumps(claims.claims(sys.argv[1:])))
"""
MACS = """
import json
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import network
print(json.dumps(network.forwarding()["macs"]))
"""
ROUTES = """Iface\tDestination\tGateway \tFlags\tRefCnt\tUse\tMetric\tMask\t\tMTU\tWindow\tIRTT
eth0\t00000000\t0101A8C0\t0003\t0\t0\t0\t00000000\t0\t0\t0
eth0\t0001A8C0\t00000000\t0001\t0\t0\t0\t00FFFFFF\t0\t0\t0
"""


@pytest.fixture
def computers(tmp_path):
    if namespaces.why_not():
        pytest.skip(namespaces.why_not())
    found = namespaces.Network(3, tmp_path)
    yield found.hosts
    found.end()


def run_script(host, script, *words):
    environment = {**namespaces.os.environ, "PYTHONPATH": str(namespaces.COLLECTIONS)}
    return json.loads(host.run(sys.executable, "-c", script, *words, env=environment))


def asked(host, *addresses):
    return {entry["address"]: entry["macs"] for entry in run_script(host, ASK, *addresses)}


def mac(host, interface="eth0"):
    return json.loads(host.run("ip", "-json", "link", "show", interface))[0]["address"]


@pytest.mark.slow
def test_two_computers_with_one_address_are_both_heard(computers):
    one, twin, third = computers
    assert asked(third, one.address) == {third.address: [], one.address: [mac(one)]}
    twin.run("ip", "address", "add", f"{one.address}/24", "dev", "eth0")
    assert sorted(asked(third, one.address)[one.address]) == sorted([mac(one), mac(twin)])
    assert asked(one)[one.address] == [mac(twin)]


@pytest.mark.slow
def test_an_interface_below_a_macvlan_answers_and_is_told(computers):
    """Both answer for the address, though it is on the upper one alone; so the computer tells both hardware addresses."""
    one, asker, _third = computers
    one.run("ip", "address", "flush", "dev", "eth0")
    one.run("ip", "link", "add", "upper", "link", "eth0", "type", "macvlan", "mode", "bridge")
    one.run("ip", "address", "add", f"{one.address}/24", "dev", "upper")
    one.run("ip", "link", "set", "upper", "up")
    one.run("mount", "-t", "sysfs", "sysfs", "/sys")  # that of its own interfaces
    both = sorted([mac(one), mac(one, "upper")])
    assert sorted(asked(asker, one.address)[one.address]) == both
    assert sorted(run_script(one, MACS)) == both
    one.run("sysctl", "-q", "-w", "net.ipv4.conf.eth0.arp_ignore=8")  # as preflight plans it
    assert asked(asker, one.address)[one.address] == [mac(one, "upper")]


@pytest.mark.slow
def test_a_gateway_is_asked_for_and_questions_change_no_table(computers):
    one, gateway, _third = computers
    one.run("ip", "route", "add", "10.0.0.0/8", "via", gateway.address)
    assert asked(one) == {one.address: [], gateway.address: [mac(gateway)]}
    assert gateway.run("ip", "neighbour", "show") == ""


def test_where_the_kernel_does_not_allow_it_nothing_is_known():
    command = ["runuser", "-u", "nobody", "--", sys.executable, "-c", ASK, "127.0.0.1"]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, env={"PYTHONPATH": str(namespaces.COLLECTIONS)}
        )
    except OSError:
        pytest.skip("needs runuser")
    if done.returncode:
        pytest.skip("the user nobody cannot read the collection here")
    assert json.loads(done.stdout) == []


def test_own_addresses_are_asked_for_first():
    wired = NetworkInterface(
        "eth0", up=True, addresses=(Address("192.168.1.5", 24, "inet"), Address("fe80::1", 64, "inet6"))
    )
    off = NetworkInterface("eth1", up=False, addresses=(Address("10.0.0.1", 8, "inet"),))
    tunnel = NetworkInterface("wg0", up=True, point_to_point=True, addresses=(Address("10.0.0.1", 8, "inet"),))
    found = claims.questions([wired, off, tunnel], ["192.168.1.9", "10.0.0.2", "192.168.1.9", "192.168.1.5"])
    assert found == [("eth0", "192.168.1.5"), ("eth0", "192.168.1.9")]


def test_gateways_are_read_out_of_the_kernels_table():
    assert claims.gateways(ROUTES) == ["192.168.1.1"]
    assert claims.gateways("") == []


def test_a_storm_of_arp_is_heard_no_longer_than_an_answer_takes(monkeypatch):
    class Storm:
        def recvfrom(self, _size):
            return claims.question(bytes(6), "192.168.1.9"), ("eth0",)

    monkeypatch.setattr(claims.select, "select", lambda *sets: sets[:3])
    wanted = {("eth0", "192.168.1.9"): []}
    thread = threading.Thread(target=claims._gather, args=(Storm(), wanted, time.monotonic() + 0.2), daemon=True)
    thread.start()
    thread.join(20)
    assert not thread.is_alive() and wanted == {("eth0", "192.168.1.9"): []}


def test_an_answer_is_read_and_anything_else_is_none():
    question = claims.question(bytes(range(6)), "192.168.1.9")
    assert len(question) == 28 and claims.answer(question) is None
    told = question[:7] + b"\x02" + question[8:14] + bytes([192, 168, 1, 9]) + question[18:]
    assert claims.answer(told + bytes(18)) == ("192.168.1.9", "00:01:02:03:04:05")
    assert claims.answer(told[:20]) is None and claims.answer(b"") is None
