# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The findings of a foreign computer on others: the TCP ports from 1024 up that take a connection, and who answers datagrams.

python3 stranger.py FIRST LAST ADDRESS...     prints JSON: address -> {"tcp": ports, "udp": ports that anything came from}

Every port from FIRST to LAST is tried with a real connect and with a datagram; that of discovery, and its group, get one that
discovery answers. It ends by itself: each port is tried once.
"""

import contextlib
import errno
import json
import os
import select
import socket
import struct
import sys
import time

PORTS = range(int(sys.argv[1]), int(sys.argv[2]) + 1)
AT_ONCE = 800  # sockets
PATIENCE = 0.15  # seconds for the answer to a batch; on the lab's networks one takes less than a hundredth
PAUSE = 1.5  # seconds without a datagram, after which no more is awaited
GROUP, DISCOVERY = "226.0.0.0", 11511
REQUEST = struct.pack("<cBBxiiHxxii", b"R", 3, 10, 0, 0, 11611, 0, 0)


def open_ports(address):
    """The ports that take a connection."""
    found = []
    for start in range(PORTS.start, PORTS.stop, AT_ONCE):
        waiting = {}
        for port in range(start, min(start + AT_ONCE, PORTS.stop)):
            sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
            sock.setblocking(False)
            if sock.connect_ex((address, port)) in (errno.EINPROGRESS, 0):
                waiting[sock.fileno()] = (sock, port)
            else:
                sock.close()
        poll = select.poll()
        for number in waiting:
            poll.register(number, select.POLLOUT)
        end, rest = time.monotonic() + PATIENCE, PATIENCE
        while waiting and rest:  # the last look is after the end: on a busy machine it may be the first one, too
            rest = max(0, end - time.monotonic())
            for number, _event in poll.poll(rest * 1000):
                sock, port = waiting.pop(number)
                poll.unregister(number)
                if sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) == 0:
                    found.append(port)
                sock.close()
        for sock, _port in waiting.values():
            sock.close()
    return found


def answers(addresses):
    """The ports of each address from which anything came back, a refusal of the kernel among them.

    One socket asks all of them: of two at the same port, the kernel would give every answer to one.
    """
    found = set()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 2)
        with contextlib.suppress(OSError):  # discovery answers to its own port; on a master it is taken
            sock.bind(("", DISCOVERY))
        for port in PORTS:
            for address in addresses:
                sock.sendto(REQUEST if port == DISCOVERY else b"?", (address, port))
            if port % 500 == 0:
                time.sleep(0.01)
        sock.sendto(REQUEST, (GROUP, DISCOVERY))
        sock.settimeout(PAUSE)
        with contextlib.suppress(TimeoutError):
            while True:
                found.add(sock.recvfrom(65536)[1])
    return {address: sorted(port for host, port in found if host == address) for address in addresses}


def look_in_processes(look, addresses):
    """Call `look` for all addresses at the same time, a process for each."""
    children = []
    for address in addresses:
        reader, writer = os.pipe()
        if os.fork() == 0:
            os.write(writer, json.dumps(look(address)).encode())
            os._exit(0)
        os.close(writer)
        children.append((address, reader))
    found = {}
    for address, reader in children:
        with os.fdopen(reader) as stream:
            found[address] = json.loads(stream.read())
        os.wait()
    return found


def main():
    """Look at all addresses."""
    addresses = sys.argv[3:]
    tcp, udp = look_in_processes(open_ports, addresses), answers(addresses)
    print(json.dumps({address: {"tcp": tcp[address], "udp": udp[address]} for address in addresses}))


if __name__ == "__main__":
    main()
