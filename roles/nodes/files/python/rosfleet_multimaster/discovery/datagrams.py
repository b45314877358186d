# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The life of discovery's UDP sockets. They are opened again when the network changes."""

import os
from functools import partial
from typing import Any, Callable, Dict, Mapping, NamedTuple, Optional, Set, Tuple

from ..edge.addresses import AddressChanges, addresses_of_all, network, resolve, source_address
from ..edge.clock import monotonic
from ..edge.loop import DirectRunner, Loop, RecurringJob, Workers
from ..edge.process import program
from ..protocol.tcpros.hosts import is_address
from .core.actions import Send
from .udp import Datagram, Socket, Udp

REOPEN = 0.5  # seconds between two attempts to open the sockets: a link that comes back is used at once
RESOLVE = 60.0  # seconds between two looks at the addresses of ~robot_hosts
RESOLVE_AGAIN = 5.0  # the same if one of them has no address


class NetworkPlace(NamedTuple):
    """The place of this computer in the network."""

    address: str  # the own address, from which datagrams come
    interface: int  # the index of its interface, 0 without an interface
    running: bool  # the interface is up and has a carrier


class DatagramCallbacks(NamedTuple):
    """The callbacks of the program. They run in the loop."""

    on_datagram: Callable[[Datagram, float], None]
    on_addresses: Callable[[], None]  # the own addresses changed
    on_open: Callable[[float], None]  # the sockets were opened
    on_network: Callable[[], None]  # something changed in the network


