# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The listener keeps so many packets of each protocol: a flood of one hides no other."""

import json
import socket
import threading
import time

from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.trace import listener
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.trace.capture import Capture, Tag
from visiting import leave_silently

FLOOD, ANSWER = (
    Capture("eth0", False, "request", protocol, "10.0.0.1", "10.0.0.2", 0, 0, 3, 0, 64, 28, True, "", "")
    for protocol in ("arp", "icmp")
)


def test_a_flood_of_arp_hides_no_answer(monkeypatch, tmp_path):
    waiting = [FLOOD._replace(source=f"10.0.{number % 20}.1") for number in range(listener.MOST + 700)] + [ANSWER]
    monkeypatch.setattr(
        listener,
        "read_packets",
        lambda link, tag, most, ports: [waiting.pop(0) for _number in range(min(most, len(waiting)))],
    )
    monkeypatch.setattr(listener, "count_lost", lambda link: 5)
    link, other = socket.socketpair()
    other.send(b"x")  # something waits, as long as nobody reads it
    path = tmp_path / "door"
    door = socket.socket(socket.AF_UNIX)
    door.bind(str(path))
    door.listen()
    thread = threading.Thread(target=listener.serve, args=(link, door, str(path), Tag.from_run("test"), 20.0, {}))
    thread.start()
    while waiting:
        time.sleep(0.01)
    leave_silently(path)
    with socket.socket(socket.AF_UNIX) as visitor:
        visitor.connect(str(path))
        visitor.sendall(b"{}\n")
        reply = json.loads(visitor.makefile().readline())
    thread.join(20)
    assert not thread.is_alive()
    assert [one["protocol"] for one in reply["seen"]].count("arp") == listener.MOST
    assert reply["seen"][-1]["protocol"] == "icmp"
    assert reply["missed"] == 700 + 5
    for one in (link, other, door):
        one.close()


def test_one_stranger_takes_no_room_of_others():
    packets = listener.Packets()
    for _number in range(listener.MOST):
        packets.take(FLOOD)
    packets.take(FLOOD._replace(source="10.0.0.9"))
    assert len(packets.kept) == listener.MOST_OF_ONE + 1
    assert packets.full == {FLOOD.source} and packets.missed == 0


def test_rules_stand_before_other_counters(monkeypatch):
    monkeypatch.setattr(listener, "neighbours", dict)
    grown = {**{f"eth{number} drops in": 1 for number in range(100)}, "rule of filter FORWARD: drop": 3}
    assert listener.report(listener.Packets(), grown)["counters"][0] == {
        "counter": "rule of filter FORWARD: drop",
        "more": 3,
    }
