# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Sends a datagram to an address each 5 ms, as anybody may: python3 ticker.py ADDRESS PORT SECONDS. Its text is "honest"."""

import contextlib
import socket
import sys
import time

ADDRESS, PORT, END = sys.argv[1], int(sys.argv[2]), time.monotonic() + min(120.0, float(sys.argv[3]))

with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
    while time.monotonic() < END:
        with contextlib.suppress(OSError):  # the tunnel is away
            sock.sendto(b"honest", (ADDRESS, PORT))
        time.sleep(0.005)
