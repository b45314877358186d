# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Discovery nodes that answer what nobody should answer. Prints how often it was asked for a state, as JSON.

hostile_peer.py VICTIM HOST SECONDS KIND MASTERS : runs on a computer of the lab, whose own discovery is stopped.
"""

import gzip
import http.server
import json
import socket
import struct
import sys
import threading
import time
import xmlrpc.client

victim, host, seconds, kind, masters = sys.argv[1:]
seconds, masters = float(seconds), int(masters)
asked = [0]


def topics(uri, name, count):
    """A state with so many topics of one node."""
    names = [f"/flood/{name}/{number:06}" for number in range(count)]
    rows = [[topic, ["/flood"]] for topic in names]
    types = [[topic, "std_msgs/String"] for topic in names]
    nodes = [["/flood", f"http://{host}:40000/", uri, 1, "local"]]
    now = f"{time.time():.9f}"
    return xmlrpc.client.dumps(([now, now, uri, name, rows, [], [], types, nodes, []],), methodresponse=True).encode()


def differences(uri, name, count):
    """An answer to a question for differences, as soon as it is asked: ever more topics, or a whole state each time."""
    whole = kind == "wholes" or count == 1
    names = [f"/flood/{name}/{number:06}" for number in range(0 if whole else (count - 1) * 200, count * 200)]
    if kind == "wholes":
        names = [f"/flood/{name}/{count % 2}/{number:06}" for number in range(4000)]
    now = f"{time.time():.9f}"
    rows, types = [[topic, ["/flood"]] for topic in names], [[topic, "std_msgs/String"] for topic in names]
    nodes = [["/flood", f"http://{host}:40000/", uri, 1, "local"]]
    document = [now, now, uri, name, rows, [], [], types, nodes, []]
    return xmlrpc.client.dumps((["epoch", count, whole, document, [[], [], []], ""],), methodresponse=True).encode()


def long_text(inside):
    return b"<methodResponse><params><param><value>" + inside + b"</value></param></params></methodResponse>"


def body_of(uri, name):
    """The state of a master, packed where that makes it worse."""
    if kind == "bomb":
        return gzip.compress(
            long_text(b"<array><data>" + b"<value>a</value>" * (4 << 20) + b"</data></array>"), 9
        ), True
    if kind.startswith("topics"):
        return gzip.compress(topics(uri, name, int(kind[6:])), 6), True
    if kind == "large":
        return long_text(b"<array><data>" + b"<value>ab</value>" * 900_000 + b"</data></array>"), False
    raise SystemExit(f"there is no {kind}")


def server(port, uri, name):
    quick = kind in ("changes", "wholes")
    body, packed = (b"", False) if quick else body_of(uri, name)
    methods = xmlrpc.client.dumps((["rosfleetDifferences"],), methodresponse=True).encode()

    class Handler(http.server.BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1" if quick else "HTTP/1.0"

        def do_POST(self):
            wanted = self.rfile.read(int(self.headers["Content-Length"]))
            if b"masterContacts" in wanted:
                stamp = f"{time.time():.9f}"
                contact = [stamp, uri, name, "/master_discovery", f"http://{host}:{port}/"]
                self.answer(xmlrpc.client.dumps((contact,), methodresponse=True).encode(), False)
            elif quick and b"listMethods" in wanted:
                self.answer(methods, False)
            elif quick:
                asked[0] += 1
                self.answer(differences(uri, name, asked[0]), False)
            else:
                asked[0] += 1
                self.answer(body, packed)

        def answer(self, data, gzipped):
            self.send_response(200)
            if gzipped:
                self.send_header("Content-Encoding", "gzip")
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, *_arguments):
            pass

    made = http.server.ThreadingHTTPServer(("", port), Handler)
    threading.Thread(target=made.serve_forever, daemon=True).start()


PORTS = [11611 + number for number in range(masters)]
for number, port in enumerate(PORTS):
    master = f"http://{host}:{11311 + number}/"
    server(port, master, host if number == 0 else f"{host}_{number}")
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
    udp.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    udp.bind(("", 11511))
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for port in PORTS:
            now = time.time()
            stamp = int(now), int(now % 1 * 1e9)
            udp.sendto(struct.pack("<cBBxiiHxxii", b"R", 2, 10, *stamp, port, *stamp), (victim, 11511))
        time.sleep(1.0)
print(json.dumps({"asked": asked[0]}))
