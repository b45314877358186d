# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""multicast_verify between computers of namespaces.py: who hears whom, who is deaf, and what stays behind (nothing)."""

import os
import shutil
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import namespaces
import pytest

GROUP, PORT = "226.0.0.0", 11511
QUICK = {"rounds": 5, "interval": 0.05, "icmp": False}

pytestmark = pytest.mark.skipif(bool(namespaces.why_not()), reason=namespaces.why_not() or "can run")


class Network(namespaces.Network):
    """Computers that measure each other."""

    def module(self, host, fails=False, **options):
        """Run the module on host; its result."""
        computers = [{"name": item.name, "address": item.address} for item in self.hosts]
        arguments = {"name": host.name, "interface_address": host.address, "computers": computers, "run": "test"}
        return self.run_module(host, "multicast_verify", {**arguments, **options}, fails)

    def task(self, forks, **options):
        """Run the module on every computer, as a task with --forks."""
        with ThreadPoolExecutor(forks) as pool:
            return list(pool.map(lambda host: self.module(host, **options), self.hosts))

    def measure(self, forks):
        self.task(forks, action="start")
        return self.task(forks, action="collect", **QUICK)


@pytest.fixture
def network(tmp_path):
    made = []

    def make(count):
        made.append(Network(count, tmp_path))
        return made[0]

    yield make
    for item in made:
        item.end()


def until(condition, seconds):
    """Wait until condition holds; whether it did in time."""
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)
    return condition()


# A discovery node's sockets, held by another user; it prints the length and the source of all that it receives.
NODE = """
import os, select, socket, struct, sys
group, port, address, names = sys.argv[1], int(sys.argv[2]), sys.argv[3], sys.argv[4:]
os.setgid(65534); os.setuid(65534)
sockets = []
for name in names:
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
    one.bind((name, port))
    sockets.append(one)
member = struct.pack('4s4s', socket.inet_aton(group), socket.inet_aton(address))
sockets[-1].setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
print('ready', flush=True)
while True:
    for one in select.select([*sockets, sys.stdin], [], [])[0]:
        if one is sys.stdin:
            sys.exit()
        data, source = one.recvfrom(1024)
        print(len(data), source[0], data.decode() or '-', flush=True)
"""


def node(host, *names):
    """Start the sockets of a discovery node: bound to these addresses, the last one joins the group."""
    process = host.popen(sys.executable, "-c", NODE, GROUP, str(PORT), host.address, *names)
    assert process.stdout.readline() == "ready\n"
    return process


def received(process):
    return [line.split() for line in process.communicate(timeout=5)[0].splitlines()]


@pytest.mark.slow
def test_everyone_hears_everyone_one_after_the_other(network):
    net = network(3)
    for host in net.hosts:
        host.run("sh", "-c", "echo 0 > /proc/sys/net/ipv4/icmp_echo_ignore_broadcasts")
    net.hosts[2].run("sh", "-c", "echo 1 > /proc/sys/net/ipv4/icmp_echo_ignore_broadcasts")
    net.hosts[1].run("ip", "address", "add", "192.168.1.77/24", "dev", "eth0")
    net.task(3, action="start")
    stranger = (
        "import socket; s = socket.socket(2, 2); s.bind(('192.168.1.77', 0)); s.sendto(b'x', ('226.0.0.0', 11511))"
    )
    net.hosts[1].run(sys.executable, "-c", stranger)
    first, *rest = net.hosts
    results = [net.module(first, action="collect", **{**QUICK, "icmp": True, "rounds": 1})]
    results += [net.module(host, action="collect", **QUICK) for host in rest]
    for host, result in zip(net.hosts, results):
        others = [item for item in net.hosts if item is not host]
        assert result["multicast_ok"], result["msg"]
        assert result["heard"] == [item.name for item in others]
        assert result["missing"] == result["unanswered"] == []
        assert not result["changed"]
        assert result["send_errors"] == {"count": 0, "last": None}
        assert result["route"] == {"device": "eth0", "source": host.address}
        for entry, other in zip(result["udp"], others):
            assert entry["heard_from"] and entry["heard_by"] and entry["unicast"]
            assert (entry["loss"], entry["heard"] > 0) == (0, True)
            assert entry["source_address"] == entry["address"] == other.address
            assert entry["own_source_address"] == host.address
            assert 0 < entry["rtt_ms"]["min"] <= entry["rtt_ms"]["median"] <= entry["rtt_ms"]["max"] < 1000
            assert abs(entry["clock_offset_s"]) < 0.1 + entry["rtt_ms"]["max"] / 2000
        # what the measurement itself joined is not in the list
        assert [item["group"] for item in result["memberships"] if item["interface"] == "eth0"].count(GROUP) == 0
    assert [item["address"] for item in results[0]["unexpected"]] == ["192.168.1.77"]
    assert results[1]["unexpected"] == []  # its own second address
    icmp = results[0]["icmp"]
    assert icmp["echo_ignore_broadcasts"] == 0 and icmp["error"] is None
    names = [host.name for host in net.hosts]
    assert icmp["rounds"] == [{"round": 1, "answered": names[1:2], "missing": names[2:], "unexpected": []}]
    # everybody has measured: the helpers end by themselves and leave nothing
    assert until(lambda: not any(host.processes() for host in net.hosts), 5)
    assert first.run("ls", "/run") == ""
    assert "lifetime" in net.module(first, fails=True, action="collect")["msg"]


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("iptables"), reason="needs iptables, to drop the group")
def test_a_dropped_group_is_missing_in_its_direction(network):
    net = network(3)
    first, second, deaf = net.hosts
    deaf.run("iptables", "-A", "INPUT", "-d", GROUP, "-j", "DROP")
    results = net.measure(forks=2)
    for result in results[:2]:
        assert result["missing"] == [deaf.name] and not result["multicast_ok"]
        entry = result["udp"][-1]
        assert (entry["heard_from"], entry["heard_by"], entry["loss"], entry["unicast"]) == (True, False, 1, True)
        assert f"Do not hear this computer on the group: {deaf.name}." in result["msg"]
        assert "IGMP snooping" in result["msg"]
    assert results[2]["missing"] == [first.name, second.name] and results[2]["heard"] == []
    assert [entry["heard_by"] for entry in results[2]["udp"]] == [True, True]


