# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The node master_border: takes topics and services across to other robots, by other names, at a rate, once for each link.

`python3 -m rosfleet_multimaster.master_border --parameters FILE.json`
"""

import contextlib
import os
from dataclasses import replace
from functools import partial
from typing import Any, Callable, Container, Dict, Iterable, List, Mapping, NamedTuple, Optional, Tuple

from .border import calls, diagnostics
from .border.account import Accounts
from .border.board import OfferBoard
from .border.core import report
from .border.core.channels import SERVICE, TOPIC, Channel, Own, OwnNodes, find_taken, list_offers, list_own
from .border.core.frames import STATIC, Frames
from .border.core.rates import NO_RATE, Rate
from .border.dial import Dialers, dial_border, dial_node, dial_service, listen
from .border.feed import Dial, Feed, Fields, Link, Origin
from .border.node import PROVIDER, PUBLISHER, SUBSCRIBER, Registrar, SlaveApi
from .border.peers import OFFERS, Offers, Peer
from .border.wire import PATIENCE, Wire
from .edge import local_roscore
from .edge.addresses import find_own_host, local_hosts
from .edge.clock import keep_fresh, monotonic
from .edge.core.shares import Shares
from .edge.display import Display
from .edge.loop import DirectRunner, Loop, RecurringJob, Workers
from .edge.process import program
from .edge.process.systemd import notify
from .edge.roscore import Roscore, RoscoreGraph
from .edge.rpc_server import LongPoll, RefusedCall, RpcServer, callers, serve
from .protocol import imports, metrics, parameters
from .protocol.filters import MAX_NAME
from .protocol.members import Members, host_of, is_address
from .protocol.messages import Diagnosis, View
from .protocol.plain_text import quote
from .protocol.tcpros.header import encode_header

NAME = "/master_border"
BEAT = 0.1  # seconds between two looks at what is due, at most
STATUS = 5.0  # seconds between two lines of status
READ, READ_WHOLE = 0.2, 1.0  # seconds between two looks at the own roscore: one that tells its changes, and any other
MOST_WIRES, MOST_NEW = 1000, 200  # connections of others, and those without a header
MOST_WIRES_OF_ONE, MOST_NEW_OF_ONE = 400, 50  # of one other robot
ACCEPTS = 16  # connections that are taken in one turn of the loop
MOST_FIRST = 1 << 15  # bytes of a call that wait for its provider: its header, and what came with it
LONGEST_WAIT = 60.0  # seconds that another border may wait for news
# Fields of a header between two borders: whose it is, and the node whose messages it wants.
ROBOT, NODE = "rosfleet_border", "rosfleet_publisher"


SLOWED = "its messages take more of the processor than its share, and wait"
NOBODY, OTHERS = "", "computers of no robot"  # who has an address that belongs to no robot, and how it is called


class OwnHosts:
    """The hosts of this robot: names and addresses of its planned computers, and this computer. `in` is asked in threads, too."""

    def __init__(self, planned: Container[str], foreign: Container[str], local: Callable[[], Container[str]]) -> None:
        """`foreign`: hosts of other robots; `local`: those of this computer."""
        self._planned, self.foreign, self._local = planned, foreign, local

    @classmethod
    def from_members(cls, members: Members, robot: str, local: Callable[[], Container[str]]) -> "OwnHosts":
        """Make the hosts of a robot."""
        planned = frozenset(host for one in members.robots if one.robot == robot for host in one.hosts)
        return cls(planned, members.hosts - planned, local)

    def __contains__(self, host: object) -> bool:
        """True for a host in its only spelling (protocol/members.py)."""
        text = str(host)
        is_here = (text.startswith("127.") and is_address(text)) or text in self._local()
        return text in self._planned or (is_here and text not in self.foreign)


NOTHING = View({}, {}, {}, {})  # before the own roscore was read


class Provider(NamedTuple):
    """How the provider of a service is reached, or the border that has it."""

    dial: Dial
    robot: str  # whose it is
    place: str  # a URI
    name: str  # of the service there


class MasterBorder:
    """The program: what the own roscore and the other borders have becomes feeds, and listeners are given to these."""

    def __init__(self, values: Mapping[str, Any], roscore: Roscore, uri: str) -> None:
        """`uri`: that the roscore calls itself."""
        self.loop, self.limited = Loop(), program.LimitedLog()
        self.own_hosts = keep_fresh(local_hosts)  # each connection asks for them
        self.robot, self.roscore = values["robot"], roscore
        self.channels = [Channel.from_entry(entry) for entry in values["channels"]]
        self.peers = {channel.peer: channel for channel in self.channels}
        self.board = OfferBoard()
        self.seen = NOTHING
        self.topics: Own = {}
        self.services: Own = {}
        self.claimed: imports.Claims = {}  # of the same reading
        self.calls: Dict[str, Provider] = {}  # service of others -> how their border is reached
        self.offers: Dict[str, Offers] = {}
        self.given: Dict[Tuple[str, str, Optional[Frames]], Feed] = {}  # topic, node and frames -> for other borders
        self.taken: Dict[str, Feed] = {}  # topic -> for listeners of this robot
        self.wires: Dict[Wire, Optional[Feed]] = {}  # of others
        self.feeds_due = self.jobs_due = self.listens_at = 0.0
        self.listener = listen()
        members = Members.from_parameters(values)
        self.robots = _map_hosts(self.channels, members)
        robots = {self.robot, NOBODY, *self.peers, *self.robots.values()}
        self.accounts = Accounts(self.loop, robots, self.robot)
        self.calling = calls.Calls(self.loop, [f"{way} {robot}" for robot in robots for way in ("of", "to")])
        self.open = Shares(MOST_WIRES, MOST_WIRES_OF_ONE, robots, self.robot)
        self.new = Shares(MOST_NEW, MOST_NEW_OF_ONE, robots, self.robot)
        self.slowed: List[str] = []  # robots whose messages cost too much
        self.hosts = OwnHosts.from_members(members, self.robot, self.own_hosts)
        self.rules = callers(members, uri, self._is_here)
        port = int(self.listener.getsockname()[1])
        self.api = SlaveApi(uri, port, partial(self.loop.post, local_roscore.obey_shutdown), self._list_links)
        self.server = serve("", values["port"], {OFFERS: LongPoll(self._tell_offers)}, self._on_malformed, self.rules)
        # A new port at each start: by its URI, nodes know that what they were connected with has ended, also where they did not see it.
        own = RpcServer("", 0, self.api.methods(), self._on_malformed, self.rules)
        self.uri = f"http://{find_own_host()}:{own.server_address[1]}/"
        self.dialers = Dialers(self.loop, self.robot, robots)
        roscore_calls = Workers(self.loop, 1)  # everything that is asked of the own roscore
        self.registrar = Registrar(roscore, self.uri, roscore_calls)
        again = self.registrar.begin_again
        self.health = local_roscore.Health(self.loop, roscore, local_roscore.Identity(), roscore_calls, again)
        self.graph = RoscoreGraph(roscore)
        self.last = NOTHING  # of the thread that reads
        self.claims: imports.Claims = {}
        self.states = RecurringJob(DirectRunner(), lambda: STATUS, self._say_status)
        self.display = Display(values, uri, NAME, self.loop, self.limited, self._entries, self._samples)
        self.diagnostics = self._make_feed(diagnostics.TOPIC)
        self.display.open(partial(diagnostics.Diagnostics, self.diagnostics))
        self.reads = RecurringJob(
            roscore_calls, lambda: READ if self.graph.guards_names else READ_WHOLE, self._read, self._on_read
        )

    def run(self) -> int:
        """Run until the end; the exit status."""
        program.on_signals(self.loop, self._end)
        self.loop.watch(self.listener, self._accept)
        for robot, channel in self.peers.items():
            peer = Peer(robot, channel.hosts, channel.port, self.robot)
            peer.start(partial(self.loop.post, self._on_offers))
        self._take_offers()
        notify("READY=1")
        self.loop.run(self._tick)
        self.registrar.withdraw()
        self.display.end()
        return 0

    def _tick(self, now: float) -> float:
        """One pass: messages come and go in it, and what is due is done, which is not asked for with each message."""
        if now >= self.jobs_due:
            if self.listens_at and now >= self.listens_at:
                self.listens_at = 0.0
                self.loop.watch(self.listener, self._accept)
            jobs = (self.health, self.reads, self.registrar, self.states, self.display)
            due = [job.tick(now) for job in jobs]
            self.jobs_due = min([now + BEAT, *(time for time in due if time is not None)])
        if now >= self.feeds_due:
            self.feeds_due = now + PATIENCE
            for feed in self._list_feeds():
                feed.tick(now)
            self.calling.tick(now)
            for wire in [wire for wire in self.wires if wire.header is None and now - wire.since > PATIENCE]:
                wire.end()
        return min(self.jobs_due, self.feeds_due)

    def _request_feeds(self, due: float) -> None:
        """Have the feeds looked at then."""
        self.feeds_due = min(self.feeds_due, due)

    def _list_passed(self) -> List[report.TopicCount]:
        return report.add_up(
            report.TopicCount(feed.topic, feed.messages, feed.size, feed.count_dropped()) for feed in self._list_feeds()
        )

    def _list_links(self) -> List[Link]:
        return [link for feed in self._list_feeds() for link in feed.list_links()]

    def _list_feeds(self) -> List[Feed]:
        return [*list(self.given.values()), *list(self.taken.values())]  # other threads ask, too

    def _entries(self) -> List[Diagnosis]:
        away = sorted(set(self.peers) - set(self.offers))
        kept_back = {feed.topic: feed.problem for feed in self._list_feeds() if feed.problem}
        kept_back.update({robot or OTHERS: SLOWED for robot in self.accounts.list_slowed()})
        return [report.make_entry(away, len(self.peers), self._list_passed(), kept_back)]

    def _samples(self) -> metrics.Samples:
        return report.make_samples(len(self.offers), self._list_passed())

    def _say_status(self) -> None:
        before, self.slowed = self.slowed, self.accounts.list_slowed()
        for robot in sorted(set(self.slowed) - set(before)):
            program.LOG.warning("%s: %s", robot or OTHERS, SLOWED)
        notify(
            f"STATUS={self._entries()[0].message}; {len(self.taken.keys() & self.api.published.keys())} topics of others are here"
        )

    def _end(self) -> None:
        program.leave_after(5.0)
        self.loop.stop()

    def _on_malformed(self, host: str, why: str) -> None:
        self.limited.say("warning", f"malformed {host}", f"a request of {host} is refused: {quote(why)}")

    # The own roscore

    def _read(self) -> Tuple[View, imports.Claims]:
        view, last = self.graph.read(self._list_unknown), self.last
        same = view.publishers is last.publishers and view.services is last.services
        # a node of another robot that was started again has another URI
        if not same or (view.node_uris, view.service_uris) != (last.node_uris, last.service_uris):
            (record,) = self.roscore.ask(("getParam", imports.IMPORTS))  # an import is a registration as well
            self.claims = imports.read(record).claims
        self.last = view
        return replace(view, subscribers={}), self.claims  # who only listens changes nothing here

    def _list_unknown(self, found: View) -> Tuple[List[str], List[str]]:
        """The nodes and services whose URIs are needed, of a roscore that does not tell them."""
        tables = ((TOPIC, found.publishers), (SERVICE, found.services))
        wanted = [
            (kind, name, users)
            for kind, table in tables
            for name, users in table.items()
            if any(channel.find_name(kind, name) for channel in self.channels)
            or (kind == SERVICE and any(channel.find_local(kind, name, given=False) for channel in self.channels))
        ]
        nodes = {node for _kind, _name, users in wanted for node in users}
        return sorted(nodes), sorted(name for kind, name, _users in wanted if kind == SERVICE)

    def _on_read(self, found: Optional[Tuple[View, imports.Claims]], problem: Optional[Exception]) -> None:
        if found is None:
            return  # its health is looked at elsewhere
        seen, claims = found
        ours = OwnNodes(self.hosts, claims)
        topics, services = (list_own(table, seen.node_uris, NAME, ours) for table in (seen.publishers, seen.services))
        services = {name: at for name, at in services.items() if host_of(seen.service_uris.get(name, "")) in self.hosts}
        last = self.topics, self.services, self.seen, self.claimed
        if (topics, services, seen, claims) == last and self.seen is not NOTHING:
            return
        self.topics, self.services, self.seen, self.claimed = topics, services, seen, claims
        self._tell_unplanned(ours)
        for robot in self.peers:
            channels = [channel for channel in self.channels if channel.peer == robot]
            self.board.update(robot, list_offers(channels, topics, services, seen.types, NAME))
        for (topic, node, frames), feed in list(self.given.items()):
            if node in topics.get(topic, ()):
                self._aim_at_node(feed, topic, node, frames)  # one that was killed and started again is elsewhere
            elif node != NAME:
                feed.end()
                del self.given[topic, node, frames]
        self._register()

    def _register(self) -> None:
        """Have registered what is published and provided here for others, and what is listened to for them."""
        listening = [topic for (topic, node, _frames), feed in self.given.items() if feed.has_sinks and node != NAME]
        self.api.subscribed = {topic: self.seen.types.get(topic, "*") for topic in listening}
        wanted = {(PUBLISHER, topic): kind for topic, kind in self.api.published.items()}
        wanted.update({(SUBSCRIBER, topic): kind for topic, kind in self.api.subscribed.items()})
        uri = f"rosrpc://{find_own_host()}:{self.api.port}"
        # A roscore keeps one provider: one of this robot is never replaced, so they have to be known.
        others = {} if self.seen is NOTHING else self.calls
        wanted.update({(PROVIDER, service): uri for service in others if not self._has_provider(service)})
        self.registrar.want(wanted)

    def _has_provider(self, service: str) -> bool:
        """True if something else than this node and master_sync provides it here, on whatever computer."""
        uris = self.seen.node_uris
        nodes = self.seen.services.get(service, ())
        return any(node != NAME and (node, uris.get(node, "")) not in self.claimed for node in nodes)

    def _tell_unplanned(self, ours: OwnNodes) -> None:
        """Log whose topics and services stay here, since their computer is in no plan."""
        unplanned = {
            node: uri
            for node, uri in self.seen.node_uris.items()
            if not ours.have(node, uri) and (node, uri) not in ours.claims and host_of(uri) not in self.hosts.foreign
        }
        for kind, table in ((TOPIC, self.seen.publishers), (SERVICE, self.seen.services)):
            for name, node in ((name, node) for name, nodes in table.items() for node in unplanned.keys() & nodes):
                if any(channel.find_name(kind, name) for channel in self.channels):
                    text = f"{quote(node)} is at {quote(unplanned[node])}, which is no computer of {self.robot} in the plan"
                    self.limited.say("warning", f"unplanned {name}", f"{quote(name)} does not cross: {text}")

    # Other borders

    def _tell_offers(self, address: str, may_wait: bool, robot: Any, revision: Any, wait: Any) -> List[Any]:
        """The offers of this border to a robot: (revision, port of the data, topics and services with their types and nodes)."""
        if not isinstance(revision, str) or not isinstance(wait, (int, float)):
            raise RefusedCall(f"{OFFERS} takes a robot, a revision (text) and a wait (seconds)")
        if not self._is_peer(robot, address):
            raise RefusedCall("no channel leads there")
        seconds = min(max(0.0, float(wait)), LONGEST_WAIT) if may_wait else 0.0  # in this order: not a number is 0
        found = self.board.wait(robot, revision, seconds)
        if found is None:
            raise RefusedCall("the own roscore has not been read yet")
        now, offers = found
        return [now, self.api.port, [[*offer[:3], list(offer.nodes)] for offer in offers]]

    def _is_here(self, address: str) -> bool:
        return address in self.own_hosts()

    def _find_robot(self, address: str) -> str:
        """Return the robot that a computer is of; empty for one of none."""
        return self.robot if self._is_here(address) else self.robots.get(address, "")

    def _is_peer(self, robot: Any, address: str) -> bool:
        return isinstance(robot, str) and robot in self.peers and address in self.peers[robot].hosts

    def _on_offers(self, robot: str, offers: Optional[Offers], why: str) -> None:
        if offers is not None:
            self.offers[robot] = offers
        else:
            self.limited.say("warning", f"peer {robot}", f"the border of {robot} does not answer: {quote(why)}")
            if self.offers.pop(robot, None) is None:
                return
        self._take_offers()

    def _take_offers(self) -> None:
        """Have a feed for each topic that others offer."""
        own = {diagnostics.TOPIC: diagnostics.TYPE} if self.display.diagnoses else {}
        sources: Dict[str, Dict[Any, Origin]] = {}
        published: Dict[str, str] = {}
        self.calls = {}
        for peer, known in self.offers.items():
            channels = [channel for channel in self.channels if channel.peer == peer]
            place = (known.host, known.port)
            dial = partial(dial_border, place)
            for (kind, local), (offer, channel) in find_taken(channels, known.entries).items():
                uri = f"http://{known.host}:{channel.port}/"
                if kind == SERVICE:
                    self.calls.setdefault(local, Provider(dial, peer, uri, offer.name))
                elif local not in own:  # this node publishes that itself
                    published.setdefault(local, offer.type)
                    change = None if channel.inner_frames is None else channel.inner_frames.take_off
                    for node in offer.nodes:
                        question = {**self._ask(offer.name), ROBOT: self.robot, NODE: node}
                        origin = Origin(dial, uri, question, self.accounts.find(peer), change)
                        sources.setdefault(local, {})[offer.name, node, place] = origin
        self.api.published = {**published, **own}
        for topic, feed in list(self.taken.items()):
            if topic not in published:
                # Who listens keeps its connection: a node hears nothing of a topic that is away only for a moment.
                feed.aim({})
                self._forget_idle(topic, feed)
        for topic in published:
            if topic not in self.taken:
                self.taken[topic] = self._make_feed(topic)
            self.taken[topic].aim(sources[topic])
        self._register()

    def _ask(self, topic: str) -> Fields:
        return {"callerid": NAME, "topic": topic, "type": "*", "md5sum": "*", "tcp_nodelay": "1"}

    def _make_feed(self, topic: str, of_one: bool = False) -> Feed:
        return Feed(self.loop, self.dialers, self.limited, self.accounts.budget, topic, self._request_feeds, of_one)

    # Those who listen

    def _accept(self) -> None:
        """Take some of those who wait: many of one robot are before another's in the kernel's queue."""
        for _number in range(ACCEPTS):
            if not self._accept_one():
                return

    def _accept_one(self) -> bool:
        """Take a connection; False where none waits."""
        try:
            connection, (address, _port) = self.listener.accept()
        except BlockingIOError:
            return False
        except OSError as problem:  # no more files: the connection stays, and would wake the loop all the time
            self.limited.say("warning", "accept", f"no connection can be taken: {problem.strerror}")
            self.loop.forget(self.listener)
            self.listens_at = monotonic() + BEAT
            return False
        robot = self._find_robot(address)
        objection = self.rules.objection(address, connection.getsockname()[0])
        if not objection and not (self.open.have_room(robot) and self.new.have_room(robot)):
            objection = "too many connections of its robot at once"
        if objection:
            connection.close()
            self._on_malformed(address, objection)
            return True
        try:
            wire = Wire(self.loop, connection, self.accounts.find(robot), self._greet, None, self._on_gone)
        except OSError:
            connection.close()
            return True
        self.wires[wire] = None
        self.open.add(robot)
        self.new.add(robot)
        self._request_feeds(monotonic() + PATIENCE)
        return True

    def _greet(self, wire: Wire) -> None:
        """Give a listener to its feed, and a client to its service."""
        header = wire.header or {}
        self.new.remove(wire.robot)
        if "service" in header:
            self._pass_call(wire, header)
            return
        topic, robot = header.get("topic", ""), header.get(ROBOT)
        feed: Optional[Feed]
        rate = NO_RATE
        if robot is None and self.display.diagnoses and topic == diagnostics.TOPIC:
            feed = self.diagnostics
        elif robot is None:
            feed = None if wire.address in self.hosts.foreign else self.taken.get(topic)
        else:
            feed, rate = self._find_given(wire, robot, topic, header.get(NODE, ""))
        if feed is None:
            _refuse(wire, f"{quote(topic)} is not published here")
            return
        self.wires[wire] = feed
        wire.header = {name: header[name][:MAX_NAME] for name in ("callerid", "md5sum") if name in header}
        feed.add(wire, {"callerid": NAME, "topic": topic}, rate)
        self._register()

    def _find_given(self, wire: Wire, robot: str, name: str, node: str) -> Tuple[Optional[Feed], Rate]:
        """Return what another border wants, and its rate; None where it may not have it."""
        for channel in self._list_channels(robot, wire.address):
            topic = channel.find_local(TOPIC, name, given=True)
            its_own = node == NAME and topic == STATIC and channel.has_root
            if topic is not None and (its_own or node in self.topics.get(topic, ())):
                frames = channel.inner_frames
                feed = self.given.get((topic, node, frames))
                if feed is None:
                    feed = self.given[topic, node, frames] = self._make_feed(topic, of_one=True)
                    if its_own and frames is not None:
                        feed.tell(*frames.make_root())
                if not its_own:
                    self._aim_at_node(feed, topic, node, frames)
                wire.limit_silence()
                if channel.newest:
                    wire.keep_newest()
                return feed, channel.rate
        return None, NO_RATE

    def _aim_at_node(self, feed: Feed, topic: str, node: str, frames: Optional[Frames]) -> None:
        uri = self.seen.node_uris.get(node, "")
        change, own = None if frames is None else frames.add, self.accounts.find(self.robot)
        dial = partial(dial_node, uri, NAME, topic, self.hosts)
        feed.aim({uri: Origin(dial, uri, self._ask(topic), own, change)})

    def _list_channels(self, robot: str, address: str) -> List[Channel]:
        """List the channels to a robot, if it is its border that asks."""
        return [channel for channel in self.channels if channel.peer == robot] if self._is_peer(robot, address) else []

    def _pass_call(self, wire: Wire, header: Fields) -> None:
        """Connect a client with the provider of its service, or with the border that has it."""
        service, robot = header["service"], header.get(ROBOT)
        own = None if wire.address in self.hosts.foreign else self.calls.get(service)  # each robot has its own border
        found = own if robot is None else self._find_provider(wire, robot, service)
        if found is None:
            _refuse(wire, f"{quote(service)} is not provided here")
            return
        fields = {**header, "callerid": NAME, "service": found.name}
        fields.pop(ROBOT, None)
        first = encode_header({**fields, ROBOT: self.robot} if robot is None else fields) + wire.rest
        account, party = self.accounts.find(found.robot), f"to {found.robot}"
        if wire.robot != self.robot:
            account, party = wire.account, f"of {wire.robot}"
        call = self.calling.begin(account, party, wire.connection, first) if len(first) <= MOST_FIRST else None
        if call is None:
            _refuse(wire, "too many calls at once, or too long a header")
            return
        self._forget(wire)
        wire.detach()
        self.dialers.submit(found.robot, found.place, found.dial, partial(self._on_dialed, call, service))

    def _find_provider(self, wire: Wire, robot: str, name: str) -> Optional[Provider]:
        """Return how the provider of a service is reached that another border wants."""
        for channel in self._list_channels(robot, wire.address):
            service = channel.find_local(SERVICE, name, given=True)
            if service is not None and service in self.services:
                uri = self.seen.service_uris.get(service, "")
                return Provider(partial(dial_service, uri, self.hosts), self.robot, uri, service)
        return None

    def _on_dialed(self, call: calls.Call, service: str, provider: Any, problem: Optional[Exception]) -> None:
        if provider is not None:
            call.start(provider)
            return
        text = f"{quote(service)} cannot be reached: {quote(problem)}"
        self.limited.say("warning", f"service {call.party}", text)
        with contextlib.suppress(OSError):
            call.client.send(encode_header({"error": text}))
        call.end()

    def _on_gone(self, wire: Wire, why: str) -> None:
        if wire.header is None:
            self.new.remove(wire.robot)
        feed = self._forget(wire)
        if feed is not None:
            feed.remove(wire)
            self._forget_idle(feed.topic, feed)
            self._register()

    def _forget_idle(self, topic: str, feed: Feed) -> None:
        """Forget a topic of others that nobody publishes any more, as soon as nobody listens."""
        if self.taken.get(topic) is feed and topic not in self.api.published and not feed.has_sinks:
            del self.taken[topic]

    def _forget(self, wire: Wire) -> Optional[Feed]:
        """Count a connection no more. Return the feed that it listens to."""
        self.open.remove(wire.robot)
        return self.wires.pop(wire, None)


def _map_hosts(channels: Iterable[Channel], members: Members) -> Dict[str, str]:
    """Return the robot of each host."""
    robots = {host: channel.peer for channel in channels for host in channel.hosts}
    return {**robots, **{host: one.robot for one in members.robots for host in one.hosts}}


def _refuse(wire: Wire, why: str) -> None:
    wire.say(encode_header({"error": why}))
    wire.end()


def main() -> int:
    """Start the node."""
    read = program.read_parameters(__doc__.partition("\n")[0], parameters.BORDER)
    if read is None or read[0]["port"] is None:
        raise program.Fatal("--parameters is needed, with a port and channels")
    env_uri = os.environ["ROS_MASTER_URI"]
    uri = local_roscore.wait_for_roscore(env_uri)
    roscore = Roscore(env_uri, NAME)
    local_roscore.refuse_second(roscore, NAME)
    values = program.settle_parameters(roscore, NAME, read, parameters.BORDER)
    return MasterBorder(values, roscore, uri).run()


if __name__ == "__main__":
    program.run(main)
