# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Prints each datagram that it hears on a port, of IPv4, IPv6 and two multicast groups, and listens there by TCP as well.

python3 hearer.py INTERFACE PORT GROUP GROUP6        once it listens, it prints "listens"

SIGTERM ends it when it has printed all that came before.
"""

import contextlib
import select
import signal
import socket
import struct
import sys

INTERFACE, PORT, GROUP, GROUP6 = sys.argv[1], int(sys.argv[2]), *sys.argv[3:]
NUMBER = socket.if_nametoindex(INTERFACE)

four, six = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), socket.socket(socket.AF_INET6, socket.SOCK_DGRAM)
six.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
four.bind(("", PORT))
six.bind(("::", PORT))
member = struct.pack("4s4si", socket.inet_aton(GROUP), b"\0" * 4, NUMBER)
four.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
member = socket.inet_pton(socket.AF_INET6, GROUP6) + struct.pack("@I", NUMBER)
six.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_JOIN_GROUP, member)
server = socket.create_server(("::", PORT), family=socket.AF_INET6, dualstack_ipv6=True)
term, waker = socket.socketpair()
for sock in (four, six, waker):
    sock.setblocking(False)
signal.set_wakeup_fd(waker.fileno())
signal.signal(signal.SIGTERM, lambda _number, _frame: None)
print("listens", flush=True)
readable = []
while readable != [term]:  # once it is the only one, there is nothing left to read
    readable = select.select([four, six, term], [], [])[0]
    for sock in readable:
        if sock is not term:
            with contextlib.suppress(BlockingIOError):
                print(sock.recv(200).decode(), flush=True)
