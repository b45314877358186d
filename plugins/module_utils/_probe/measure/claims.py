# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The computers that answer for an address on these networks. Two answers mean one address twice (RFC 826, RFC 5227).

A question from 0.0.0.0 changes no table. Every computer with the address answers, while the kernel takes only the first answer.
"""

import fcntl
import ipaddress
import select
import socket
import struct
import time
import typing

from ..._base.commands import text
from ..._contract.network import Claim
from ..._machine import network
from ..._machine.ports import address_of
from ..multicast.packets import read_arp

ARP, REQUEST, REPLY = 0x0806, 1, 2
ETHERNET, IPV4 = 1, 0x0800
HARDWARE_ADDRESS = 0x8927  # SIOCGIFHWADDR, netdevice(7)
EVERYBODY = b"\xff" * 6
MESSAGE = struct.Struct("!HHBBH6s4s6s4s")
TRIES, ANSWER = 2, 0.7  # questions for each address, and the seconds in which all answers are waited for
MOST = 128  # addresses that are asked for
MOST_ANSWERS = 8  # hardware addresses that are kept of one address

Question = typing.Tuple[str, str]  # interface, address
Answers = typing.Dict[Question, typing.List[str]]


def claims(addresses: typing.Iterable[str], path: str = "/proc/net/route") -> typing.List[typing.Dict[str, typing.Any]]:
    """Ask who has the own addresses, and who has those of these and of the gateways that are on a network of this computer."""
    wanted = questions(network.interfaces(), [*addresses, *gateways(text(path))])
    return [Claim(address, interface, tuple(macs)).plain() for (interface, address), macs in ask(wanted[:MOST]).items()]


def questions(
    interfaces: typing.Iterable[network.NetworkInterface], addresses: typing.Iterable[str]
) -> typing.List[Question]:
    """List which address is asked for on which interface: the own ones first."""
    own, others = [], []
    wanted = [ipaddress.IPv4Address(address) for address in dict.fromkeys(addresses)]
    for interface in interfaces:
        if interface.up and not interface.loopback and not interface.point_to_point:
            networks = [entry.interface for entry in interface.addresses if entry.family == "inet"]
            own += [(interface.name, str(entry.ip)) for entry in networks]
            near = (address for address in wanted if any(address in entry.network for entry in networks))
            others += [(interface.name, str(address)) for address in near]
    return list(dict.fromkeys(own + others))


def gateways(table: str) -> typing.List[str]:
    """List the gateways in the content of /proc/net/route (proc(5))."""
    found = {address_of(words[2]) for words in map(str.split, table.splitlines()[1:]) if len(words) > 2}
    return sorted(found - {"0.0.0.0"})


def ask(wanted: typing.Sequence[Question]) -> Answers:
    """Send the questions, and collect the hardware addresses of all who answer; empty if this is not allowed here."""
    answers: Answers = {question: [] for question in wanted}
    try:
        link = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(ARP))
    except (OSError, AttributeError):
        return {}
    with link:
        link.setblocking(False)
        for unused in range(TRIES if wanted else 0):
            for interface, address in wanted:
                _send(link, interface, address)
            _gather(link, answers, time.monotonic() + ANSWER)
    return answers


def _send(link: socket.socket, interface: str, address: str) -> None:
    try:
        reply = fcntl.ioctl(link, HARDWARE_ADDRESS, struct.pack("256s", interface.encode()[:15]))
        kind, mac = struct.unpack("=H", reply[16:18])[0], reply[18:24]
        if kind == ETHERNET:
            link.sendto(question(mac, address), (interface, ARP, 0, ETHERNET, EVERYBODY))
    except OSError:
        pass  # the interface is down now: no computer answers there


def question(mac: bytes, address: str) -> bytes:
    """Make the question which computer has an address; the question itself comes from no address."""
    return MESSAGE.pack(ETHERNET, IPV4, 6, 4, REQUEST, mac, bytes(4), bytes(6), socket.inet_aton(address))


def answer(message: bytes) -> typing.Optional[typing.Tuple[str, str]]:
    """Read the address and the hardware address out of an answer; None if the message is no answer."""
    found = read_arp(message)
    return (found.sender, found.mac) if found and found.kind == REPLY else None


def _gather(link: socket.socket, answers: Answers, deadline: float) -> None:
    while time.monotonic() < deadline:  # in a storm of ARP, there is always more
        if not select.select([link], [], [], max(0.0, deadline - time.monotonic()))[0]:
            return
        try:
            message, sender = link.recvfrom(256)
        except OSError:
            return
        reply = answer(message)
        macs = answers.get((sender[0], reply[0])) if reply else None
        if reply and macs is not None and reply[1] not in macs and len(macs) < MOST_ANSWERS:
            macs.append(reply[1])
