# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Sends datagrams to the computer itself: to its addresses, and to multicast groups by an interface.

python3 self_talker.py INTERFACE PORT DESTINATION...      each datagram's text is "itself > destination"
"""

import socket
import struct
import sys

INTERFACE, PORT = sys.argv[1], int(sys.argv[2])
NUMBER = socket.if_nametoindex(INTERFACE)

with (
    socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as four,
    socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as six,
):
    four.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, struct.pack("4s4si", b"\0" * 4, b"\0" * 4, NUMBER))
    for destination in sys.argv[3:]:
        text = f"itself > {destination}".encode()
        if ":" in destination:
            local = destination.startswith(("fe80", "ff"))
            six.sendto(text, (destination, PORT, 0, NUMBER if local else 0))
        else:
            four.sendto(text, (destination, PORT))
