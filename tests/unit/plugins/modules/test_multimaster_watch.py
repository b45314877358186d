# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""multimaster_watch between computers: each is a network and mount namespace of its own, on a bridge in another."""

import sys
import time

import namespaces
import pytest

# A discovery node's part that is heard: member of the group, one heartbeat in a tenth of a second that promises ten a second.
HEART = """
import socket, sys, time
own, other = sys.argv[1:3]
ear = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
ear.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton("226.0.0.0") + socket.inet_aton(own))
mouth = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
mouth.bind((own, 0))
mouth.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(own))
for _number in range(600):
    for address in ("226.0.0.0", other):
        mouth.sendto(b"R\\x02\\x64" + bytes(21), (address, 11511))
    time.sleep(0.1)
"""

pytestmark = pytest.mark.skipif(bool(namespaces.why_not()), reason=namespaces.why_not() or "can run")


@pytest.fixture
def two(tmp_path):
    network = namespaces.Network(2, tmp_path)
    yield network
    network.end()


def watch(network, number=0, fails=False, **options):
    """Run the module on a computer; its result."""
    return network.run_module(network.hosts[number], "multimaster_watch", {"run": "test", **options}, fails)


def lost(result):
    return {(entry["kind"], entry["name"]) for entry in result["lost"]}


@pytest.mark.slow
def test_a_silent_master_and_a_lost_route_are_told_with_the_time(two):
    one, other = two.hosts
    hearts = [a.popen(sys.executable, "-c", HEART, a.address, b.address) for a, b in ((one, other), (other, one))]
    one.run("ip", "route", "add", "10.9.0.0/16", "via", other.address)
    masters = [
        {"computer": host.name, "address": host.address, "rpc_port": 11611, "robot": "ignored"} for host in two.hosts
    ]
    watch(
        two, action="start", addresses=[one.address], masters=masters, destinations=["10.9.0.0/16"], lifetime=60,
        settings=["net.ipv4.ip_forward"],
    )  # fmt: skip
    quiet = watch(two, action="collect", until=4)
    assert lost(quiet) == {
        ("port", host.name) for host in two.hosts
    }  # nobody listens there: lost from the first look on
    # heartbeats, ports, route, interface, setting, hosts, clock, readings
    assert quiet["watched"] == 2 + 2 + 1 + 3 + 1 + 1 + 1 + 1
    hearts[1].kill()
    stopped = time.time()
    one.run("ip", "route", "del", "10.9.0.0/16")
    deadline = time.monotonic() + 30
    while not {("group", other.name), ("master", other.name), ("route", "10.9.0.0/16")} <= lost(quiet):
        assert time.monotonic() < deadline, quiet
        quiet = watch(two, action="collect", until=int(quiet["seconds"]) + 2)
    silent = next(event for event in quiet["events"] if event["kind"] == "group")
    assert abs(silent["time"] - stopped) < 2.0  # the last heartbeat, not the time at which it was missed
    watch(two, action="stop")
    assert "No watch of the run 'test' lives on this computer" in watch(two, fails=True, action="collect")["msg"]
    assert not one.processes() - {hearts[0].pid}
    for heart in hearts:
        heart.kill()
        heart.wait()


@pytest.mark.slow
def test_losses_of_one_moment_are_told_together(two):
    """The second one is the nearer to the reason; who asked hears both, and does not wait until the end of the round."""
    one = two.hosts[0]
    one.run("ip", "route", "add", "10.9.0.0/16", "via", two.hosts[1].address)
    before = one.run("sysctl", "-n", "net.ipv4.ip_forward").strip()
    watch(two, action="start", destinations=["10.9.0.0/16"], lifetime=60, settings=["net.ipv4.ip_forward"])
    watch(two, action="collect", until=4)
    fault = one.popen(
        "sh", "-c", f"ip route del 10.9.0.0/16; sleep 2.5; sysctl -w net.ipv4.ip_forward={1 - int(before)}"
    )
    told = watch(two, action="collect", until=50)
    fault.wait()
    watch(two, action="stop")
    assert lost(told) == {("route", "10.9.0.0/16"), ("setting", "net.ipv4.ip_forward")}, told
    assert told["seconds"] < 40


def test_it_ends_by_itself(two):
    one = two.hosts[0]
    watch(two, action="start", lifetime=1)
    deadline = time.monotonic() + 20
    while one.processes():
        assert time.monotonic() < deadline
        time.sleep(0.2)
    assert not one.run("ls", "/run").strip()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"run": "a b"}, "run is 'a b', expected"),
        ({"lifetime": 0}, "lifetime is 0, expected 1 to 604800."),
        ({"addresses": ["here"]}, "addresses is 'here', expected an IPv4 address"),
        ({"masters": [{"computer": "pc"}]}, "expected the keys computer, address, and rpc_port as a number."),
        ({"settings": ["../../etc/passwd"]}, "expected the name of a kernel setting"),
    ],
)
def test_bad_options_are_one_sentence(two, options, sentence):
    assert sentence in watch(two, fails=True, action="start", **options)["msg"]
    assert not two.hosts[0].processes()
