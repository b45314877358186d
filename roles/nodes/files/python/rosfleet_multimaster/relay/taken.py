# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The imports of this robot: the topics and services that other relays offer, and a feed for each topic."""

from functools import partial
from typing import Any, Dict, Optional

from ..edge.process import program
from ..protocol.plain_text import quote
from .account import Accounts
from .core.channels import SERVICE, find_taken
from .dial import dial_relay
from .feed import MakeFeed, Origin, TopicFeed, ask_for
from .given import Provider
from .parties import NAME, NODE, ROBOT, Parties
from .peers import Offers


class TakenSide:
    """The offers of all other relays, and their use here."""

    def __init__(
        self,
        parties: Parties,
        accounts: Accounts,
        limited: program.LimitedLog,
        make_feed: MakeFeed,
        own: Dict[str, str],
    ) -> None:
        """`own`: the topics that this node itself publishes, with their types."""
        self._parties, self._accounts, self._limited = parties, accounts, limited
        self._make_feed, self._own = make_feed, own
        self.offers: Dict[str, Offers] = {}  # by robot
        self.providers: Dict[str, Provider] = {}  # service -> how the relay that has it is reached
        self.published = dict(own)  # topic -> its type, as it is registered at the own roscore
        self.feeds: Dict[str, TopicFeed] = {}  # topic -> for listeners of this robot

    def take(self, robot: str, offers: Optional[Offers], why: str) -> bool:
        """Take the offers of a robot; None: its relay does not answer, and why. False if nothing has changed."""
        if offers is not None:
            self.offers[robot] = offers
        else:
            self._limited.say("warning", f"peer {robot}", f"the relay of {robot} does not answer: {quote(why)}")
            if self.offers.pop(robot, None) is None:
                return False
        self._take_all()
        return True

    def _take_all(self) -> None:
        """Have a feed for each topic that others offer."""
        sources: Dict[str, Dict[Any, Origin]] = {}
        published: Dict[str, str] = {}
        self.providers = {}
        for peer, known in self.offers.items():
            channels = self._parties.list_channels(peer)
            place = (known.host, known.port)
            dial = partial(dial_relay, place)
            for (kind, local), (offer, channel) in find_taken(channels, known.entries).items():
                uri = f"http://{known.host}:{channel.port}/"
                if kind == SERVICE:
                    self.providers.setdefault(local, Provider(dial, peer, uri, offer.name))
                elif local not in self._own:  # this node publishes that itself
                    published.setdefault(local, offer.type)
                    change = None if channel.inner_frames is None else channel.inner_frames.take_off
                    for node in offer.nodes:
                        question = {**ask_for(NAME, offer.name), ROBOT: self._parties.robot, NODE: node}
                        origin = Origin(dial, uri, question, self._accounts.find(peer), change)
                        sources.setdefault(local, {})[offer.name, node, place] = origin
        self.published = {**published, **self._own}
        for topic, feed in list(self.feeds.items()):
            if topic not in published:
                # Who listens keeps its connection: a node hears nothing of a topic that is away only for a moment.
                feed.aim({})
                self.forget_idle(feed)
        for topic in published:
            if topic not in self.feeds:
                self.feeds[topic] = self._make_feed(topic, False)
            self.feeds[topic].aim(sources[topic])

    def forget_idle(self, feed: TopicFeed) -> None:
        """Forget a topic of other robots that no node publishes any more, as soon as no node listens."""
        if self.feeds.get(feed.topic) is feed and feed.topic not in self.published and not feed.has_sinks:
            del self.feeds[feed.topic]

    def count_here(self) -> int:
        """The number of topics of other robots."""
        return len(self.feeds.keys() & self.published.keys())
