# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""The process and the sockets of multicast_verify's helper, and the ICMP rounds; helper.py decides what they mean.

A discovery node that holds the port is not disturbed. A second socket on its port would need its user (SO_REUSEPORT),
and would take unicast datagrams away from it. The helper listens on a raw socket instead: the kernel gives it a copy
of a datagram, behind the firewall's input rules as an application's, whoever holds the port, and the port itself
stays as it is.
"""

import ctypes
import glob
import hashlib
import json
import os
import random
import select
import signal
import socket
import struct
import syslog
import time
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify.helper import (
    Address,
    Datagrams,
    Helper,
    Settings,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify.packets import echo, echo_request, packet

FOLDER = "/run/rosfleet-multimaster"

# linux/in.h, linux/icmp.h and asm-generic/socket.h; Python does not name them in every version
IP_PKTINFO = 8
SO_ATTACH_FILTER = 26
SOL_RAW = 255
ICMP_FILTER = 1

LINK_LOCAL = "224.0.0."
TTL_LINK_LOCAL, TTL = 1, 20  # as the discovery nodes send
LONGEST_LINE = 1 << 20  # bytes of a request or reply on the helper's own socket
ICMP_PAUSE = 0.5  # seconds between two rounds; a late reply is counted for the round that asked


# The helper's sockets


class Sockets(typing.NamedTuple):
    """The sockets of a helper."""

    copies: socket.socket  # raw: a copy of each datagram for the group's port
    control: socket.socket  # sends probes, and speaks with other helpers
    door: socket.socket  # the module's next run comes in here


def open_sockets(settings: Settings, index: int, path: str) -> Sockets:
    """Open the sockets of a helper; `index` is the number of the interface, `path` that of the door. Raises OSError."""
    opened: typing.List[socket.socket] = []
    try:
        for make in (
            lambda: _copies(settings, index),
            lambda: _control(settings, index),
            lambda: _door(path),
        ):
            opened.append(make())
    except OSError:
        for item in opened:
            item.close()
        raise
    return Sockets(*opened)


def _member(group: str, address: str, index: int) -> bytes:
    """Pack a struct ip_mreqn (ip(7))."""
    return struct.pack("4s4si", socket.inet_aton(group), socket.inet_aton(address), index)


def _copies(settings: Settings, index: int) -> socket.socket:
    raw = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_UDP)
    raw.setblocking(False)
    _only_port(raw, settings.port)
    raw.setsockopt(socket.IPPROTO_IP, IP_PKTINFO, 1)
    raw.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, _member(settings.group, settings.address, index))
    return raw


def _only_port(raw: socket.socket, port: int) -> None:
    """Let only UDP datagrams to port through, and 64 bytes of each: a robot's other UDP traffic costs nothing here.

    The classic BPF program sees the packet from its IP header on: x = length of that header; port = 16 bits at x + 2.
    """
    program = ((0xB1, 0, 0, 0), (0x48, 0, 0, 2), (0x15, 0, 1, port), (0x06, 0, 0, 64), (0x06, 0, 0, 0))
    code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *line) for line in program))
    raw.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, struct.pack("HP", len(program), ctypes.addressof(code)))


def _control(settings: Settings, index: int) -> socket.socket:
    control = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    control.setblocking(False)
    control.bind((settings.address, 0))
    routable = not settings.group.startswith(LINK_LOCAL)
    control.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, TTL if routable else TTL_LINK_LOCAL)
    # A gateway that routes multicast passes on what it sends itself only if that is looped back.
    control.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, int(routable))
    control.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, _member("0.0.0.0", settings.address, index))
    return control


def _door(path: str) -> socket.socket:
    os.makedirs(os.path.dirname(path), 0o755, exist_ok=True)
    door = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    before = os.umask(0o177)  # for root only
    try:
        door.bind(path)
        door.listen(8)
    except OSError:
        door.close()
        raise
    finally:
        os.umask(before)
    return door


def door_path(run: str) -> str:
    """Return the path of the door of a run's helper. Everybody here can read it: it does not give the label away."""
    name = hashlib.sha256(b"door " + run.encode()).hexdigest()[:16]
    return os.path.join(FOLDER, f"multicast-{name}.sock")


