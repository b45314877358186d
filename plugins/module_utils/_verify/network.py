# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""What a computer sees of the others on the network: names, echo replies, routes, the ports of the discovery nodes.

Everything is bounded in time, and many computers are asked at once.
"""

import os
import queue
import select
import socket
import threading
import time
import typing
import xmlrpc.client

from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.commands import run, text
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.network import interfaces
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import texts
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify.multicast import echo_request

TRIES = 3  # echo requests per address; the report's wireless links lose some
ANSWER = 1.0  # seconds that an echo reply may take
CONNECT = 2.0  # seconds that a TCP connection may take: one lost SYN is sent again after one second
CALL = 5.0  # seconds that an XML-RPC call may take
SAMPLES = 3  # readings of a clock
WORKERS = 16
PAUSE = 0.5  # seconds between two looks at something that is awaited


class _Transport(xmlrpc.client.Transport):
    """HTTP with a time limit: a node that accepts and never answers must not hold the probe."""

    def make_connection(self, host):
        connection = xmlrpc.client.Transport.make_connection(self, host)
        connection.timeout = CALL
        return connection


def server(uri: str) -> xmlrpc.client.ServerProxy:
    """An XML-RPC server, asked with a time limit."""
    return xmlrpc.client.ServerProxy(uri, transport=_Transport())


def concurrently(
    function: typing.Callable, items: typing.Sequence, limit: float, late: typing.Callable, workers: int = WORKERS
) -> typing.List:
    """[function(item) ...] by several threads; late(item) stands for what has no result after `limit` seconds.

    The threads are daemons, so a name server that never answers does not keep the process.
    """
    results: typing.Dict[int, typing.Any] = {}
    waiting: queue.Queue = queue.Queue()
    finished: queue.Queue = queue.Queue()
    for job in enumerate(items):
        waiting.put(job)

    def work() -> None:
        while True:
            try:
                number, item = waiting.get_nowait()
            except queue.Empty:
                return
            try:
                finished.put((number, True, function(item)))
            except Exception as problem:  # raised again where it can be seen
                finished.put((number, False, problem))

    for number in range(min(workers, len(items))):
        thread = threading.Thread(target=work)
        thread.daemon = True
        thread.start()
    deadline = time.monotonic() + limit
    while len(results) < len(items):
        try:
            number, good, value = finished.get(timeout=max(0.0, deadline - time.monotonic()))
        except queue.Empty:
            break
        if not good:
            raise value
        results[number] = value
    return [results[number] if number in results else late(item) for number, item in enumerate(items)]


def awaited(
    look: typing.Callable[[], typing.Any], wanted: typing.Callable[[typing.Any], bool], deadline: float
) -> typing.Any:
    """Look until what is seen is wanted, or until the deadline (monotonic seconds); returns what was seen last."""
    while True:
        seen = look()
        if wanted(seen) or time.monotonic() + PAUSE > deadline:
            return seen
        time.sleep(PAUSE)


def members(
    others: typing.List[typing.Dict[str, str]], own: str, by_name: bool = True
) -> typing.List[typing.Dict[str, typing.Any]]:
    """Of every member: what its name means here, its echo replies and the way to it; of the own one the name alone.

    Without `by_name` no name is looked up, as on the router, which is not told any.
    """
    if by_name:
        resolved = concurrently(
            lambda member: resolve(member["name"]), others, 15.0, lambda member: ([], "no answer within 15 s")
        )
    else:
        resolved = [([], "not looked up")] * len(others)
    found = []
    asked = []
    for member, (addresses, error) in zip(others, resolved):
        entry = {"name": member["name"], "address": member["address"], "addresses": addresses, "resolve_error": error}
        found.append(entry)
        if member["name"] != own:
            asked += [member["address"]] + addresses[:1]
    pings = ping(asked)
    strange = [entry for entry in found if entry["name"] != own]
    routes = concurrently(lambda entry: way(entry["address"]), strange, 15.0, lambda entry: dict(_NO_WAY))
    for entry, route in zip(strange, routes):
        unknown = {"ok": False, "rtt_ms": None, "error": "the name has no address"}
        entry.update(
            route=route,
            ping_address=pings[entry["address"]],
            ping_name=pings[entry["addresses"][0]] if entry["addresses"] else unknown,
        )
    return found


def resolve(name: str) -> typing.Tuple[typing.List[str], str]:
    """The IPv4 addresses of a name as any program of this computer gets them, and the error where there is none."""
    try:
        answers = socket.getaddrinfo(name, None, socket.AF_INET, socket.SOCK_STREAM)
    except (OSError, UnicodeError) as problem:
        return [], getattr(problem, "strerror", None) or str(problem)
    return list(dict.fromkeys(answer[4][0] for answer in answers)), ""


def ping(
    addresses: typing.Iterable[str], tries: int = TRIES, answer: float = ANSWER
) -> typing.Dict[str, typing.Dict[str, typing.Any]]:
    """ICMP echo requests to all addresses at once, again to those that do not answer (RFC 792); needs root."""
    results = {address: {"ok": False, "rtt_ms": None, "error": ""} for address in addresses}
    if not results:
        return results
    try:
        link = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_ICMP)
    except OSError as problem:
        return {address: dict(entry, error=f"no raw socket: {problem.strerror}") for address, entry in results.items()}
    identifier = int.from_bytes(os.urandom(2), "big")
    sent: typing.Dict[int, typing.Tuple[str, float]] = {}
    with link:
        link.setblocking(False)
        for number in range(tries):
            late = [address for address, entry in results.items() if not entry["ok"]]
            for address in late:
                sequence = len(sent) & 0xFFFF
                sent[sequence] = address, time.monotonic()
                try:
                    link.sendto(echo_request(identifier, sequence), (address, 0))
                except OSError as problem:
                    results[address]["error"] = problem.strerror or str(problem)
            deadline = time.monotonic() + answer
            while time.monotonic() < deadline and not all(results[address]["ok"] for address in late):
                ready = select.select([link], [], [], max(0.0, deadline - time.monotonic()))[0]
                if not ready:
                    break
                _note(link, identifier, sent, results)
    for entry in results.values():
        if not entry["ok"] and not entry["error"]:
            entry["error"] = f"no answer to {tries} requests"
    return results


def _note(link: socket.socket, identifier: int, sent: typing.Dict, results: typing.Dict) -> None:
    """Read one packet, and write down what it says."""
    try:
        heard = texts.echo(link.recv(2048), identifier)
    except OSError:
        return
    if heard is None or heard.sequence not in sent:
        return
    address, when = sent[heard.sequence]
    if heard.error:
        results[address]["error"] = heard.error
    elif heard.source == address:
        milliseconds = round((time.monotonic() - when) * 1000, 3)
        results[address].update(ok=True, rtt_ms=milliseconds, error="")
    else:
        results[address]["error"] = f"the answer comes from {heard.source}"


_NO_WAY = {"device": None, "source": None, "gateway": None, "error": "ip gave no answer"}


def way(address: str) -> typing.Dict[str, typing.Optional[str]]:
    """The route that the kernel takes to an address."""
    answer = run(["ip", "-4", "route", "get", address])
    if answer.status != 0:
        return dict(_NO_WAY, error=answer.error.replace("RTNETLINK answers: ", "") or "no route")
    return dict(texts.route(answer.output.decode("utf-8", "replace")), error="")


def default_routes() -> typing.List[typing.Dict[str, typing.Optional[str]]]:
    """The default routes of the main table."""
    output = run(["ip", "-4", "route", "show", "default"]).output.decode("utf-8", "replace")
    return [texts.route(line) for line in output.splitlines() if line.startswith("default")]


def forwarding(root: str = "/proc/sys/net/ipv4") -> typing.Dict[str, typing.Any]:
    """What decides whether packets pass from one network to another here (Documentation/networking/ip-sysctl).

    For each interface with an IPv4 address: whether packets that come in there are passed on, which reverse-path
    filter is effective (the larger value of `all` and the interface), and whether redirects are sent (either of them).
    Null for what cannot be read.
    """

    def value(*words: str) -> typing.Optional[int]:
        content = text(os.path.join(root, *words)).strip()
        return int(content) if content.isdigit() else None

    def larger(interface: str, setting: str) -> typing.Optional[int]:
        both = [value("conf", place, setting) for place in ("all", interface)]
        return None if None in both else max(both)

    found = []
    for interface in interfaces():
        addresses = [entry.address for entry in interface.addresses if entry.family == "inet"]
        if addresses and not interface.loopback:
            name = interface.name
            found.append(
                {
                    "interface": name,
                    "addresses": addresses,
                    "forwarding": value("conf", name, "forwarding"),
                    "rp_filter": larger(name, "rp_filter"),
                    "send_redirects": larger(name, "send_redirects"),
                }
            )
    return {"ip_forward": value("ip_forward"), "interfaces": found}


def call(addresses: typing.Sequence[str], port: int) -> str:
    """Send empty datagrams, which a discovery node ignores, so that the helpers there see from where they come.

    Returns the error of the last one that could not be sent, or empty.
    """
    error = ""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        for address in list(addresses) * TRIES:
            try:
                link.sendto(b"", (address, port))
            except OSError as problem:
                error = f"{address}: {problem.strerror or problem}"
    return error


def discovery(master: typing.Dict[str, typing.Any], deadline: float) -> typing.Dict[str, typing.Any]:
    """The discovery node of a master: whether its TCP port opens, and how far its clock is ahead of this one's."""
    found = {"computer": master["computer"], "address": master["address"], "port": master["rpc_port"]}
    found.update(awaited(lambda: _connect(master["address"], master["rpc_port"]), lambda seen: seen["open"], deadline))
    found.update(clock_offset_s=None, clock_uncertainty_s=None, clock_error="")
    if found["open"]:
        try:
            offset, uncertainty = clock_offset(master["monitor_uri"])
            found.update(clock_offset_s=round(offset, 6), clock_uncertainty_s=round(uncertainty, 6))
        except (OSError, xmlrpc.client.Error, ValueError, TypeError, IndexError) as problem:
            found["clock_error"] = f"getCurrentTime failed: {problem}"
        except Exception as problem:  # http.client's and expat's own: something else than a discovery node
            found["clock_error"] = f"getCurrentTime failed: {type(problem).__name__}: {problem}"
    return found


def _connect(address: str, port: int) -> typing.Dict[str, typing.Any]:
    began = time.monotonic()
    try:
        socket.create_connection((address, port), timeout=CONNECT).close()
    except OSError as problem:
        error = f"no answer within {CONNECT:g} s" if isinstance(problem, socket.timeout) else problem.strerror
        return {"open": False, "connect_ms": None, "error": error or str(problem)}
    return {"open": True, "connect_ms": round((time.monotonic() - began) * 1000, 3), "error": ""}


def clock_offset(monitor_uri: str) -> typing.Tuple[float, float]:
    """Seconds that the clock of a discovery node is ahead, by its getCurrentTime, and how far that may be wrong.

    The answer is somewhere between question and answer, so the quickest of a few says most (RFC 5905, section 10).
    """
    samples = []
    for number in range(SAMPLES):
        asked, began = time.time(), time.monotonic()
        theirs = float(server(monitor_uri).getCurrentTime()[1])
        half = (time.monotonic() - began) / 2
        samples.append((half, theirs - (asked + half)))
    half, offset = min(samples)
    return offset, half
