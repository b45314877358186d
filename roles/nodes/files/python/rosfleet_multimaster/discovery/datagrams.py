# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The life of discovery's UDP sockets: opened, watched, and opened again where the network changes."""

import ipaddress
import os
from functools import partial
from typing import Any, Callable, Dict, Mapping, NamedTuple, Optional, Set, Tuple

from ..edge.addresses import Changes, addresses_of_all, network, resolve, source_address
from ..edge.clock import monotonic
from ..edge.loop import Loop, RecurringJob, Workers
from ..edge.process import program
from .core.actions import Send
from .udp import Datagram, Socket, Udp

REOPEN = 0.5  # seconds between two attempts to open the sockets: a link that comes back is used at once
RESOLVE = 60.0  # seconds between two looks at the addresses of ~robot_hosts
RESOLVE_AGAIN = 5.0  # the same where one of them has none


class Place(NamedTuple):
    """Where this computer is in the network."""

    address: str  # the own address that the others hear
    interface: int  # the index of the one that has it, 0 for none
    running: bool  # that interface is up and has a carrier


class Callbacks(NamedTuple):
    """What the program hears of, in the loop."""

    received: Callable[[Datagram, float], None]
    moved: Callable[[], None]  # the own addresses changed
    opened: Callable[[float], None]  # the sockets were opened
    changed: Callable[[], None]  # something changed in the network


class Datagrams:
    """The datagrams of discovery. Sockets come and go with the network; without one, the node works for its own robot."""

    def __init__(
        self,
        values: Mapping[str, Any],
        loop: Loop,
        resolvers: Workers,
        limited: program.LimitedLog,
        errors: Dict[str, str],
        callbacks: Callbacks,
    ) -> None:
        """`values` are the parameters of master_discovery. `errors` takes what others are told of failures to send."""
        self.own_addresses: Set[str] = set()
        self.place = Place("", 0, False)
        self.problem = ""  # why there are no sockets; "" where there are some
        self.hears_of_changes = False  # of the network
        self.sent = self.received = 0  # datagrams
        self._values, self._loop, self._limited, self._errors = values, loop, limited, errors
        self._callbacks = callbacks
        self._group, self._port = values["mcast_group"].partition("@")[0], values["mcast_port"]
        self._interface = interface_name(values)
        self._pinned = ""
        self._udp: Optional[Udp] = None
        self._open_due = 0.0
        self._hosts: Dict[str, str] = {}  # ~robot_hosts -> address
        hosts = values["robot_hosts"]
        self._lookups = RecurringJob(  # a name server knows no time limit, and the next look may be answered
            resolvers,
            lambda: RESOLVE,
            lambda: addresses_of_all(hosts),
            self._resolved,
            lambda: bool(hosts),
            overlapping=True,
        )

    def start(self) -> None:
        """Open the sockets, if there is a network already, and hear from the kernel when it changes."""
        self._open(monotonic())
        try:
            changes = Changes()
        except OSError as problem:
            program.LOG.warning(
                "the kernel does not tell of changes of the network, so they are seen later: %s", problem
            )
            return
        self.hears_of_changes = True
        self._loop.watch(changes.socket, partial(self._network_changed, changes))

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
            self._callbacks.moved()
        if place != self.place:
            self.place = place
            self._close(monotonic())

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
            self.sent += 1
        except BlockingIOError:
            pass
        except OSError as problem:
            if self.place.interface and not self.place.running:
                return  # a link that is down: everybody is told again when it is back
            text = f"nothing can be sent to {host or self._group}: {problem}"
            self._limited.say("error", "send" if host is None else "send to a host", text)
            if host is None or action.host in self._values["robot_hosts"]:  # others may be anybody's invention
                self._errors[f"send {host}"] = text
            if host is None:
                self._close(monotonic() + REOPEN)
        else:
            self._errors.pop(f"send {host}", None)

    def _open(self, now: float) -> None:
        multicast = self._values["send_mcast"] or self._values["listen_mcast"]
        before = self.own_addresses
        try:
            self._pinned = ""
            self.own_addresses, self.place = self._addresses()
            if self._interface:
                self._pinned = resolve(self._interface)
                self.own_addresses, self.place = self._addresses()
            self._udp = Udp(self._group, self._port, self._pinned, multicast and self._values["listen_mcast"])
        except OSError as problem:
            self._open_due = now + REOPEN
            text = f"discovery cannot use {self._group} port {self._port} on {self._interface or 'any interface'}: {problem}"
            if text != self.problem:  # a robot may be without a network for days
                self.problem = text
                program.LOG.warning("%s; waiting for it", text)
            if self.own_addresses != before:
                self._callbacks.moved()
            return
        self.problem = ""
        for opened in self._udp.sockets:
            self._loop.watch(opened, partial(self._receive, opened))
        self._limited.say(
            "info",
            "opened",
            f"discovery by {self._group if multicast else 'unicast'} on {self.place.address}, port {self._port}",
        )
        self._callbacks.opened(now)

    def _network_changed(self, changes: Changes) -> None:
        changes.clear()
        self._callbacks.changed()

    def _close(self, open_due: float) -> None:
        """Have new sockets from then on, since the network has changed."""
        self._open_due = open_due
        if self._udp is not None:
            for opened in self._udp.sockets:
                self._loop.forget(opened)
            self._udp.close()
            self._udp = None

    def _receive(self, readable: Socket) -> None:
        if self._udp is not None:
            now = monotonic()
            for datagram in self._udp.receive(readable):
                self.received += 1
                self._callbacks.received(datagram, now)

    def _addresses(self) -> Tuple[Set[str], Place]:
        """The own addresses, and the place in the network."""
        found = network()
        heard = self._pinned or source_address(self._group, self._port, set(found.interfaces))
        interface = found.interfaces.get(heard, 0)
        return {*found.own, "localhost"}, Place(heard, interface, interface in found.running)

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
