# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The node master_discovery: who else is there, and what is the state of the own roscore.

`python3 -m rosfleet_multimaster.master_discovery [--parameters FILE.json] [name:=value ...]`
"""

import getpass
import ipaddress
import json
import logging
import os
import socket
import threading
import urllib.parse
import xmlrpc.client
from typing import Any, Dict, List, Mapping, Optional, Set, Tuple

from . import program
from .core import parameters
from .core.discovery import (
    CONTACT_LIMIT,
    MAX_ASKED,
    Ask,
    Contact,
    Discovery,
    Event,
    Key,
    Master,
    Say,
    Send,
    Settings,
    misnamed,
)
from .core.filters import InvalidPattern, Pattern, Rules
from .core.graph import Graph, Policy, State, build, document, graph_of, own_types, stamp_text, stamped
from .edge import ros
from .edge.addresses import addresses, resolve
from .edge.clock import monotonic, wall_clock
from .edge.loop import Loop, Workers
from .edge.roscore import Roscore
from .edge.rpc_client import Rpc
from .edge.rpc_server import PerCaller, Refused, RpcServer
from .edge.systemd import notify
from .edge.udp import Udp

CONTACT_SIZE = 1 << 16  # bytes of an answer that says who somebody is
RETRY = 0.1  # seconds until a roscore that does not answer is asked again
REOPEN = 0.5  # seconds between two attempts to open the sockets: a link that comes back is used at once
RESOLVE = 60.0  # seconds between two looks at the addresses of ~robot_hosts
LOOKUPS, REST = 100, 4  # known nodes (and services) looked up again, in every fourth poll
POSTPONE = 5.0  # seconds that a state waits for get_sync_info of another implementation of master_sync,
GIVE_UP = 60.0  # and after that it is asked again only now and then
SHARE, SLOWEST = 10, 5.0  # a poll takes at most one part in so many of the time, but there is one every so many seconds


class Poller:
    """Reads the state of the roscore, in a thread of its own."""

    def __init__(self, roscore: Roscore, uri: str, name: str, identity: program.Identity) -> None:
        self._roscore, self._uri, self._name, self._identity = roscore, uri, name, identity
        self._graph: Optional[Graph] = None
        self._node_uris: Dict[str, str] = {}
        self._service_uris: Dict[str, str] = {}
        self._origins: Dict[Tuple[str, str], str] = {}
        self._record: Dict[str, Any] = {}
        self._state: Optional[State] = None
        self._count = 0
        self._silent: Dict[Tuple[str, str], float] = {}  # providers of get_sync_info that do not answer, since when
        self.do_not_sync: Any = None

    def poll(self) -> State:
        """The state now. Raises OSError and the like where the roscore does not answer, program.Fatal where it is another."""
        service = self._identity.service
        pid, own, types, system = self._roscore.ask(*self._identity.calls(), ("getTopicTypes",), ("getSystemState",))
        self._identity.check(service, pid, own)
        if types is None or system is None:
            raise OSError(f"{self._roscore.rpc.uri} does not tell its state")
        graph = graph_of(system, types)
        changed = graph != self._graph
        self._look_up(graph, changed)
        if changed and self._foreign(graph):
            if self._state is None:
                raise OSError("it is not known yet what is from other masters")
            return self._state
        self._graph = graph
        nodes = set(self._node_uris.items())
        self._origins = {key: origin for key, origin in self._origins.items() if key in nodes}
        state = build(self._uri, self._name, graph, self._node_uris, self._service_uris, self._origins)
        self._state = stamped(state, self._state, wall_clock())
        return self._state

    def _look_up(self, graph: Graph, changed: bool) -> None:
        """Learn the URIs of what is new, and some of the others again: a node may come back under its old name."""
        nodes = _some(graph.nodes(), self._node_uris, self._count)
        services = _some(graph.services, self._service_uris, self._count)
        self._count += 1
        asked = [("lookupNode", node) for node in nodes] + [("lookupService", service) for service in services]
        record = (
            [("getParam", program.IMPORTS), ("getParam", "/do_not_sync")] if changed or self._count % 10 == 0 else []
        )
        answers = self._roscore.ask(*asked, *record)
        moved = _learn(self._node_uris, nodes, answers) | _learn(self._service_uris, services, answers[len(nodes) :])
        if record:
            text, self.do_not_sync = answers[-2:]
        elif moved:
            (text,) = self._roscore.ask(("getParam", program.IMPORTS))
        if record or moved:
            self._record = _record(text)
            for master, imports in self._record.get("imports", {}).items():
                self._origins.update(dict.fromkeys(imports.items(), master))

    def _foreign(self, graph: Graph) -> bool:
        """Ask other implementations of master_sync what they registered. True while one should answer, but does not yet."""
        ours = self._record.get("node")
        if self._node_uris.get(ours or "", "") != self._record.get("uri"):
            ours = None
        unsure = False
        for service, users in graph.services.items():
            provider = (users[0], self._node_uris.get(users[0], ""))
            if not service.endswith(ros.GET_SYNC_INFO) or users[0] == ours or provider in self._origins:
                continue
            silent = monotonic() - self._silent.setdefault(provider, monotonic())
            if POSTPONE < silent < GIVE_UP:
                continue
            try:
                found: Optional[Dict[Tuple[str, str], str]] = ros.sync_info(service)
            except Exception as problem:  # rospy raises many
                logging.getLogger("rosfleet").debug("%s: %s", service, problem)
                found = None
            if found is not None:
                self._origins.update({key: master for key, master in found.items() if master != self._uri})
            unsure = unsure or (found is None and silent <= POSTPONE)
            if found is not None or silent >= GIVE_UP:
                del self._silent[provider]
        return unsure


def _some(names: Any, known: Dict[str, str], count: int) -> List[str]:
    """The names that are not known, and in turn some that are; forgets what is not there any more."""
    for name in known.keys() - set(names):
        del known[name]
    new, ordered = sorted(set(names) - known.keys()), sorted(known)
    if count % REST:
        return new
    at = count // REST * LOOKUPS % max(len(ordered), 1)
    return new + ordered[at : at + LOOKUPS]


def _learn(table: Dict[str, str], names: List[str], uris: List[Any]) -> bool:
    changed = False
    for name, uri in zip(names, uris):
        if isinstance(uri, str) and table.get(name) != uri:
            table[name], changed = uri, True
    return changed


def _record(text: Any) -> Dict[str, Any]:
    """What master_sync has written down."""
    try:
        found = json.loads(text) if isinstance(text, str) else {}
        return found if isinstance(found, dict) and isinstance(found.get("imports"), dict) else {}
    except ValueError:
        return {}


class MasterDiscovery:
    """The program."""

    def __init__(self) -> None:
        self.log = program.logger()
        self.limited = program.Limited(self.log)
        self.loop = Loop()
        self.workers = Workers(self.loop, 16)  # masters that may have gone: nothing else must keep them waiting
        self.strangers = Workers(self.loop, MAX_ASKED)
        self.resolvers = Workers(self.loop, 2)
        self.errors: Dict[str, str] = {}
        self.state: Optional[State] = None
        self.away = "its roscore has not been read yet"  # why there is no state; "" where there is one
        self.node: Optional[ros.DiscoveryNode] = None
        self.udp: Optional[Udp] = None
        self.udp_due = 0.0
        self.second = 0.0
        self.resolve_due = 0.0
        self.place = ("", 0)  # the own address that the others hear, and the index of its interface
        self.own_addresses: Set[str] = set()
        self.comparing: Set[str] = set()
        self.filtering = threading.Lock()  # patterns of others take time, of which one may have some at once
        self.hosts: Dict[str, str] = {}
        self.masters: Tuple[Master, ...] = ()
        self.told: Dict[str, Master] = {}
        self.status = ""
        self.malformed_requests = 0
        self.ended = threading.Event()

    def main(self) -> int:
        """Start, run, end."""
        given = program.arguments(__doc__ or "")
        read = program.read_parameters(given.parameters, parameters.DISCOVERY)
        env_uri = ros.master_uri()
        self.uri = program.wait_for_roscore(env_uri)
        name = ros.node_name("master_discovery")
        self.roscore = Roscore(env_uri, name)
        program.refuse_second(self.roscore, name)
        self.node_name, _node_uri = ros.start("master_discovery")
        ros.ended_by(lambda reason: self.loop.post(self._ended_by_ros, reason))
        self.values, warnings = program.settle_parameters(self.roscore, name, read, parameters.DISCOVERY)
        program.logger(self.values["log_level"])
        for warning in warnings:
            self.log.warning("%s", warning)
        self.rpc_port = self.values["rpc_port"] or (urllib.parse.urlsplit(env_uri).port or 11311) + 300
        self.master_name = self.values["name"] or ros.master_name(self.uri)
        self.interface_name = self._interface_name()
        self.identity = program.Identity()
        self.roscore.ask(("setParam", "/mastername", self.master_name))
        self.policy = Policy.of(self.values)
        self._open_until_it_works()
        self.core = Discovery(self._settings(), self.own_addresses, self.rpc_port)
        self.server = self._serve()
        self.poller = Poller(Roscore(env_uri, name), self.uri, self.master_name, self.identity)
        program.on_signals(self.loop, self._end)
        threading.Thread(target=self._poll, name="poll", daemon=True).start()
        self.loop.run(self._tick)
        return self._finish()

    def _settings(self) -> Settings:
        names = Settings.__dataclass_fields__
        return Settings(**{name: value for name, value in self.values.items() if name in names})

    # The loop

    def _tick(self, now: float) -> float:
        if now >= self.udp_due and self.udp is None:
            self._open(now)
        if now >= self.resolve_due and self.values["robot_hosts"]:
            self.resolve_due = now + RESOLVE
            self.resolvers.submit(lambda: _resolve_all(self.values["robot_hosts"]), self._resolved)
        self.core.tick(now)
        self._carry_out()
        if now >= self.second:
            self.second = now + 1.0
            self._look_at_addresses()
            if self.node is not None:
                self.node.links(self.master_name, self.core.links(now), wall_clock())
        due = [self.core.next_tick(), self.second]
        return min(due if self.udp is not None else [*due, self.udp_due])

    def _carry_out(self) -> None:
        events = False
        while self.core.actions:
            action = self.core.actions.popleft()
            if isinstance(action, Send):
                self._send(action)
            elif isinstance(action, Ask):
                (self.strangers if action.stranger else self.workers).submit(
                    lambda action=action: _contact(action.monitor_uri, action.limit),
                    lambda contact, problem, key=action.key: self._contacted(key, contact, problem),
                )
            elif isinstance(action, Event):
                events = True
                self._event(action)
            elif isinstance(action, Say):
                self.limited.say(action.level, action.topic, action.text)
        if events:
            self.masters = tuple(self.core.masters())

    def _event(self, event: Event) -> None:
        master, before = event.master, self.told.get(event.master.uri)
        self.told[master.uri] = master
        if event.change == "removed":
            del self.told[master.uri]
            self.errors.pop(master.uri, None)
        if event.change == "new":
            self.log.info(
                "%s is there: its master is %s, its discovery answers at %s",
                master.name,
                master.uri,
                master.monitor_uri,
            )
        elif event.change == "removed":
            self.log.info("%s is gone", master.name)
        elif before is not None and before.online != master.online:
            self.log.info("%s is %s", master.name, "online again" if master.online else "offline")
        if self.node is not None:
            self.node.changed(event.change, master)
        self.loop.post(self._say_status)

    def _say_status(self) -> None:
        online = [master.name for master in self.masters if master.online]
        offline = [master.name for master in self.masters if not master.online]
        text = f"{len(online)} master{'s' if len(online) != 1 else ''}: {', '.join(online)}" if online else "no master"
        text += f"; offline: {', '.join(offline)}" if offline else ""
        if text != self.status:
            self.status = text
            notify(f"STATUS={text}")

    # Other masters

    def _contacted(self, key: Key, contact: Optional[Contact], problem: Optional[Exception]) -> None:
        if contact is not None and contact.uri == self.uri:  # perhaps this node itself, at a new address
            self._look_at_addresses()
        gone = isinstance(problem, (ConnectionRefusedError, xmlrpc.client.Fault))
        self.core.contacted(key, contact, str(problem or ""), monotonic(), gone=gone)
        self._carry_out()
        if contact is not None and contact.host not in self.comparing:
            self.comparing.add(contact.host)
            heard, _port, rpc_port = key
            self.resolvers.submit(
                lambda: _who_has(contact.host, heard, rpc_port),
                lambda found, _problem: self._compare(contact, heard, *(found or ("", None))),
            )

    def _compare(self, contact: Contact, heard: str, address: str, there: Optional[Contact]) -> None:
        """Nodes of a master whose host is not where its name leads cannot be reached either."""
        self.comparing.discard(contact.host)
        problem = misnamed(contact, heard, address, there)
        if problem and contact.uri in self.told:  # what is said of others, or of one that has gone, would stay for ever
            self.errors[contact.uri] = problem
            self.limited.say("warning", f"resolve {contact.host}", problem)
        else:
            self.errors.pop(contact.uri, None)

    # UDP

    def _interface_name(self) -> str:
        """What discovery is pinned to, in upstream's order."""
        pinned = self.values["mcast_group"].partition("@")[2] or self.values["interface"]
        if pinned:
            return str(pinned)
        name = os.environ.get("ROS_HOSTNAME", "")
        if name:
            try:
                if not resolve(name).startswith("127."):
                    return name
            except OSError:
                self.log.warning("ROS_HOSTNAME is %s, which has no address on this computer", name)
        return os.environ.get("ROS_IP", "")

    def _open_until_it_works(self) -> None:
        self._open(monotonic())
        wake = threading.Event()
        while self.udp is None:
            notify(f"STATUS={self.status_udp}\nEXTEND_TIMEOUT_USEC=30000000")
            wake.wait(REOPEN)
            self._open(monotonic())

    def _open(self, now: float) -> None:
        group, port = self.values["mcast_group"].partition("@")[0], self.values["mcast_port"]
        multicast = self.values["send_mcast"] or self.values["listen_mcast"]
        try:
            self.pinned = resolve(self.interface_name) if self.interface_name else ""
            self.own_addresses, self.place = self._addresses()
            self.udp = Udp(group, port, self.pinned, multicast and self.values["listen_mcast"])
        except OSError as problem:
            self.udp_due = now + REOPEN
            self.status_udp = (
                f"discovery cannot use {group} port {port} on {self.interface_name or 'any interface'}: {problem}"
            )
            self.limited.say("error", "open", self.status_udp)
            return
        for opened in self.udp.sockets:
            self.loop.watch(opened, lambda opened=opened: self._receive(opened))
        self.limited.say(
            "info", "opened", f"discovery by {group if multicast else 'unicast'} on {self.place[0]}, port {port}"
        )
        if hasattr(self, "core"):
            self.core.own_moved(self.own_addresses)
            self.core.greet(now)
            self._show_own(now)

    def _addresses(self) -> Tuple[Set[str], Tuple[str, int]]:
        """The own addresses, and the one that the others hear, with its interface."""
        found = dict(addresses())
        own = {*found, "localhost"}
        heard = self.pinned or _source(self.values["mcast_group"].partition("@")[0], self.values["mcast_port"], own)
        return own, (heard, found.get(heard, 0))

    def _look_at_addresses(self) -> None:
        """They may change while this runs: nobody at an own one is another master, and sockets belong to one."""
        try:
            own, place = self._addresses()
        except OSError:  # the kernel is busy: in a second again
            return
        if own != self.own_addresses:
            self.own_addresses = own
            self.core.own_moved(own)
            self._carry_out()
        if place != self.place:
            self._reopen()

    def _receive(self, readable: socket.socket) -> None:
        if self.udp is not None:
            now = monotonic()
            for datagram in self.udp.receive(readable):
                self.core.datagram(datagram.data, datagram.source, datagram.multicast, now)
            self._carry_out()

    def _send(self, action: Send) -> None:
        host = action.host
        if host is not None:
            try:
                host = str(ipaddress.IPv4Address(host))
            except ValueError:
                host = self.hosts.get(host)
            if host is None or host in self.own_addresses:
                return
        if self.udp is None:
            return
        try:
            self.udp.send(action.datagram, host)
        except BlockingIOError:
            pass
        except OSError as problem:
            text = f"nothing can be sent to {host or self.udp.group}: {problem}"
            self.limited.say("error", "send" if host is None else "send to a host", text)
            if host is None or action.host in self.values["robot_hosts"]:  # others may be anybody's invention
                self.errors[f"send {host}"] = text
            if host is None:
                self._reopen()
        else:
            self.errors.pop(f"send {host}", None)

    def _reopen(self) -> None:
        """The network has changed: new sockets, in a moment."""
        if self.udp is not None:
            for opened in self.udp.sockets:
                self.loop.forget(opened)
            self.udp.close()
            self.udp, self.udp_due = None, monotonic() + REOPEN

    def _resolved(self, found: Optional[Mapping[str, str]], problem: Optional[Exception]) -> None:
        for host in self.values["robot_hosts"]:
            if found is not None and host in found:
                self.hosts[host] = found[host]
            elif host not in self.hosts:
                self.limited.say(
                    "warning", f"host {host}", f"~robot_hosts names {host}, which has no address on this computer"
                )
                self.resolve_due = min(self.resolve_due, monotonic() + 5.0)

    # The roscore

    def _poll(self) -> None:
        """The thread of the poller."""
        period, failing = 1.0 / self.values["rosmaster_hz"], None
        while not self.ended.is_set():
            started = monotonic()
            try:
                state = self.poller.poll()
                self.loop.post(self._polled, state)
                failing = None
            except program.Fatal as problem:
                self.loop.post(self._give_up, str(problem))
                return
            except Exception as problem:  # a roscore that does not answer, or answers nonsense
                if not isinstance(problem, program.FAILURES):
                    self.log.debug("the roscore's state cannot be read", exc_info=True)
                failing = started if failing is None else failing
                self.loop.post(self._no_roscore, str(problem) or type(problem).__name__, failing)
            took = monotonic() - started
            self.ended.wait(RETRY if failing is not None else max(period, min(took * SHARE, SLOWEST)) - took)

    def _polled(self, state: State) -> None:
        if self.away and self.state is not None:
            self.log.info("the roscore answers again")
        self.state, self.away = state, ""
        self._show_own(monotonic())
        if self.node is None:
            self.node = ros.DiscoveryNode(lambda: self.masters, lambda: self.loop.post(self._refresh))
            self.identity.service = self.node.service_uri()
            notify("READY=1")
            self.loop.post(self._say_status)

    def _show_own(self, now: float) -> None:
        if self.state is not None and not self.away:
            monitor = f"http://{self.place[0]}:{self.rpc_port}"
            own = Master(
                self.master_name, self.uri, self.state.stamp, self.state.local_stamp, True, self.node_name, monitor
            )
            self.core.own_state(own, now)
            self._carry_out()

    def _no_roscore(self, problem: str, since: float) -> None:
        """Nothing of a dead roscore is announced or served; but one that fails once is not dead."""
        if self.core.own_failed(since, monotonic()):
            if not self.away:
                self.log.error("the roscore at %s does not answer: %s", self.roscore.rpc.uri, problem)
                notify(f"STATUS=the roscore at {self.roscore.rpc.uri} does not answer")
                self.status = ""
            self.away = f"its roscore does not answer: {problem}"
        self._carry_out()

    def _refresh(self) -> None:
        self.core.refresh(monotonic())
        self._carry_out()

    # XML-RPC

    def _serve(self) -> RpcServer:
        methods = {
            "masterContacts": self._master_contacts,
            "masterInfo": PerCaller(self._master_info),
            "masterInfoFiltered": PerCaller(self._master_info_filtered),
            "masterErrors": lambda: [self.uri, list(self.errors.values())],
            "getCurrentTime": lambda: [self.uri, wall_clock()],
            "getTopicsMd5sum": PerCaller(self._md5sums),
            "getUser": lambda: [self.uri, _user()],
        }
        wake, said = threading.Event(), False
        while True:
            try:
                return RpcServer(self.values["rpc_addr"], self.rpc_port, methods, self._malformed)
            except OSError as problem:
                if not said:
                    self.log.error("port %d for other masters is not free: %s; trying again", self.rpc_port, problem)
                    said = True
                notify(f"STATUS=waiting for TCP port {self.rpc_port}: {problem}\nEXTEND_TIMEOUT_USEC=30000000")
                wake.wait(1.0)

    def _current(self) -> State:
        state = self.state
        if self.away or state is None:
            raise Refused(f"{self.master_name} has no state: {self.away}")
        return state

    def _master_contacts(self) -> List[str]:
        """Who this is: stamp, master URI, master name, node name, own URI."""
        state = self._current()
        return [
            stamp_text(state.stamp),
            self.uri,
            self.master_name,
            self.node_name,
            f"http://{ros.hostname()}:{self.rpc_port}/",
        ]

    def _view(self, caller: str) -> Tuple[State, List[Rules]]:
        """The state, and by which rules a caller is told of it."""
        if caller.startswith("127.") or caller in self.own_addresses:
            return self.policy.view(self._current(), None, [])
        try:
            secret = Rules(do_not_sync=Pattern.of(_listed(self.poller.do_not_sync), "/do_not_sync"))
        except InvalidPattern as problem:  # what is secret is not known, so everything is
            raise Refused(str(problem)) from None
        return self.policy.view(self._current(), caller, [secret])

    def _master_info(self, caller: str) -> List[Any]:
        """The state of this master, as far as the caller may see it."""
        return document(*self._view(caller))

    def _master_info_filtered(self, caller: str, filters: Any) -> List[Any]:
        """The same without what the caller does not want."""
        state, rules = self._view(caller)
        try:
            wanted = Rules.from_wire(filters)
            with self.filtering:
                return document(state, [*rules, wanted])
        except InvalidPattern as problem:
            raise Refused(f"the filter is not usable: {problem}") from None

    def _md5sums(self, caller: str, types: Any) -> List[List[str]]:
        """The md5 sums of message types of topics that this master's own nodes have, and the caller may see."""
        if not isinstance(types, list):
            raise Refused("getTopicsMd5sum takes a list of types")
        known = own_types(*self._view(caller))
        found = ((name, ros.md5sum(name)) for name in types if isinstance(name, str) and name in known)
        return [[name, md5sum] for name, md5sum in found if md5sum]

    def _malformed(self, host: str, why: str) -> None:
        def count() -> None:
            self.malformed_requests += 1
            self.limited.say("warning", "malformed request", f"a request from {host} is ignored: {why}")

        self.loop.post(count)

    # The end

    def _ended_by_ros(self, reason: str) -> None:
        if not self.ended.is_set():
            self._give_up(f"somebody ended this node: {reason}")

    def _give_up(self, reason: str) -> None:
        """End without a word to the others: the service manager starts the node again at once."""
        self.log.error("%s", reason)
        notify(f"STOPPING=1\nSTATUS={reason}")
        program.leave_process(1)

    def _end(self) -> None:
        notify("STOPPING=1\nSTATUS=leaving")
        self.loop.stop()

    def _finish(self) -> int:
        self.ended.set()
        watchdog = threading.Timer(5.0, program.leave_process, (0,))
        watchdog.daemon = True
        watchdog.start()
        self.server.stop()  # first: whoever still answers has not left
        self.core.leave()
        self._carry_out()
        self.log.info("left")
        ros.stop("the service ends")
        return 0