class Datagrams:
    """The datagrams of discovery. Without a network there is no socket, and the node works for its own robot."""

    def __init__(
        self,
        values: Mapping[str, Any],
        loop: Loop,
        resolvers: Workers,
        limited: program.LimitedLog,
        errors: Dict[str, str],
        callbacks: DatagramCallbacks,
    ) -> None:
        """`values`: the parameters of master_discovery. `errors` takes failures to send, for masterErrors."""
        self.own_addresses: Set[str] = set()
        self.place = NetworkPlace("", 0, False)
        self.problem = ""  # why there are no sockets; "" if there are some
        self.hears_of_changes = False  # the kernel reports changes of the network
        self.sent = self.received = 0  # datagrams
        self._values, self._loop, self._limited, self._errors = values, loop, limited, errors
        self._callbacks = callbacks
        self._group, self._port = values["mcast_group"].partition("@")[0], values["mcast_port"]
        self._interface = interface_name(values)
        self._pinned = ""
        self._udp: Optional[Udp] = None
        self._hosts: Dict[str, str] = {}  # ~robot_hosts -> address
        hosts = values["robot_hosts"]
        self._lookups = RecurringJob(  # a name server knows no time limit, and the next look may be answered
            resolvers,
            lambda: RESOLVE,
            lambda: addresses_of_all(hosts),
            self._on_addresses,
            lambda: bool(hosts),
            overlapping=True,
        )
        self._opening = RecurringJob(  # a wait for one in the loop would be ended by the watchdog
            resolvers if self._interface and not is_address(self._interface) else DirectRunner(),
            lambda: REOPEN,
            lambda: resolve(self._interface) if self._interface else "",
            self._open,
            lambda: self._udp is None,
        )

    def start(self) -> None:
        """Open the sockets, if there is a network already. Watch the network for changes."""
        self.look_at_addresses()  # to open them may take a while
        self._opening.tick(monotonic())
        try:
            changes = AddressChanges()
        except OSError as problem:
            program.LOG.warning(
                "the kernel does not report changes of the network, so they are seen later: %s", problem
            )
            return

        def on_change() -> None:
            changes.clear()
            self._callbacks.on_network()

        self.hears_of_changes = True
        self._loop.watch(changes.socket, on_change)

    def tick(self, now: float) -> Optional[float]:
        """Do all that is due; the time of the next call, None for any."""
        due = [self._lookups.tick(now), self._opening.tick(now)]
        return min((time for time in due if time is not None), default=None)

    def look_at_addresses(self) -> None:
        """See whether the own addresses changed. No other master is at one, and sockets belong to one."""
        try:
            own, place = self._addresses()
        except OSError:  # the kernel is busy: in a second again
            return
        if own != self.own_addresses:
            self.own_addresses = own
            self._callbacks.on_addresses()
        if place != self.place:
            self.place = place
            self._close(monotonic())

    def send(self, action: Send) -> None:
        """Carry out a Send of the core. If the network has gone, the sockets are opened again."""
        host = action.host
        if host is not None:
            host = host if is_address(host) else self._hosts.get(host)
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
                return  # the link is down: the core sends again when it is up
            text = f"nothing can be sent to {host or self._group}: {problem}"
            self._limited.say("error", "send" if host is None else "send to a host", text)
            if host is None or action.host in self._values["robot_hosts"]:  # a stranger may invent other hosts
                self._errors[f"send {host}"] = text
            if host is None:
                self._close(monotonic() + REOPEN)
        else:
            self._errors.pop(f"send {host}", None)

    def _open(self, pinned: Optional[str], failure: Optional[Exception]) -> None:
        """Open the sockets, on the address of the interface if one is chosen."""
        multicast = self._values["send_mcast"] or self._values["listen_mcast"]
        before = self.own_addresses
        try:
            self._pinned = pinned or ""
            self.own_addresses, self.place = self._addresses()
            if failure is not None:
                raise failure
            self._udp = Udp(self._group, self._port, self._pinned, multicast and self._values["listen_mcast"])
        except (OSError, UnicodeError) as problem:
            text = f"discovery cannot use {self._group} port {self._port} on {self._interface or 'any interface'}: {problem}"
            if text != self.problem:  # a robot may be without a network for days
                self.problem = text
                program.LOG.warning("%s; waiting for it", text)
            if self.own_addresses != before:
                self._callbacks.on_addresses()
            return
        self.problem = ""
        for opened in self._udp.sockets:
            self._loop.watch(opened, partial(self._receive, opened))
        self._limited.say(
            "info",
            "opened",
            f"discovery by {self._group if multicast else 'unicast'} on {self.place.address}, port {self._port}",
        )
        self._callbacks.on_open(monotonic())

    def _close(self, open_due: float) -> None:
        """Close the sockets, since the network has changed. They are opened again when that is due."""
        self._opening.due = open_due
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
                self._callbacks.on_datagram(datagram, now)

    def _addresses(self) -> Tuple[Set[str], NetworkPlace]:
        """The own addresses, and the place in the network."""
        local = network()
        source = self._pinned or source_address(self._group, self._port, set(local.interfaces))
        interface = local.interfaces.get(source, 0)
        return {*local.own, "localhost"}, NetworkPlace(source, interface, interface in local.running)

    def _on_addresses(self, addresses: Optional[Mapping[str, str]], _problem: Optional[Exception]) -> None:
        for host in self._values["robot_hosts"]:
            if addresses is not None and host in addresses:
                self._hosts[host] = addresses[host]
            elif host not in self._hosts:
                self._limited.say(
                    "warning", f"host {host}", f"~robot_hosts names {host}, which has no address on this computer"
                )
                self._lookups.due = min(self._lookups.due, monotonic() + RESOLVE_AGAIN)


def interface_name(values: Mapping[str, Any]) -> str:
    """The interface of discovery, in upstream's order: parameters, ROS_HOSTNAME, ROS_IP; "" if they choose no interface."""
    interface = values["mcast_group"].partition("@")[2] or values["interface"]
    if interface:
        return str(interface)
    name = os.environ.get("ROS_HOSTNAME", "")
    if name:
        try:
            if not resolve(name).startswith("127."):
                return name
        except OSError:
            program.LOG.warning("ROS_HOSTNAME is %s, which has no address on this computer", name)
    return os.environ.get("ROS_IP", "")
