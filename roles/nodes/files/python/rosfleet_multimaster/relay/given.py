# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The exports of this robot: the topics and services of its own nodes, as its roscore has them, and their feeds to other relays."""

from dataclasses import replace
from functools import partial
from typing import Dict, List, NamedTuple, Optional, Tuple

from ..edge.process import program
from ..edge.roscore import Roscore, RoscoreGraph
from ..protocol import imports
from ..protocol.messages import View
from ..protocol.plain_text import quote
from ..protocol.tcpros.hosts import host_of
from .account import Accounts
from .board import OfferBoard
from .core.channels import SERVICE, TOPIC, Own, OwnNodes, list_offers, list_own
from .core.frames import STATIC, Frames
from .core.rates import NO_RATE, Rate
from .dial import dial_node, dial_service
from .feed import Dial, MakeFeed, Origin, TopicFeed, ask_for
from .parties import NAME, Parties
from .wire import Wire

NOTHING = View({}, {}, {}, {})  # before the own roscore was read

Found = Tuple[View, imports.Claims]  # one reading


class Provider(NamedTuple):
    """The way to the provider of a service, or to the relay that has it."""

    dial: Dial
    robot: str  # whose it is
    place: str  # a URI
    name: str  # of the service there


class Reader:
    """Reads the own roscore, in a thread."""

    def __init__(self, parties: Parties, roscore: Roscore) -> None:
        self._parties, self._roscore, self._graph = parties, roscore, RoscoreGraph(roscore)
        self._last = NOTHING
        self._claims: imports.Claims = {}

    @property
    def is_told(self) -> bool:
        """True if the roscore reports its changes, so to read it costs little."""
        return self._graph.guards_names

    def read(self) -> Found:
        """Read the registrations, and the nodes that master_sync has brought."""
        view, last = self._graph.read(self._list_unknown), self._last
        same = view.publishers is last.publishers and view.services is last.services
        # a node of another robot that was started again has another URI
        if not same or (view.node_uris, view.service_uris) != (last.node_uris, last.service_uris):
            (record,) = self._roscore.ask(("getParam", imports.IMPORTS))  # an import is a registration as well
            self._claims = imports.read(record).claims
        self._last = view
        return replace(view, subscribers={}), self._claims  # who only listens changes nothing here

    def _list_unknown(self, found: View) -> Tuple[List[str], List[str]]:
        """The nodes and services whose URIs are needed, of a roscore that does not list them."""
        tables, channels = ((TOPIC, found.publishers), (SERVICE, found.services)), self._parties.channels
        wanted = [
            (kind, name, users)
            for kind, table in tables
            for name, users in table.items()
            if any(channel.find_name(kind, name) for channel in channels)
            or (kind == SERVICE and any(channel.find_local(kind, name, given=False) for channel in channels))
        ]
        nodes = {node for _kind, _name, users in wanted for node in users}
        return sorted(nodes), sorted(name for kind, name, _users in wanted if kind == SERVICE)


