# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The life of discovery's UDP sockets: opened, watched, and opened again where the network changes."""

import ipaddress
import os
from functools import partial
from typing import Any, Callable, Dict, Mapping, Optional, Set, Tuple

from ..core.discovery import Send
from ..edge.addresses import addresses, addresses_of_all, resolve, source_address
from ..edge.clock import monotonic, sleep
from ..edge.loop import Loop, Recurring, Workers
from ..edge.systemd import notify
from ..edge.udp import Datagram, Socket, Udp
from . import program

REOPEN = 0.5  # seconds between two attempts to open the sockets: a link that comes back is used at once
RESOLVE = 60.0  # seconds between two looks at the addresses of ~robot_hosts
RESOLVE_AGAIN = 5.0  # the same where one of them has none


class Datagrams:
    """The datagrams of discovery. Sockets come and go with the network."""

    def __init__(
        self,
        values: Mapping[str, Any],
        loop: Loop,
        resolvers: Workers,
        limited: program.Limited,
        errors: Dict[str, str],
    ) -> None:
        """`values` are the parameters of master_discovery. `errors` takes what others are told of failures to send."""
        self.own_addresses: Set[str] = set()
        self.place = ("", 0)  # the own address that the others hear, and the index of its interface
        self._values, self._loop, self._limited, self._errors = values, loop, limited, errors
        self._group, self._port = values["mcast_group"].partition("@")[0], values["mcast_port"]
        self._interface = interface_name(values)
        self._pinned = ""
        self._udp: Optional[Udp] = None
        self._open_due = 0.0
        self._problem = ""
        self._hosts: Dict[str, str] = {}  # ~robot_hosts -> address
        hosts = values["robot_hosts"]
        self._lookups = Recurring(  # a name server knows no time limit, and the next look may be answered
            resolvers,
            lambda: RESOLVE,
            lambda: addresses_of_all(hosts),
            self._resolved,
            lambda: bool(hosts),
            overlapping=True,
        )
        self._received: Callable[[Datagram, float], None] = lambda _datagram, _now: None
        self._moved: Callable[[], None] = lambda: None
        self._opened: Callable[[float], None] = lambda _now: None

    def open_until_it_works(self) -> None:
        """Open the sockets; blocks until that is possible."""
        self._open(monotonic())
        while self._udp is None:
            notify(f"STATUS={self._problem}", "EXTEND_TIMEOUT_USEC=30000000")
            sleep(REOPEN)
            self._open(monotonic())

    def tell(
        self,
        received: Callable[[Datagram, float], None],
        moved: Callable[[], None],
        opened: Callable[[float], None],
    ) -> None:
        """Set the callbacks: a datagram arrived, the own addresses changed, the sockets were opened again."""
        self._received, self._moved, self._opened = received, moved, opened

    def tick(self, now: float) -> Optional[float]:
        """Do what is due; the time of the next call, None for any."""
        if self._udp is None and now >= self._open_due:
            self._open(now)
        due = [self._lookups.tick(now), self._open_due if self._udp is None else None]
        return min((time for time in due if time is not None), default=None)

    def look_at_addresses(self) -> None:
        """See whether the own addresses changed: nobody at one is another master, and sockets belong to one."""
        try:
            own, place = self._addresses()
        except OSError:  # the kernel is busy: in a second again
            return
        if own != self.own_addresses:
            self.own_addresses = own
            self._moved()
        if place != self.place:
            self._close()

    def send(self, action: Send) -> None:
        """Carry out a Send of the core. A network that has gone makes new sockets."""
        host = action.host
        if host is not None:
            try:
                host = str(ipaddress.IPv4Address(host))
            except ValueError:
                host = self._hosts.get(host)
            if host is None or host in self.own_addresses:
                return
        if self._udp is None:
            return
        try:
            self._udp.send(action.datagram, host)
        except BlockingIOError:
            pass
        except OSError as problem:
            text = f"nothing can be sent to {host or self._group}: {problem}"
            self._limited.say("error", "send" if host is None else "send to a host", text)
            if host is None or action.host in self._values["robot_hosts"]:  # others may be anybody's invention
                self._errors[f"send {host}"] = text
            if host is None:
                self._close()
        else:
            self._errors.pop(f"send {host}", None)

    def _open(self, now: float) -> None:
        multicast = self._values["send_mcast"] or self._values["listen_mcast"]
        try:
            self._pinned = resolve(self._interface) if self._interface else ""
            self.own_addresses, self.place = self._addresses()
            self._udp = Udp(self._group, self._port, self._pinned, multicast and self._values["listen_mcast"])
        except OSError as problem:
            self._open_due = now + REOPEN
            self._problem = f"discovery cannot use {self._group} port {self._port} on {self._interface or 'any interface'}: {problem}"
            self._limited.say("error", "open", self._problem)
            return
        for opened in self._udp.sockets:
            self._loop.watch(opened, partial(self._receive, opened))
        self._limited.say(
            "info",
            "opened",
            f"discovery by {self._group if multicast else 'unicast'} on {self.place[0]}, port {self._port}",
        )
        self._opened(now)

    def _close(self) -> None:
        """Have new sockets in a moment, since the network has changed."""
        if self._udp is not None:
            for opened in self._udp.sockets:
                self._loop.forget(opened)
            self._udp.close()
            self._udp, self._open_due = None, monotonic() + REOPEN

    def _receive(self, readable: Socket) -> None:
        if self._udp is not None:
            now = monotonic()
            for datagram in self._udp.receive(readable):
                self._received(datagram, now)

    def _addresses(self) -> Tuple[Set[str], Tuple[str, int]]:
        """The own addresses, and the one that the others hear, with its interface."""
        found = dict(addresses())
        own = {*found, "localhost"}
        heard = self._pinned or source_address(self._group, self._port, own)
        return own, (heard, found.get(heard, 0))

    def _resolved(self, found: Optional[Mapping[str, str]], _problem: Optional[Exception]) -> None:
        for host in self._values["robot_hosts"]:
            if found is not None and host in found:
                self._hosts[host] = found[host]
            elif host not in self._hosts:
                self._limited.say(
                    "warning", f"host {host}", f"~robot_hosts names {host}, which has no address on this computer"
                )
                self._lookups.due = min(self._lookups.due, monotonic() + RESOLVE_AGAIN)


def interface_name(values: Mapping[str, Any]) -> str:
    """The interface to which discovery is pinned, in upstream's order: parameters, ROS_HOSTNAME, ROS_IP; "" for none."""
    pinned = values["mcast_group"].partition("@")[2] or values["interface"]
    if pinned:
        return str(pinned)
    name = os.environ.get("ROS_HOSTNAME", "")
    if name:
        try:
            if not resolve(name).startswith("127."):
                return name
        except OSError:
            program.LOG.warning("ROS_HOSTNAME is %s, which has no address on this computer", name)
    return os.environ.get("ROS_IP", "")
