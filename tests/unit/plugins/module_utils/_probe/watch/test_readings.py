# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The readings of a watch: this machine's own values, and tables of the kernel."""

import random
import socket
import sys
import types

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast import packets
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.watch import process, readings
from rosfleet_multimaster.protocol import heartbeat

TABLE = """Iface\tDestination\tGateway \tFlags\tRefCnt\tUse\tMetric\tMask\t\tMTU\tWindow\tIRTT
eth0\t00000000\t0100A8C0\t0003\t0\t0\t0\t00000000\t0\t0\t0
eth0\t000BA8C0\tC901A8C0\t0003\t0\t0\t0\t00FFFFFF\t0\t0\t0
"""


@pytest.mark.skipif(sys.byteorder != "little", reason="the table is that of a little-endian machine")
def test_routes_are_read_by_destination():
    assert readings.routes(["default", "192.168.11.0/24", "10.0.0.0/8"], TABLE) == {
        ("route", "default"): "192.168.0.1",
        ("route", "192.168.11.0/24"): "192.168.1.201",
        ("route", "10.0.0.0/8"): "no route",
    }


def test_a_setting_is_read_by_either_spelling():
    with open("/proc/sys/net/ipv4/ip_forward") as stream:
        assert (
            readings.setting("net.ipv4.ip_forward") == readings.setting("net/ipv4/ip_forward") == stream.read().strip()
        )
    assert readings.setting("net.ipv4.no_such_thing") == "not there"


def test_a_port_is_open_or_the_reason_is_told():
    master = {"computer": "pc", "address": "127.0.0.1"}
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert readings.ports([dict(master, rpc_port=port)]) == {("port", "pc"): "open"}
    assert readings.ports([dict(master, rpc_port=port)]) == {("port", "pc"): "Connection refused"}


def test_an_address_that_nobody_has():
    assert readings.links(["192.0.2.1"], "226.0.0.0") == {("address", "192.0.2.1"): "on no interface"}


def test_the_clock_and_services_are_compared_with_the_last_look():
    before = readings.LastLook(0.0, 1000.0)
    assert before.clock(3.0, 1003.01) == "steady"
    assert before.clock(6.0, 1008.01) == "stepped by +2.0 s"
    assert before.clock(9.0, 1011.01) == "steady"
    assert before.service("a", "active", "7") == "active"
    assert before.service("a", "active", "8") == "started again"
    assert before.service("a", "active", "8") == "active"
    assert before.service("a", "failed", "0") == "failed"
    assert before.service("b", "", "") == "not there"
    found = [before.service("c", state, "9") for state in ("active", "deactivating", "deactivating", "inactive")]
    assert found == ["active", "active", "deactivating", "inactive"]  # it is lost where it ends, or does not end


def test_a_process_that_is_held_up_reads_read_clocks_again(monkeypatch):
    monotonic = iter((1.0, 1.4, 2.0, 2.001))  # 0.4 s pass between the two clocks of the first try
    clocks = types.SimpleNamespace(monotonic=monotonic.__next__, time=iter((100.0, 101.4)).__next__)
    monkeypatch.setattr(readings, "time", clocks)
    assert readings.read_clocks() == (2.0, 101.4)


def packet(body, port=11511, destination="226.0.0.0"):
    head = bytes([0x45]) + bytes(11) + socket.inet_aton("192.168.1.2") + socket.inet_aton(destination)
    return (
        head
        + (40000).to_bytes(2, "big")
        + port.to_bytes(2, "big")
        + (8 + len(body)).to_bytes(2, "big")
        + bytes(2)
        + body
    )


def rate(data):
    found = packets.datagram(data, 11511)
    return found and process.read_rate(found)


@pytest.mark.parametrize("kind", heartbeat.Kind)
def test_a_watch_reads_what_the_nodes_write(kind):
    drawn = random.Random(kind.value)
    for _turn in range(100):
        record = heartbeat.encode(heartbeat.Heartbeat(kind, drawn.randrange(1, 65536), drawn.uniform(0, 30)))
        assert rate(packet(record)) == heartbeat.decode(record).rate


def test_only_the_record_of_discovery_is_a_heartbeat():
    record = b"R\x02\x0a" + bytes(21)
    assert rate(packet(record)) == 1.0
    assert packets.datagram(packet(record), 11511) == (("192.168.1.2", 40000), "226.0.0.0", record, 24)
    for other in (b"", record[:-1], record + b"x", b"X" + record[1:]):
        assert rate(packet(other)) is None
    assert rate(packet(record, port=11512)) is None
    assert rate(packet(record)[:30]) is None
    assert rate(b"") is None
