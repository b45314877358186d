# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The listener keeps so many packets of each protocol: a flood of one hides no other."""

import json
import socket
import threading
import time

from ansible_collections.rosfleet.multimaster.plugins.module_utils._follow import listener
from ansible_collections.rosfleet.multimaster.plugins.module_utils._follow.capture import Capture, Tag

FLOOD, ANSWER = (
    Capture("eth0", False, "request", protocol, "10.0.0.1", "10.0.0.2", 0, 0, 3, 0, 64, 28, True, "", "")
    for protocol in ("arp", "icmp")
)


def test_a_flood_of_arp_hides_no_answer(monkeypatch, tmp_path):
    waiting = [FLOOD] * (listener.MOST + 700) + [ANSWER]
    monkeypatch.setattr(
        listener, "read_packets", lambda link, tag, most: [waiting.pop(0) for _number in range(min(most, len(waiting)))]
    )
    link, other = socket.socketpair()
    other.send(b"x")  # something waits, as long as nobody reads it
    path = tmp_path / "door"
    door = socket.socket(socket.AF_UNIX)
    door.bind(str(path))
    door.listen()
    thread = threading.Thread(target=listener.serve, args=(link, door, str(path), Tag.from_run("test"), 20.0))
    thread.start()
    while waiting:
        time.sleep(0.01)
    with socket.socket(socket.AF_UNIX) as visitor:
        visitor.connect(str(path))
        visitor.sendall(b"{}\n")
        reply = json.loads(visitor.makefile().readline())
    thread.join(20)
    assert not thread.is_alive()
    assert [one["protocol"] for one in reply["seen"]].count("arp") == listener.MOST
    assert reply["seen"][-1]["protocol"] == "icmp"
    assert reply["missed"] == 700
    for one in (link, other, door):
        one.close()