@pytest.mark.slow
def test_a_discovery_node_of_another_user_keeps_its_port(network):
    net = network(3)
    first, second, third = net.hosts
    nodes = [node(second, second.address, GROUP), node(third, "")]
    sender = (
        "import socket, time\nfor n in range(60):\n for a in ('192.168.1.2', '192.168.1.3'):\n"
        "  socket.socket(2, 2).sendto(b'%d' % n, (a, 11511))\n time.sleep(0.05)\n"
    )
    sending = first.popen(sys.executable, "-c", sender)
    results = net.measure(forks=3)
    sending.wait(timeout=10)
    assert all(result["multicast_ok"] for result in results)
    for process in nodes:
        lines = received(process)
        # every unicast datagram from outside arrived, though each came from a new port
        assert [int(text) for length, source, text in lines if text != "-"] == list(range(60))
        # and all that the measurement brought is empty
        assert {source for length, source, text in lines if text == "-"} >= {first.address}
        assert all(length == "0" for length, source, text in lines if text == "-")
    assert second.name in results[0]["heard"]


@pytest.mark.slow
def test_a_new_helper_ends_the_older_one_and_lifetime_ends_it(network):
    net = network(2)
    host = net.hosts[0]
    net.module(host, action="start", run="killed")
    for pid in host.processes():
        os.kill(pid, 9)  # leaves its door behind, which does not hinder the next one
    net.module(host, action="start", run="yesterday")
    older = host.processes()
    other = net.module(host, fails=True, action="collect", run="yesterday", port=11512)
    assert "started with other options" in other["msg"]
    net.module(host, action="start")
    newer = host.processes()
    assert len(older) == len(newer) == 1 and older != newer
    (door,) = host.run("sh", "-c", "echo /run/rosfleet-multimaster/*").split()
    assert "test" not in door, "the label that seals the messages is not in what everybody can read"
    assert host.run("stat", "-c", "%a %u", door) == "600 0\n"
    net.module(host, action="start", lifetime=1)  # looks at a helper would take some of that
    assert until(lambda: not host.processes(), 20)


@pytest.mark.slow
def test_a_playbook_with_the_former_words_measures(network):
    net = network(2)
    net.task(2, state="started")
    results = net.task(2, state="collected", **QUICK)
    assert all(result["multicast_ok"] for result in results)
    assert "multicast_ok" not in net.module(net.hosts[0], state="listed")


def test_check_mode_and_list_send_nothing(network):
    net = network(2)
    host = net.hosts[0]
    result = net.module(host, action="start", _ansible_check_mode=True)
    assert "Check mode" in result["msg"] and not host.processes()
    assert {"interface": "eth0", "family": "ipv4", "group": "224.0.0.1"}.items() <= next(
        item for item in result["memberships"] if item["interface"] == "eth0"
    ).items()
    assert any(item["family"] == "ipv6" and item["group"] == "ff02::1" for item in result["memberships"])
    assert result["interface"] == "eth0"
    wrong = net.module(host, fails=True, action="start", computers=[{"name": host.name, "address": "10.9.9.9"}])
    assert "10.9.9.9" in wrong["msg"] and host.address in wrong["msg"]