class GivenSide:
    """The own topics and services, the offers to the other relays, and a feed for each that one of these wants."""

    def __init__(
        self, parties: Parties, board: OfferBoard, accounts: Accounts, limited: program.LimitedLog, make_feed: MakeFeed
    ) -> None:
        self._parties, self._board, self._accounts = parties, board, accounts
        self._limited, self._make_feed = limited, make_feed
        self.seen = NOTHING
        self._claims: imports.Claims = {}  # of the same reading
        self._topics: Own = {}
        self._services: Own = {}
        self.feeds: Dict[Tuple[str, str, Optional[Frames]], TopicFeed] = {}  # by topic, node and frames

    @property
    def is_known(self) -> bool:
        """True as soon as the own roscore was read."""
        return self.seen is not NOTHING

    def take(self, found: Found) -> bool:
        """Take a reading. False if it is the last one again."""
        seen, claims = found
        ours = OwnNodes(self._parties.hosts, claims)
        topics, services = (list_own(table, seen.node_uris, NAME, ours) for table in (seen.publishers, seen.services))
        services = {name: at for name, at in services.items() if self._is_own_uri(seen.service_uris.get(name, ""))}
        last = self._topics, self._services, self.seen, self._claims
        if (topics, services, seen, claims) == last and self.is_known:
            return False
        self._topics, self._services, self.seen, self._claims = topics, services, seen, claims
        self._report_unplanned(ours)
        for robot in self._parties.peers:
            channels = self._parties.list_channels(robot)
            self._board.update(robot, list_offers(channels, topics, services, seen.types, NAME))
        for (topic, node, frames), feed in list(self.feeds.items()):
            if node in topics.get(topic, ()):
                self._aim_at_node(feed, topic, node, frames)  # one that was killed and started again is elsewhere
            elif node != NAME:
                feed.end()
                del self.feeds[topic, node, frames]
        return True

    def _is_own_uri(self, uri: str) -> bool:
        return host_of(uri) in self._parties.hosts

    def list_subscribed(self) -> Dict[str, str]:
        """Return the own topics that others listen to, with their types."""
        listening = [topic for (topic, node, _frames), feed in self.feeds.items() if feed.has_sinks and node != NAME]
        return {topic: self.seen.types.get(topic, "*") for topic in listening}

    def has_provider(self, service: str) -> bool:
        """True if something else than this node and master_sync provides it here, on whatever computer."""
        uris = self.seen.node_uris
        nodes = self.seen.services.get(service, ())
        return any(node != NAME and (node, uris.get(node, "")) not in self._claims for node in nodes)

    def _report_unplanned(self, ours: OwnNodes) -> None:
        """Log whose topics and services stay here, since their computer is in no plan."""
        hosts = self._parties.hosts
        unplanned = {
            node: uri
            for node, uri in self.seen.node_uris.items()
            if not ours.have(node, uri) and (node, uri) not in ours.claims and host_of(uri) not in hosts.foreign
        }
        for kind, table in ((TOPIC, self.seen.publishers), (SERVICE, self.seen.services)):
            for name, node in ((name, node) for name, nodes in table.items() for node in unplanned.keys() & nodes):
                if any(channel.find_name(kind, name) for channel in self._parties.channels):
                    where = f"which is no computer of {self._parties.robot} in the plan"
                    text = f"{quote(node)} is at {quote(unplanned[node])}, {where}"
                    self._limited.say("warning", f"unplanned {name}", f"{quote(name)} does not cross: {text}")

    # Other relays, which ask

    def find_feed(self, wire: Wire, robot: str, name: str, node: str) -> Tuple[Optional[TopicFeed], Rate]:
        """Return the feed that another relay wants, and its rate; None if it may not have it."""
        for channel in self._parties.list_channels_of(robot, wire.address):
            topic = channel.find_local(TOPIC, name, given=True)
            its_own = node == NAME and topic == STATIC and channel.has_root
            if topic is not None and (its_own or node in self._topics.get(topic, ())):
                frames = channel.inner_frames
                feed = self.feeds.get((topic, node, frames))
                if feed is None:
                    feed = self.feeds[topic, node, frames] = self._make_feed(topic, True)
                    if its_own and frames is not None:
                        feed.publish(*frames.make_root())
                if not its_own:
                    self._aim_at_node(feed, topic, node, frames)
                wire.limit_silence()
                if channel.newest:
                    wire.keep_newest()
                return feed, channel.rate
        return None, NO_RATE

    def _aim_at_node(self, feed: TopicFeed, topic: str, node: str, frames: Optional[Frames]) -> None:
        uri = self.seen.node_uris.get(node, "")
        change, own = None if frames is None else frames.add, self._accounts.find(self._parties.robot)
        dial = partial(dial_node, uri, NAME, topic, self._parties.hosts)
        feed.aim({uri: Origin(dial, uri, ask_for(NAME, topic), own, change)})

    def find_provider(self, wire: Wire, robot: str, name: str) -> Optional[Provider]:
        """Return how the provider of a service is reached that another relay wants."""
        for channel in self._parties.list_channels_of(robot, wire.address):
            service = channel.find_local(SERVICE, name, given=True)
            if service is not None and service in self._services:
                uri = self.seen.service_uris.get(service, "")
                return Provider(partial(dial_service, uri, self._parties.hosts), self._parties.robot, uri, service)
        return None
