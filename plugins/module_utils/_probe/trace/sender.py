# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The sender: this computer sends the failed packets once more, with the tag of the run.

A connection is an ordinary one, since rules for users, connections and states must treat it as that of a node.
"""

import socket
import struct
import time
import typing

from ..._contract.outcomes import Outcome
from ..._machine.network import interfaces, route_to
from ..._machine.outcomes import classify_error
from ..multicast.packets import IP_MTU_DISCOVER, IP_PMTUDISC_PROBE, echo_request, read_echoes
from .capture import Tag

LARGEST = 1500  # bytes of an echo request
PATIENCE = 2.5  # seconds for a connection: time for a second SYN
HEARING = 1.5  # seconds for the answers to echo requests
TIMES = 3  # datagrams and echo requests of each probe
TTL = 20  # of datagrams to the group, as the discovery nodes send
ASKED = b"HEAD / HTTP/1.0\r\n\r\n"  # a question that every server of XML-RPC answers, be it with an error

UNACKED = struct.Struct("24xI")  # its place in tcp_info: eight bytes, four numbers before it

Probe = typing.Dict[str, typing.Any]


class SendResult(typing.NamedTuple):
    """The end of a probe, as far as its sender knows."""

    number: int
    outcome: Outcome
    errno: typing.Optional[int] = None
    source_port: int = 0
    data: Outcome = Outcome.NOT_TRIED  # of a question in an open connection
    unconfirmed: int = 0  # packets of this question without a confirmation by the other kernel


def send(tag: Tag, probe: Probe) -> SendResult:
    """Send a probe."""
    try:
        return _SENDERS[probe["protocol"]](tag, probe)
    except OSError as problem:
        return SendResult(probe["number"], *classify_error(problem))


def _fit(probe: Probe) -> int:
    """Return the bytes that the interface carries of those asked for: the first look has sent no more. Raises OSError."""
    if not probe["size"]:
        return 0
    device = route_to(probe["address"]).device
    mtu = next((interface.mtu for interface in interfaces() if interface.name == device), 0)
    return min(probe["size"], mtu or LARGEST)


def _send_echo(tag: Tag, probe: Probe) -> SendResult:
    size = _fit(probe)
    try:
        link = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_ICMP)
    except PermissionError as problem:  # no CAP_NET_RAW, as in some containers: nothing was tried
        return SendResult(probe["number"], Outcome.FAILED, problem.errno)
    with link:
        if size:  # it goes out as it is, or not at all
            link.setsockopt(socket.IPPROTO_IP, IP_MTU_DISCOVER, IP_PMTUDISC_PROBE)
        for _unused in range(TIMES):
            link.sendto(echo_request(tag.identifier, probe["number"], size), (probe["address"], 0))
        return SendResult(probe["number"], _hear(link, tag, probe["number"]))


def _hear(link: socket.socket, tag: Tag, number: int) -> Outcome:
    """Return True if an answer reaches a program here: the listener sees it before the packet filter of this computer does."""
    heard = read_echoes(link, tag.identifier, time.monotonic() + HEARING)
    answered = any(found.sequence == number and found.outcome == Outcome.ANSWERED for found in heard)
    return Outcome.ANSWERED if answered else Outcome.NO_ANSWER


def _send_datagram(tag: Tag, probe: Probe) -> SendResult:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, TTL)
        if probe["interface_address"]:
            link.bind((probe["interface_address"], 0))
            own = socket.inet_aton(probe["interface_address"])
            link.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, own)
        for _unused in range(TIMES):
            link.sendto(tag.payload(probe["number"]), (probe["address"], probe["port"]))
        return SendResult(probe["number"], Outcome.NO_ANSWER, None, link.getsockname()[1])


def _open_connection(_tag: Tag, probe: Probe) -> SendResult:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as link:
        link.settimeout(PATIENCE)
        outcome, number = Outcome.OPEN, None
        try:
            link.connect((probe["address"], probe["port"]))
        except OSError as problem:
            outcome, number = classify_error(problem)
        sent = SendResult(probe["number"], outcome, number, link.getsockname()[1])
        return sent._replace(data=_ask(link), unconfirmed=count_unconfirmed(link)) if outcome == Outcome.OPEN else sent


def _ask(link: socket.socket) -> Outcome:
    """Ask for anything in an open connection."""
    try:
        link.sendall(ASKED)
        return Outcome.ANSWERED if link.recv(1) else Outcome.REFUSED
    except OSError as problem:
        return classify_error(problem)[0]


def count_unconfirmed(link: socket.socket) -> int:
    """Return the number of packets without a confirmation by the other kernel: tcpi_unacked (linux/tcp.h). It confirms them even if its program hangs."""
    info = link.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, UNACKED.size)
    return int(UNACKED.unpack(info)[0])


_SENDERS = {"icmp": _send_echo, "udp": _send_datagram, "tcp": _open_connection}