# The helper's process


def detach(sockets: Sockets, settings: Settings, path: str) -> None:
    """Leave a helper behind, as a process of its own that has nothing open but its sockets."""
    child = os.fork()
    if child:
        os.waitpid(child, 0)
        return
    try:
        os.setsid()
        if os.fork():
            os._exit(0)
        _let_go(item.fileno() for item in sockets)
        serve(sockets, settings, path)
    except Exception as error:  # nobody else is left to tell
        syslog.syslog(syslog.LOG_ERR, f"multicast_verify's helper ended: {error!r}")
    finally:
        os._exit(0)


def _leave(*unused: typing.Any) -> None:
    raise SystemExit  # so that serve() puts the door away


def _let_go(kept: typing.Iterable[int]) -> None:
    """Close everything but these descriptors: no terminal, no pipe of Ansible's and no folder stays busy."""
    os.chdir("/")
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)
    numbers = set(kept)
    for number in [int(name) for name in os.listdir("/proc/self/fd")]:
        if number not in numbers:
            try:
                os.close(number)
            except OSError:
                pass  # the listing's own descriptor
    for standard in (os.O_RDONLY, os.O_WRONLY, os.O_WRONLY):
        os.open(os.devnull, standard)


def serve(sockets: Sockets, settings: Settings, path: str) -> None:
    """Be the helper until it is no longer needed: move datagrams between the sockets and Helper."""
    helper = Helper(settings, time.monotonic())
    interfaces = dict(socket.if_nameindex())
    errors: typing.Dict[str, typing.Any] = {"count": 0, "last": None}
    waiting: typing.List[socket.socket] = []
    try:
        while not helper.over(time.monotonic()):
            send(sockets.control, helper.poll(time.monotonic(), time.time()), errors)
            if waiting and helper.rounds is None:
                reply = dict(helper.result(), send_errors=errors)
                while waiting:
                    answer(waiting.pop(), reply)
            pause = max(0.0, helper.due - time.monotonic())
            for ready in select.select(sockets, [], [], pause)[0]:
                if ready is sockets.copies:
                    for arrived in copies(ready, settings.port, interfaces):
                        send(sockets.control, helper.datagram(time.monotonic(), *arrived), errors)
                elif ready is sockets.control:
                    for data, source in datagrams(ready):
                        send(sockets.control, helper.message(time.monotonic(), time.time(), source, data), errors)
                else:
                    connection, request = admit(ready)
                    if request.get("do") == "end":
                        waiting.append(connection)  # closed when everything is put away
                        return
                    if request.get("settings") != plain(settings):
                        answer(connection, {"settings": plain(settings)})
                        continue
                    helper.measure(time.monotonic(), request["rounds"], request["interval"], request["unicast"])
                    waiting.append(connection)
    finally:
        put_away(path)
        for connection in waiting:
            connection.close()


def plain(settings: Settings) -> typing.List[typing.Any]:
    """List the settings that must be the same in both tasks of a run, in a form that JSON leaves as it is."""
    computers = [list(item) for item in sorted(settings.computers.items())]
    return [settings.run, settings.group, settings.port, settings.address, computers, sorted(settings.apart)]


def send(control: socket.socket, outgoing: Datagrams, errors: typing.Dict[str, typing.Any]) -> None:
    """Send each (payload, destination); what the kernel refuses (no route, an output rule) is counted and named."""
    for payload, destination in outgoing:
        try:
            control.sendto(payload, destination)
        except OSError as error:
            errors["count"] += 1
            errors["last"] = f"{destination[0]}:{destination[1]}: {error.strerror}"


