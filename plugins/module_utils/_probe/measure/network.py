# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The network, seen from this computer: names, echo replies, routes, and the kernel's settings for forwarding.

Everything is bounded in time, and many computers are asked at once.
"""

import ipaddress
import json
import os
import re
import socket
import sys
import time
import typing

from ..._base.commands import find_nobody, run, text
from ..._base.deadlines import call_all
from ..._base.foreign import last_line
from ..._contract.network import DefaultRoute, PolicyRouting
from ..._contract.outcomes import Outcome
from ..._machine import network as machine
from ..._machine.outcomes import classify_error, connect
from ..multicast.packets import IP_MTU_DISCOVER, IP_PMTUDISC_PROBE, REFUSALS, EchoReply, echo_request, read_echoes
from .changes import LOG, carrier

TRIES = 3  # echo requests per address; the report's wireless links lose some
ANSWER = 1.0  # seconds that an echo reply may take
REPORTED = 3.5  # seconds until a kernel that passes packets on has reported to their sender that no computer has the next address (3, arp(7))
COUNTED, PACE = 20, 0.025  # echo requests in a row, and the seconds between two of them
MOST_COUNTED = 32  # computers to which they are sent
DOWN = ("down", "lowerlayerdown", "notpresent", "dormant")  # operational states of RFC 2863 in which nothing passes
STATIONS = ("managed", "P2P-client")  # the types of iw's interfaces that save power
CLOSED, MOST_LINES = ("blackhole ", "unreachable ", "prohibit "), 100
UNUSED = 9  # a TCP port that no program uses: discard (RFC 863)
LARGEST = 1500  # bytes of a large packet: the limit of Ethernet


class EchoAnswer(typing.NamedTuple):
    """The answer to echo requests."""

    outcome: Outcome
    rtt_ms: typing.Optional[float] = None
    errno: typing.Optional[int] = None  # of the kernel here
    icmp_type: typing.Optional[int] = None
    icmp_code: typing.Optional[int] = None
    reporter: str = ""  # the address that has answered
    tries: int = 0  # 0 if no raw socket opens

    @property
    def ok(self) -> bool:
        """True if packets arrive. After "too large" the kernel makes smaller ones (RFC 1191), so that is as good."""
        return self.outcome in (Outcome.ANSWERED, Outcome.TOO_LARGE)

    @property
    def error(self) -> str:
        """Say why packets do not arrive; empty if they do."""
        if self.ok:
            return ""
        if self.outcome == Outcome.UNKNOWN_NAME:
            return "the name has no address"
        if self.outcome == Outcome.WRONG_SOURCE:
            return f"the answer comes from {self.reporter}"
        if self.icmp_type is not None:
            return f"{self.reporter} reports: {REFUSALS[self.icmp_type, self.icmp_code or 0][1]}"
        if self.errno is not None:
            return os.strerror(self.errno) if self.tries else f"no raw socket: {os.strerror(self.errno)}"
        return f"no answer to {self.tries} requests"

    def to_plain(self) -> typing.Dict[str, typing.Any]:
        """Return the answer as the module does."""
        plain = dict(self._asdict(), ok=self.ok, error=self.error, outcome=self.outcome.value)
        del plain["tries"]
        return plain


def is_network(text: str) -> bool:
    """True for an IPv4 network in CIDR notation."""
    try:
        ipaddress.IPv4Network(text)
    except ValueError:
        return False
    return "/" in text


def members(
    others: typing.List[typing.Dict[str, str]], own: str, by_name: bool = True
) -> typing.List[typing.Dict[str, typing.Any]]:
    """Look at every member: the addresses of its name, its echo replies and the route to it; at the own one the name only.

    Without `by_name` no name is looked up: the router does not see any.
    """
    found = _look_up(others, by_name)
    strange = [entry for entry in found if entry["name"] != own]
    pings = ping(address for entry in strange for address in [entry["address"], *entry["addresses"][:1]])
    second = {member["name"]: member.get("discovery_address") for member in others}
    for entry in strange:
        address, other = entry["address"], second[entry["name"]]
        entry.update(
            ping_address=pings[address],
            ping_name=pings[entry["addresses"][0]] if entry["addresses"] else EchoAnswer(Outcome.UNKNOWN_NAME),
            route=route_to_plain(machine.route_to(address)),
            discovery_route=route_to_plain(machine.route_to(other)) if other and other != address else None,
        )
    _look_closer(strange)
    for entry in strange:
        entry.update((key, entry[key] and entry[key].to_plain()) for key in ("ping_address", "ping_name", "ping_large"))
    return found


def _look_up(others: typing.List[typing.Dict[str, str]], by_name: bool) -> typing.List[typing.Dict[str, typing.Any]]:
    """Begin the entry of each member with its addresses, as root and as a user without rights look them up."""
    names = [member["name"] for member in others]
    if by_name:
        resolved = call_all(machine.resolve, names, 15.0, lambda name: ([], "no answer within 15 s"))
        usual, in_file = user_addresses(names), file_addresses()
    else:
        resolved, usual, in_file = [([], "not looked up")] * len(names), {}, {}
    found = [
        {"name": member["name"], "address": member["address"], "addresses": addresses, "resolve_error": error}
        for member, (addresses, error) in zip(others, resolved)
    ]
    for entry in found:
        entry["user_addresses"] = usual.get(entry["name"])
        entry["file_addresses"] = in_file.get(entry["name"].lower(), [])[:MOST_LINES]
    return found


def _look_closer(answered: typing.List[typing.Dict[str, typing.Any]]) -> None:
    """Add if large packets arrive, how many are lost, the hardware address of each computer, and why a computer is silent."""
    mtus = {interface.name: interface.mtu for interface in machine.interfaces()}
    sizes = {
        entry["address"]: min(mtus.get(entry["route"]["device"]) or LARGEST, LARGEST)
        for entry in answered
        if entry["ping_address"].ok
    }
    large = ping(sizes, sizes=sizes)
    known = machine.neighbours()
    lost = losses(sample([entry["address"] for entry in answered]))
    silent = [entry["address"] for entry in answered if entry["address"] not in sizes]
    tcp = dict(zip(silent, call_all(try_unused_port, silent, 10.0, lambda address: (Outcome.NO_ANSWER, "no answer"))))
    late = ping(silent, tries=1, answer=REPORTED)
    for entry in answered:
        address = entry["address"]
        hardware, fixed = known.get(address, ("", False))
        entry.update(ping_large=large.get(address), neighbour=hardware, neighbour_fixed=fixed)
        outcome, text = tcp.get(address, (Outcome.NOT_TRIED, ""))
        entry.update(loss=lost.get(address), tcp=text, tcp_outcome=outcome.value, silent=False)
        if address in late:
            _add_late(entry, late[address])


def _add_late(entry: typing.Dict[str, typing.Any], late: EchoAnswer) -> None:
    """Add late answers: the report of a router, or nothing at all."""
    if entry["ping_address"].outcome == Outcome.NO_ANSWER:
        entry["silent"] = late.outcome == Outcome.NO_ANSWER
        if not (late.ok or entry["silent"]):
            entry["ping_address"] = late


def sample(addresses: typing.List[str]) -> typing.List[str]:
    """Take every so many of the addresses, so that a large fleet is not flooded."""
    return addresses[:: -(-len(addresses) // MOST_COUNTED) or 1]


def losses(addresses: typing.Sequence[str]) -> typing.Dict[str, float]:
    """Send ICMP echo requests in a row to addresses, and return the share of each that has no answer."""
    got: typing.Dict[str, typing.Set[int]] = {address: set() for address in addresses}
    if not addresses:
        return {}
    try:
        link = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_ICMP)
    except OSError:
        return {}
    identifier = int.from_bytes(os.urandom(2), "big")
    with link:
        link.setblocking(False)
        for number in range(COUNTED):
            for address in addresses:
                try:
                    link.sendto(echo_request(identifier, number), (address, 0))
                except OSError:
                    pass  # it counts as lost
            last = number == COUNTED - 1
            _count(link, identifier, got, time.monotonic() + (ANSWER if last else PACE))
    return {address: round(1 - len(numbers) / COUNTED, 3) for address, numbers in got.items()}


def _count(link: socket.socket, identifier: int, got: typing.Dict[str, typing.Set[int]], deadline: float) -> None:
    """Note answers until the deadline, or until nothing is missing."""
    for heard in read_echoes(link, identifier, deadline):
        if heard.outcome == Outcome.ANSWERED and heard.source in got:
            got[heard.source].add(heard.sequence)
        if all(len(numbers) == COUNTED for numbers in got.values()):
            return


def try_unused_port(address: str) -> typing.Tuple[Outcome, str]:
    """Try a TCP port that no program uses. It is refused if the computer is there; else the text says why nothing came."""
    answer = connect(address, UNUSED, ANSWER)
    if answer.outcome == Outcome.OPEN:  # a program listens all the same, so the computer is there as well
        return Outcome.REFUSED, "refused"
    return answer.outcome, "refused" if answer.outcome == Outcome.REFUSED else answer.words


# The answers for a user without rights: a file of name services may be closed to all but root.
_LOOK_UP = """
import json, socket, sys
found = {}
for name in json.load(sys.stdin):
    try:
        answers = socket.getaddrinfo(name, None, socket.AF_INET, socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        answers = []
    found[name] = sorted({answer[4][0] for answer in answers})
print(json.dumps(found))
"""


def user_addresses(names: typing.List[str]) -> typing.Dict[str, typing.List[str]]:
    """Look up the IPv4 addresses of names as a user without rights; empty if that user can run no Python."""
    answer = run(
        [sys.executable, "-I", "-c", _LOOK_UP], limit=15.0, user=find_nobody(), given=json.dumps(names).encode()
    )
    found = last_line(answer.output) if answer.status == 0 else None
    return found if isinstance(found, dict) else {}


def file_addresses(path: str = "/etc/hosts") -> typing.Dict[str, typing.List[str]]:
    """Read the addresses of each name in /etc/hosts, with the names in small letters (hosts(5))."""
    found: typing.Dict[str, typing.List[str]] = {}
    for address, *names in filter(None, (line.partition("#")[0].split() for line in text(path).splitlines())):
        for name in names:
            found.setdefault(name.lower(), []).append(address)
    return found


def name_sources(path: str = "/etc/nsswitch.conf") -> typing.List[str]:
    """Read the sources of host names, in their order; empty if the file names no source (nsswitch.conf(5))."""
    for line in text(path).splitlines():
        database, colon, sources = line.partition("#")[0].partition(":")
        if colon and database.strip() == "hosts":
            return re.sub(r"\[[^]]*\]", " ", sources).split()
    return []


def ping(
    addresses: typing.Iterable[str],
    tries: int = TRIES,
    answer: float = ANSWER,
    sizes: typing.Optional[typing.Dict[str, int]] = None,
) -> typing.Dict[str, EchoAnswer]:
    """Send ICMP echo requests to all addresses at once, and again to those that do not answer (RFC 792); needs root.

    With `sizes`, the packet to each address has so many bytes, and no router may split it.
    """
    results = {address: EchoAnswer(Outcome.NO_ANSWER, tries=tries) for address in addresses}
    if not results:
        return results
    try:
        link = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_ICMP)
    except OSError as problem:
        return dict.fromkeys(results, EchoAnswer(Outcome.FAILED, errno=problem.errno))
    with link:
        link.setblocking(False)
        if sizes:
            link.setsockopt(socket.IPPROTO_IP, IP_MTU_DISCOVER, IP_PMTUDISC_PROBE)
        _ask(link, results, tries, answer, sizes or {})
    return results


def _ask(
    link: socket.socket, results: typing.Dict[str, EchoAnswer], tries: int, answer: float, sizes: typing.Dict[str, int]
) -> None:
    """Send requests to the addresses without an answer yet, and read the answers, as often as is asked for."""
    identifier = int.from_bytes(os.urandom(2), "big")
    sent: typing.Dict[int, typing.Tuple[str, float]] = {}
    for unused in range(tries):
        late = [address for address, entry in results.items() if not entry.ok]
        for address in late:
            sequence = len(sent) & 0xFFFF
            sent[sequence] = address, time.monotonic()
            try:
                link.sendto(echo_request(identifier, sequence, sizes.get(address, 0)), (address, 0))
            except OSError as problem:
                outcome, number = classify_error(problem)
                results[address] = EchoAnswer(outcome, errno=number, tries=tries)
        for heard in read_echoes(link, identifier, time.monotonic() + answer) if late else ():
            address, when = sent.get(heard.sequence, ("", 0.0))
            if address and not results[address].ok:
                results[address] = _judge(heard, address, when, tries)
            if all(entry.ok for entry in results.values()):
                return


def _judge(heard: EchoReply, address: str, when: float, tries: int) -> EchoAnswer:
    """The answer to the request that was sent to an address at a time (monotonic seconds)."""
    answer = EchoAnswer(heard.outcome, None, None, heard.type, heard.code, heard.source, tries)
    if heard.outcome != Outcome.ANSWERED:
        return answer
    if heard.source != address:
        return answer._replace(outcome=Outcome.WRONG_SOURCE)
    return answer._replace(rtt_ms=round((time.monotonic() - when) * 1000, 3))


def route_to_plain(route: machine.RouteTo) -> typing.Dict[str, typing.Optional[str]]:
    """Return the route to a computer as the module does; `metric` is there if there is a route."""
    plain = {"device": route.device, "source": route.source, "gateway": route.gateway}
    return dict(plain, error=route.error) if route.error else dict(plain, metric=route.metric, error="")


def default_routes() -> typing.List[typing.Dict[str, typing.Optional[str]]]:
    """List the default routes of the main table as the module does."""
    return [
        DefaultRoute(route.device, route.source, route.gateway, route.metric).plain()
        for route in machine.default_routes()
    ]


def policy() -> typing.Dict[str, typing.List[str]]:
    """Read the rules that lead to other tables, and the routes of all tables that lead nowhere (ip-route(8))."""
    shown = run(["ip", "-4", "route", "show", "table", "all"]).text
    lines = (" ".join(line.split()) for line in shown.splitlines())
    closed = [line for line in lines if line.startswith(CLOSED)]
    return PolicyRouting(tuple(machine.policy_rules()[:MOST_LINES]), tuple(closed[:MOST_LINES])).plain()


def forwarding(root: str = "/proc/sys/net/ipv4") -> typing.Dict[str, typing.Any]:
    """Read the settings by which packets pass from one network to another here (Documentation/networking/ip-sysctl).

    For each interface with an IPv4 address: forwarding of packets that come in there, the effective reverse-path filter
    (the larger value of `all` and the interface), and the sending of redirects (if either of the two says so). Null
    means a value that cannot be read.

    An interface without an address is listed only with its hardware address: a port of a bridge, or one below a macvlan,
    answers ARP for the addresses of all interfaces.
    """

    def value(*words: str) -> typing.Optional[int]:
        content = text(os.path.join(root, *words)).strip()
        return int(content) if content.isdigit() else None

    def larger(interface: str, setting: str) -> typing.Optional[int]:
        both = [value("conf", place, setting) for place in ("all", interface)]
        return None if None in both else max(value for value in both if value is not None)

    found, interfaces = [], machine.interfaces()
    for interface in interfaces:
        name, addresses = interface.name, [entry for entry in interface.addresses if entry.family == "inet"]
        if addresses and not interface.loopback:
            settings = {
                "forwarding": value("conf", name, "forwarding"),
                "rp_filter": larger(name, "rp_filter"),
                "send_redirects": larger(name, "send_redirects"),
            }
            places = {"addresses": [one.address for one in addresses], "prefixes": [one.prefix for one in addresses]}
            link = dict(link_of(name), mtu=interface.mtu or None, port_of=interface.port_of)
            link["point_to_point"] = interface.point_to_point
            found.append(dict(link, interface=name, **settings, **places))
    _add_last_words(found)
    switches = {name: value(name) for name in ("ip_forward", "icmp_echo_ignore_all")}
    return {**switches, "interfaces": found, "macs": _list_hardware_addresses(interfaces)}


def _add_last_words(links: typing.List[typing.Dict[str, typing.Any]]) -> None:
    """Add the journal's last line on links that are down, as those of unused bridges; of all at once, since a journal may be slow."""
    down = [link["interface"] for link in links if link["state"] in DOWN]
    said = dict(zip(down, call_all(carrier, down, LOG + 1.0, lambda name: "")))
    for link in links:
        link["last"] = said.get(link["interface"], "")


def _list_hardware_addresses(interfaces: typing.Iterable[machine.NetworkInterface]) -> typing.List[str]:
    """List those that may answer ARP, once each."""
    asked = (one for one in interfaces if one.up and not one.loopback and not one.point_to_point)
    macs = dict.fromkeys(text(f"/sys/class/net/{one.name}/address").strip() for one in asked)
    return list(filter(None, macs))[:MOST_LINES]


def link_of(interface: str) -> typing.Dict[str, typing.Any]:
    """Read the state that the kernel reports of the link of an interface."""

    def read(name: str) -> str:
        return text(f"/sys/class/net/{interface}/{name}").strip()

    count = read("carrier_changes")
    return {
        "mac": read("address"),
        "state": read("operstate"),
        "carrier_changes": int(count) if count.isdigit() else None,
        "power_save": saves_power(interface),
    }


def saves_power(interface: str, root: str = "/sys/class/net") -> typing.Optional[bool]:
    """Return True if a wireless interface saves power (iw(8)); None if it is no station, or iw does not report it.

    Of an access point, too, the kernel may tell "on"; but only a station saves power.
    """
    if not any(os.path.exists(os.path.join(root, interface, mark)) for mark in ("wireless", "phy80211")):
        return None
    saves = re.search(r"Power save: (on|off)$", run(["iw", "dev", interface, "get", "power_save"]).text, re.MULTILINE)
    if saves and saves.group(1) == "on":
        kind = re.search(r"^\s*type (.+)$", run(["iw", "dev", interface, "info"]).text, re.MULTILINE)
        return None if kind and kind.group(1) not in STATIONS else True
    return False if saves else None


def call(addresses: typing.Sequence[str], port: int) -> str:
    """Send empty datagrams, which a discovery node ignores, so that the helpers there see their source address.

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
