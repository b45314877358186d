# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Sends datagrams that nobody should send, from addresses that are not its own, and measures the victim's heartbeats.

fuzz_datagrams.py VICTIM PEER GROUP SEED COUNT RATE KIND... : runs on a computer of the lab, as root, beside hostile_inputs.py, and prints JSON.
"""

import ipaddress
import json
import random
import socket
import struct
import sys
import threading
import time

from hostile_inputs import LEAVE, PORT, mutated_heartbeat, some_bytes, some_heartbeat

victim, peer, group, seed, count, rate, *kinds = sys.argv[1:]
rng, count, rate = random.Random(f"{seed} {kinds}"), int(count), float(rate)
NETWORK = [str(address) for address in ipaddress.ip_network(f"{victim}/24", strict=False).hosts()]
STRANGERS = [address for address in NETWORK if address not in (victim, peer)]


#: kind -> who seems to send it, its source port, what it is
KINDS = {
    "random": lambda: (
        rng.choice(NETWORK),
        rng.randrange(65536),
        some_bytes(rng, rng.choice([1, 2, 24, 24, rng.randrange(1400)])),
    ),
    "mutated": lambda: (rng.choice([peer, rng.choice(STRANGERS)]), PORT, mutated_heartbeat(rng)),
    "spoofed": lambda: (peer, rng.choice([PORT, rng.randrange(65536)]), some_heartbeat(rng)),
    "strangers": lambda: (rng.choice(STRANGERS), rng.choice([PORT, rng.randrange(65536)]), some_heartbeat(rng)),
    "leave of a stranger": lambda: (rng.choice(STRANGERS), PORT, LEAVE),
    "leave of the peer": lambda: (peer, PORT, LEAVE),
}

beats = []


def listen():
    """Note when the victim's heartbeats arrive. (Its port is another user's; a raw socket sees them beside it.)"""
    with socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_UDP) as wire:
        while True:
            packet = wire.recv(2048)
            if packet[12:16] == socket.inet_aton(victim) and packet[28:30] == b"R\2":
                beats.append(time.monotonic())


threading.Thread(target=listen, daemon=True).start()
with socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_RAW) as raw:
    raw.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(peer))
    raw.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 0)
    targets = [(address, socket.inet_aton(address)) for address in (victim, group)]
    started, failed = time.monotonic(), 0
    for number in range(count):
        source, port, data = KINDS[kinds[number % len(kinds)]]()
        address, to = targets[number % 7 == 0]
        udp = struct.pack(">HHHH", port, PORT, 8 + len(data), 0) + data
        head = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 8, 17, 0, socket.inet_aton(source), to)
        try:
            raw.sendto(head + udp, (address, 0))
        except OSError:  # no room just now
            failed += 1
        if number % 50 == 0 or rate < 1000:
            time.sleep(max(0.0, started + number / rate - time.monotonic()))
    took = time.monotonic() - started
gaps = [late - early for early, late in zip([started, *beats], [*beats, started + took])]
result = {"sent": count - failed, "seconds": round(took, 1), "beats": len(beats), "longest gap": round(max(gaps), 2)}
print(json.dumps(result))