def _listed(value: Any) -> List[Any]:
    return value if isinstance(value, list) else [value] if value else []


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return str(os.getuid())


def _source(group: str, port: int, own: Set[str]) -> str:
    """The address from which the kernel sends to the group; else any of this computer."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((group, port))
            return str(probe.getsockname()[0])
    except OSError:
        return next(
            (address for address in sorted(own) if address[0].isdigit() and not address.startswith("127.")), "127.0.0.1"
        )


def _resolve_all(hosts: List[str]) -> Dict[str, str]:
    found = {}
    for host in hosts:
        try:
            found[host] = socket.gethostbyname(host)
        except (OSError, UnicodeError):  # one that is no host name must not hide the others
            pass
    return found


def _who_has(host: str, heard: str, rpc_port: int) -> Tuple[str, Optional[Contact]]:
    """The address of a name, and which master answers there where that is another than the one that is heard."""
    address = socket.gethostbyname(host)
    try:
        return address, None if address == heard else _contact(f"http://{address}:{rpc_port}")
    except program.FAILURES:
        return address, None


def _contact(monitor_uri: str, limit: float = CONTACT_LIMIT) -> Contact:
    return Contact.of(Rpc(monitor_uri, limit, CONTACT_SIZE).call("masterContacts"))


if __name__ == "__main__":
    program.run(MasterDiscovery().main)
