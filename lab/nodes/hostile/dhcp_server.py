# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A DHCP server (RFC 2131) that gives everybody who asks the same address: dhcp_server.py DEVICE OWN-ADDRESS ADDRESS."""

import socket
import struct
import sys

COOKIE, TYPE, OFFER, ACK = b"\x63\x82\x53\x63", 53, 2, 5
device, own, given = sys.argv[1:]
server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
server.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, device.encode())
server.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
server.bind(("", 67))
while True:
    asked = server.recv(2048)
    options, at = {}, 240
    while at < len(asked) and asked[at] != 255:
        if asked[at]:  # 0 is padding
            options[asked[at]] = asked[at + 2 : at + 2 + asked[at + 1]]
            at += 1 + asked[at + 1]
        at += 1
    kind = {1: OFFER, 3: ACK}.get(options.get(TYPE, b"\0")[0])
    if asked[236:240] == COOKIE and kind:
        head = struct.pack("!BBBB4sHH", 2, 1, 6, 0, asked[4:8], 0, 0x8000)
        addresses = bytes(4) + socket.inet_aton(given) + socket.inet_aton(own) + bytes(4)
        lease = struct.pack("!BBIBB4sBB4s", 51, 4, 3600, 54, 4, socket.inet_aton(own), 1, 4, bytes([255, 255, 255, 0]))
        answer = head + addresses + asked[28:44] + bytes(192) + COOKIE + bytes([TYPE, 1, kind]) + lease + b"\xff"
        server.sendto(answer, ("255.255.255.255", 68))
