# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Sends datagrams, and beginnings of TCP connections, with any address as their source, of IPv4 or of IPv6.

python3 forger.py INTERFACE MAC PORT [SECONDS [PACE]]      MAC is that of the receiver, or of the gateway to it

Reads JSON from the standard input: a list of [protocol, source, destination]. A datagram's text is "source > destination".
With SECONDS (120 at most) it sends the list each PACE seconds (0.005) for this time, or until SIGTERM, and prints how often.
"""

import contextlib
import json
import signal
import socket
import struct
import sys
import time

INTERFACE, MAC, PORT = sys.argv[1], bytes.fromhex(sys.argv[2].replace(":", "")), int(sys.argv[3])
FROM = 40000
PACE = float(sys.argv[5]) if sys.argv[5:] else 0.005  # seconds
UDP, TCP = 17, 6


def checksum(data):
    data += b"\0" * (len(data) % 2)
    total = sum(struct.unpack(f"!{len(data) // 2}H", data))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF


def payload(protocol, text, ends):
    """A datagram with a text, or the beginning of a connection; `ends` is the text that the checksum counts before it."""
    if protocol == "udp":
        body, place = struct.pack("!HHHH", FROM, PORT, 8 + len(text), 0) + text, 6
    else:
        body, place = struct.pack("!HHIIBBHHH", FROM, PORT, 1000, 0, 5 << 4, 2, 8192, 0, 0), 16
    total = checksum(ends(len(body)) + body)
    return body[:place] + struct.pack("!H", total or 0xFFFF) + body[place + 2 :]


def frame(protocol, source, destination, own):
    """The whole frame."""
    number, text = UDP if protocol == "udp" else TCP, f"{source} > {destination}".encode()
    family = socket.AF_INET6 if ":" in source else socket.AF_INET
    here, there = socket.inet_pton(family, source), socket.inet_pton(family, destination)
    target = MAC
    if family == socket.AF_INET6:
        body = payload(protocol, text, lambda size: here + there + struct.pack("!II", size, number))
        packet, kind = struct.pack("!IHBB", 6 << 28, len(body), number, 64) + here + there + body, b"\x86\xdd"
        if there[0] == 0xFF:
            target = b"\x33\x33" + there[-4:]
    else:
        body = payload(protocol, text, lambda size: here + there + struct.pack("!HH", number, size))
        head = struct.pack("!BBHHHBBH", 0x45, 0, 20 + len(body), 1, 0, 64, number, 0) + here + there
        packet, kind = head[:10] + struct.pack("!H", checksum(head)) + head[12:] + body, b"\x08\x00"
        if there[0] >> 4 == 14:
            target = b"\x01\x00\x5e" + bytes([there[1] & 127]) + there[2:]
    return target + own + kind + packet


with socket.socket(socket.AF_PACKET, socket.SOCK_RAW) as sock:
    sock.bind((INTERFACE, 0))
    frames = [frame(*words, sock.getsockname()[4]) for words in json.load(sys.stdin)]
    now = start = time.monotonic()
    end = start + min(120.0, float(sys.argv[4])) if sys.argv[4:] else start
    rounds, asked = 0, []
    signal.signal(signal.SIGTERM, lambda number, _frame: asked.append(number))
    while rounds == 0 or (now < end and not asked):
        rounds += 1
        for data in frames:
            with contextlib.suppress(OSError):  # the link of a computer that boots is away
                sock.send(data)
        time.sleep(max(0.0, start + rounds * PACE - time.monotonic()))
        now = time.monotonic()
    print(rounds)
