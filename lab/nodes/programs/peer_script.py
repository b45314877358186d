# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Plays another robot's discovery node from a script: its datagrams, its documents, and the answers that it must hear.

The script is JSON on standard input: the own "address", the "group" and "port" of discovery, the "real" node's address,
"known" texts ($name is replaced in every step; $port is the port of the XML-RPC server as it is in a record), and
"steps", each with one verb. Steps run one after the other; each waits for a bounded time. Prints "ok", or the step
that failed and the value that was seen, and ends with status 1.

  send: HEX                    from the port of discovery, to: real, group (default), from: PORT for another source port
  expect_datagram: HEX         arrives from the real node's port, via: unicast or group; a dot means any digit
                               stamp: TEXT, the time that the record carries
  expect_no_datagram: HEX      does not arrive, via: ..., for: SECONDS
  serve: {PORT: {METHOD: ...}} answers of XML-RPC servers from now on (a method that is missing is a fault)
  close: PORT                  that server is gone
  expect_call: METHOD          at a server since the last send or serve, port: N, params: PATTERN, path: TEXT
  expect_no_call: METHOD       port: N, for: SECONDS
  call: METHOD                 uri: TEXT, params: [...], answer: PATTERN (of the result) or fault: PATTERN (of its text),
                               asked again until it fits; offer_gzip: true, packed: BOOLEAN
  http: METHOD PATH            to uri: TEXT; status: NUMBER
  pause: SECONDS               if nothing can be waited for

