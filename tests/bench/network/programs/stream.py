# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""One TCP stream: `take ADDRESS PORT` writes the bytes a second that came, `give ADDRESS PORT SECONDS RATE` sends (RATE 0: all it can)."""

import socket
import sys
import time

SIZE = 100_000  # bytes of a message


def take(place):
    """Count what comes over one connection."""
    with socket.create_server(place) as server:
        connection, _address = server.accept()
    count, began = 0, time.monotonic()
    while read := connection.recv(1 << 20):
        count += len(read)
    print(count / (time.monotonic() - began), flush=True)


def give(place, seconds, rate):
    """Send for so many seconds, messages at even distances where there is a rate."""
    with socket.create_connection(place) as connection:
        began, sent = time.monotonic(), 0
        while (now := time.monotonic() - began) < seconds:
            if rate and sent > now * rate:
                time.sleep(sent / rate - now)
                continue
            connection.sendall(bytes(SIZE))
            sent += SIZE


place = (sys.argv[2], int(sys.argv[3]))
if sys.argv[1] == "take":
    take(place)
else:
    give(place, float(sys.argv[4]), float(sys.argv[5]))