def copies(
    raw: socket.socket, port: int, interfaces: typing.Dict[int, str]
) -> typing.Iterator[typing.Tuple[Address, str, str, int]]:
    """Yield (source, destination, interface, length of the payload) of each waiting UDP datagram for a port."""
    for unused in range(1000):
        try:
            data, ancillary = raw.recvmsg(128, 64)[:2]
        except OSError:
            return
        found = packet(data)
        if found is None or len(found.body) < 8:
            continue
        origin, target, length = struct.unpack("!HHH", found.body[:6])
        index = [
            struct.unpack("i", info[:4])[0]
            for level, kind, info in ancillary
            if (level, kind) == (socket.IPPROTO_IP, IP_PKTINFO)
        ]
        if target == port and index:
            interface = interfaces.get(index[0], str(index[0]))
            yield (found.source, origin), found.destination, interface, length - 8


def datagrams(control: socket.socket) -> typing.Iterator[typing.Tuple[bytes, Address]]:
    """Yield (payload, source) of each waiting datagram."""
    for unused in range(1000):
        try:
            yield control.recvfrom(512)
        except OSError:
            return


# The door: one JSON line in, one out


def admit(door: socket.socket) -> typing.Tuple[socket.socket, typing.Dict[str, typing.Any]]:
    """Accept the next visitor; its request is empty where it is not understood."""
    connection = door.accept()[0]
    connection.settimeout(2)
    try:
        request = json.loads(_line(connection))
    except (OSError, ValueError):
        request = {}
    return connection, request if isinstance(request, dict) else {}


def answer(connection: socket.socket, reply: typing.Dict[str, typing.Any]) -> None:
    try:
        connection.settimeout(5)
        connection.sendall(json.dumps(reply).encode() + b"\n")
    except OSError:
        pass  # the one who asked is gone
    finally:
        connection.close()


def _line(connection: socket.socket) -> str:
    data = b""
    while not data.endswith(b"\n") and len(data) < LONGEST_LINE:
        more = connection.recv(65536)
        if not more:
            break
        data += more
    return data.decode()


class Visit:
    """A request to this computer's helper. Raises OSError when there is none."""

    def __init__(self, path: str, request: typing.Dict[str, typing.Any]) -> None:
        if os.stat(path).st_uid != os.geteuid():
            raise PermissionError(f"{path} belongs to another user")
        self.connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.connection.settimeout(5)
        self.connection.connect(path)
        self.connection.sendall(json.dumps(request).encode() + b"\n")

    def reply(self, seconds: float) -> typing.Optional[typing.Dict[str, typing.Any]]:
        """Read the helper's reply; None where it ended without one, or not within that time."""
        self.connection.settimeout(seconds)
        try:
            return json.loads(_line(self.connection))
        except (OSError, ValueError):
            return None
        finally:
            self.connection.close()


def end_others() -> int:
    """End every older helper of this computer, through its own door; a door without a helper is only removed."""
    ended = 0
    for path in glob.glob(os.path.join(FOLDER, "multicast-*.sock")):
        try:
            Visit(path, {"do": "end"}).reply(5)
            ended += 1
        except ConnectionRefusedError:
            put_away(path)
        except FileNotFoundError:
            pass  # it has just ended by itself
    return ended


def put_away(path: str) -> None:
    """Remove a door, and its folder if that is empty."""
    for remove, what in ((os.unlink, path), (os.rmdir, os.path.dirname(path))):
        try:
            remove(what)
        except OSError:
            pass  # gone already, or the folder holds more than our door


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
            until = time.monotonic() + ICMP_PAUSE * (2 if number == rounds - 1 else 1)
            while time.monotonic() < until:
                if not select.select([raw], [], [], max(0.0, until - time.monotonic()))[0]:
                    break
                reply = echo(raw.recv(256), identifier)
                if reply and not reply.error and reply.sequence < rounds:
                    answered[reply.sequence].add(reply.source)
    return answered
