# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""The process and the sockets of multicast_verify's helper, and the ICMP rounds; helper.py interprets them.

A discovery node that holds the port is not disturbed. A second socket on its port would need its user (SO_REUSEPORT),
and would take unicast datagrams away from it. The helper listens on a raw socket instead: the kernel gives it a copy
of a datagram, behind the firewall's input rules as an application's, whichever program holds the port. The port
itself stays as it is.
"""

import random
import select
import socket
import struct
import time
import typing

from ..._base.background import admit, answer, open_door, remove_door
from ..._contract.outcomes import Outcome
from .helper import Datagrams, Helper, HelperSettings
from .packets import IP_PKTINFO, echo_request, open_copies, read_copies, read_echoes, take_waiting

# linux/in.h and linux/icmp.h; Python does not name them in every version
SOL_RAW = 255
ICMP_FILTER = 1

LINK_LOCAL = "224.0.0."
TTL_LINK_LOCAL, TTL = 1, 20  # as the discovery nodes send
# Seconds between two rounds, and after the last one. A late reply is counted for the round that asked. Together they take no
# longer than the datagrams, which are measured meanwhile.
ICMP_PAUSE, ICMP_LAST = 0.3, 1.0


# The helper's sockets


class HelperSockets(typing.NamedTuple):
    """The sockets of a helper."""

    copies: socket.socket  # raw: a copy of each datagram for the group's port
    control: socket.socket  # sends probes, and speaks with other helpers
    door: socket.socket  # the module's next run comes in here


def open_sockets(settings: HelperSettings, index: int, path: str) -> HelperSockets:
    """Open the sockets of a helper; `index` is the number of the interface, `path` that of the door. Raises OSError."""
    return HelperSockets(_copies(settings, index), _control(settings, index), open_door(path))


def _member(group: str, address: str, index: int) -> bytes:
    """Pack a struct ip_mreqn (ip(7))."""
    return struct.pack("4s4si", socket.inet_aton(group), socket.inet_aton(address), index)


def _copies(settings: HelperSettings, index: int) -> socket.socket:
    raw = open_copies(settings.port)
    raw.setsockopt(socket.IPPROTO_IP, IP_PKTINFO, 1)
    raw.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, _member(settings.group, settings.address, index))
    return raw


def _control(settings: HelperSettings, index: int) -> socket.socket:
    control = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    control.setblocking(False)
    control.bind((settings.address, 0))
    routable = not settings.group.startswith(LINK_LOCAL)
    control.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, TTL if routable else TTL_LINK_LOCAL)
    # A gateway that routes multicast passes its own datagrams on only if that is looped back.
    control.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, int(routable))
    control.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, _member("0.0.0.0", settings.address, index))
    return control


# The helper's process


def serve(sockets: HelperSockets, settings: HelperSettings, path: str) -> None:
    """Be the helper until it is no longer needed: move datagrams between the sockets and Helper."""
    helper = Helper(settings, time.monotonic())
    interfaces = dict(socket.if_nameindex())
    errors: typing.Dict[str, typing.Any] = {"count": 0, "last": None}
    waiting: typing.List[socket.socket] = []
    try:
        while not helper.is_over(time.monotonic()):
            send(sockets.control, helper.poll(time.monotonic(), time.time()), errors)
            if waiting and helper.rounds is None:
                reply = dict(helper.result(), send_errors=errors)
                while waiting:
                    answer(waiting.pop(), reply)
            pause = max(0.0, helper.due - time.monotonic())
            for ready in select.select(sockets, [], [], pause)[0]:
                if ready is sockets.copies:
                    for found, index in read_copies(ready, settings.port):
                        if index:
                            place = found.destination, interfaces.get(index, str(index))
                            introduced = helper.datagram(time.monotonic(), found.source, *place, found.length)
                            send(sockets.control, introduced, errors)
                elif ready is sockets.control:
                    for data, source in take_waiting(lambda: sockets.control.recvfrom(512)):
                        send(sockets.control, helper.message(time.monotonic(), time.time(), source, data), errors)
                else:
                    visitor = admit(ready)
                    if visitor is None:
                        continue
                    connection, request = visitor
                    if request.get("do") == "end":
                        waiting.append(connection)  # closed when everything is put away
                        return
                    if request.get("settings") != plain(settings):
                        answer(connection, {"settings": plain(settings)})
                        continue
                    helper.measure(time.monotonic(), request["rounds"], request["interval"], request["unicast"])
                    waiting.append(connection)
    finally:
        remove_door(path)
        for connection in waiting:
            connection.close()


def plain(settings: HelperSettings) -> typing.List[typing.Any]:
    """List the settings that must be the same in both tasks of a run, in a form that JSON leaves as it is.

    The label of the run is not among them: the door has it, and sentences to a user have this list.
    """
    computers = [list(item) for item in sorted(settings.computers.items())]
    return [settings.group, settings.port, settings.address, computers, sorted(settings.apart)]


def send(control: socket.socket, outgoing: Datagrams, errors: typing.Dict[str, typing.Any]) -> None:
    """Send each (payload, destination); refusals of the kernel (no route, an output rule) are counted and named."""
    for payload, destination in outgoing:
        try:
            control.sendto(payload, destination)
        except OSError as error:
            errors["count"] += 1
            errors["last"] = f"{destination[0]}:{destination[1]}: {error.strerror}"


# The report's `ping 224.0.0.1`


def icmp_rounds(address: str, index: int, group: str, rounds: int) -> typing.List[typing.Set[str]]:
    """Send ICMP echo requests to the group; return for each the set of addresses that answered. Raises OSError."""
    identifier = random.randrange(1, 1 << 16)
    answered: typing.List[typing.Set[str]] = [set() for unused in range(rounds)]
    with socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_ICMP) as raw:
        raw.setsockopt(SOL_RAW, ICMP_FILTER, struct.pack("I", ~1 & 0xFFFFFFFF))  # echo replies only
        raw.bind((address, 0))
        raw.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, TTL_LINK_LOCAL)
        raw.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 0)
        raw.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, _member("0.0.0.0", address, index))
        for number in range(rounds):
            raw.sendto(echo_request(identifier, number), (group, 0))
            until = time.monotonic() + (ICMP_LAST if number == rounds - 1 else ICMP_PAUSE)
            for reply in read_echoes(raw, identifier, until):
                if reply.outcome == Outcome.ANSWERED and reply.sequence < rounds:
                    answered[reply.sequence].add(reply.source)
    return answered