In a PATTERN a text that begins with ~ is a regular expression for the whole text, and its named groups are known in later
steps; {"has": [...]} and {"lacks": [...]} are of lists; "*" fits everything. Ports are texts. Spaces in HEX are nothing.
"""

import gzip
import http.client
import json
import re
import socket
import struct
import sys
import threading
import time
import xmlrpc.client
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import urlsplit

PATIENCE = 10.0  # seconds that a step waits, unless it says `within`
COMPRESS = 1400  # bytes from which upstream packs its answers


class StepFailure(Exception):
    """A step did not find the wanted value."""


def fits(wanted, found, known):
    """Return True if a value fits a pattern; named groups go to `known`."""
    if isinstance(wanted, str) and wanted.startswith("~"):
        match = isinstance(found, str) and re.fullmatch(wanted[1:], found, re.DOTALL)
        known.update(match.groupdict() if match else {})
        return bool(match)
    if isinstance(wanted, dict) and isinstance(found, list) and set(wanted) <= {"has", "lacks"}:
        there = [any(fits(item, value, known) for value in found) for item in wanted.get("has", [])]
        unwanted = [any(fits(item, value, known) for value in found) for item in wanted.get("lacks", [])]
        return all(there) and not any(unwanted)
    if isinstance(wanted, list) and isinstance(found, list):
        return len(wanted) == len(found) and all(fits(*pair, known) for pair in zip(wanted, found))
    return wanted == "*" or wanted == found


def fill(value, known):
    """A step with the remembered texts in it."""
    if isinstance(value, str):
        return re.sub(r"\$(\w+)", lambda match: known.get(match[1], match[0]), value)
    if isinstance(value, list):
        return [fill(item, known) for item in value]
    if isinstance(value, dict):
        return {fill(key, known): fill(item, known) for key, item in value.items()}
    return value


class Server(ThreadingHTTPServer):
    """An XML-RPC server that answers from a table and remembers who called what."""

    daemon_threads = True

    def __init__(self, address, calls):
        self.answers, self.calls = {}, calls
        super().__init__(address, Handler)
        threading.Thread(target=self.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()

    def close(self):
        self.shutdown()
        self.server_close()


class Handler(BaseHTTPRequestHandler):
    def do_POST(self):
        params, method = xmlrpc.client.loads(self.rfile.read(int(self.headers["Content-Length"])))
        answers = {"system.listMethods": sorted(self.server.answers), **self.server.answers}
        if method in answers:
            body = xmlrpc.client.dumps((answers[method],), methodresponse=True, allow_none=True)
        else:
            body = xmlrpc.client.dumps(xmlrpc.client.Fault(1, f"no {method}"), methodresponse=True)
        body = body.encode()
        self.send_response(200)
        if len(body) > COMPRESS and "gzip" in self.headers.get("Accept-Encoding", ""):
            body = gzip.compress(body)
            self.send_header("Content-Encoding", "gzip")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)
        self.server.calls.append(
            {"port": str(self.server.server_port), "method": method, "params": list(params), "path": self.path}
        )

    def log_message(self, *arguments):
        pass


class Peer:
    """The state of one exchange: the messages that were heard, are served, are remembered."""

    def __init__(self, address, group, port, real, known):
        self.address, self.group, self.port, self.real = address, group, port, real
        self.datagrams, self.calls, self.servers, self.known = [], [], {}, known
        self.sockets = {"unicast": self._socket(address), "group": self._socket(group)}
        membership = socket.inet_aton(group) + socket.inet_aton(address)
        self.sockets["group"].setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
        for name, opened in self.sockets.items():
            threading.Thread(target=self._hear, args=(name, opened), daemon=True).start()

    def _socket(self, address, port=None):
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(self.address))
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 0)
        opened.bind((address, self.port if port is None else port))
        return opened

    def _hear(self, name, opened):
        while True:
            data, source = opened.recvfrom(2048)
            self.datagrams.append({"via": name, "hex": data.hex(), "source": list(source)})

    # The verbs: each takes its own value and the rest of the step.

    def send(self, data, to="group", **options):
        self.datagrams.clear()
        self.calls.clear()
        opened = self._socket(self.address, options["from"]) if "from" in options else self.sockets["unicast"]
        opened.sendto(_bytes(data), (self.group if to == "group" else self.real, self.port))

    def expect_datagram(self, pattern, via, stamp=None, within=PATIENCE):
        self._wait(lambda: self._has_datagram(pattern, via, stamp), within, self.datagrams)

    def expect_no_datagram(self, pattern, via, **options):
        self._expect_never(lambda: self._has_datagram(pattern, via), options["for"], self.datagrams)

    def serve(self, servers):
        self.calls.clear()
        for port, answers in servers.items():
            if port not in self.servers:
                self.servers[port] = Server(("", int(port)), self.calls)
            self.servers[port].answers = answers

    def close(self, port):
        self.servers.pop(port).close()

    def expect_call(self, method, within=PATIENCE, **wanted):
        self._wait(lambda: self._has_call(method, wanted), within, self.calls)

    def expect_no_call(self, method, port, **options):
        self._expect_never(lambda: self._has_call(method, {"port": port}), options["for"], self.calls)

    def call(self, method, uri, params=(), offer_gzip=True, within=PATIENCE, **wanted):
        got = {}

        def ask():
            got.clear()
            got.update(self._call(uri, method, params, offer_gzip))
            return all(key in got and fits(value, got[key], self.known) for key, value in wanted.items())

        self._wait(ask, within, got)

    def http(self, request, uri, status):
        method, path = request.split()
        connection = http.client.HTTPConnection(urlsplit(uri).netloc, timeout=PATIENCE)
        connection.request(method, path, b"<methodCall><methodName>masterContacts</methodName></methodCall>")
        found = connection.getresponse().status
        if found != status:
            raise StepFailure(found)

    def pause(self, seconds):
        time.sleep(seconds)

    # The parts of records and documents

    def _has_datagram(self, pattern, via, stamp=None):
        return any(
            re.fullmatch(re.sub(r"\s", "", pattern), heard["hex"])
            and heard["via"] == via
            and heard["source"] == [self.real, self.port]
            and (stamp is None or _stamp(heard["hex"]) == float(stamp))
            for heard in list(self.datagrams)
        )

    def _has_call(self, method, wanted):
        return any(
            call["method"] == method and all(fits(value, call[key], self.known) for key, value in wanted.items())
            for call in list(self.calls)
        )

    def _call(self, uri, method, params, offer_gzip):
        where = urlsplit(uri)
        connection = http.client.HTTPConnection(where.netloc, timeout=PATIENCE)
        headers = {"Accept-Encoding": "gzip"} if offer_gzip else {}
        connection.request("POST", where.path or "/RPC2", xmlrpc.client.dumps(tuple(params), method).encode(), headers)
        answer = connection.getresponse()
        body, packed = answer.read(), answer.headers.get("Content-Encoding") == "gzip"
        try:
            values, _method = xmlrpc.client.loads(gzip.decompress(body) if packed else body)
        except xmlrpc.client.Fault as fault:
            return {"fault": fault.faultString, "packed": packed}
        return {"answer": values[0], "packed": packed}

    def _wait(self, look, seconds, seen):
        deadline = time.monotonic() + seconds
        while not look():
            if time.monotonic() > deadline:
                raise StepFailure(seen)
            time.sleep(0.05)

    def _expect_never(self, look, seconds, seen):
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            if look():
                raise StepFailure(seen)
            time.sleep(0.05)

    def leave(self):
        """The end of every exchange: the peer answers no more, and says so."""
        for server in self.servers.values():
            server.close()
        self.send(fill("52020000 ffffffff ffffffff $port 0000 ffffffff ffffffff", self.known))


def _bytes(text):
    return bytes.fromhex(re.sub(r"\s", "", text))


def _stamp(text):
    seconds, nanoseconds = struct.unpack_from("<ii", bytes.fromhex(text), 4)
    return seconds + nanoseconds / 1e9


def main():
    script = json.load(sys.stdin)
    steps = script.pop("steps")
    peer = Peer(**script)
    try:
        for number, step in enumerate(steps, 1):
            verb, *_rest = step
            options = fill(step, peer.known)
            try:
                getattr(peer, verb)(options.pop(verb), **options)
            except StepFailure as failure:
                print(f"step {number} failed: {json.dumps(step)}\nseen: {failure}")
                return 1
    finally:
        peer.leave()
    print("ok")
    return 0


sys.exit(main())
