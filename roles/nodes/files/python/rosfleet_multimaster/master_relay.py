# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The node master_relay: takes topics and services across to other robots, by other names, at a rate, once for each link.

`python3 -m rosfleet_multimaster.master_relay --parameters FILE.json`
"""

import os
from functools import partial
from typing import Any, List, Mapping, Optional

from .edge import local_roscore
from .edge.addresses import find_own_host
from .edge.loop import Loop, RecurringJob, Workers
from .edge.process import program
from .edge.process.systemd import notify
from .edge.roscore import Roscore
from .edge.rpc_server import LongPoll, RefusedCall, RpcServer, callers, serve
from .protocol import parameters
from .relay import diagnostics
from .relay.account import Accounts
from .relay.board import OfferBoard
from .relay.dial import Dialers
from .relay.entrance import Entrance
from .relay.feed import BusLink, TopicFeed
from .relay.given import Found, GivenSide, Reader
from .relay.node import PROVIDER, PUBLISHER, SUBSCRIBER, Registrar, SlaveApi
from .relay.overview import Overview
from .relay.parties import NAME, Parties
from .relay.peers import OFFERS, Offers, RelayPeer
from .relay.taken import TakenSide
from .relay.wire import PATIENCE

BEAT = 0.1  # seconds between two looks at due actions, at most
READ, READ_WHOLE = 0.2, 1.0  # seconds between two looks at the own roscore: one that reports its changes, and any other
LONGEST_WAIT = 60.0  # seconds that another relay may wait for news


class MasterRelay:
    """The program: topics of the own roscore and of the other relays become feeds, and listeners are given to these."""

    def __init__(self, values: Mapping[str, Any], roscore: Roscore, uri: str) -> None:
        """`uri`: that the roscore calls itself."""
        self.loop, limited, self.feeds_due, self.jobs_due = Loop(), program.LimitedLog(), 0.0, 0.0
        self.parties = Parties(values)
        self.accounts, self.board = Accounts(self.loop, self.parties.all, self.parties.robot), OfferBoard()
        dialers = Dialers(self.loop, self.parties.robot, self.parties.all)

        def make_feed(topic: str, of_one: bool) -> TopicFeed:
            return TopicFeed(self.loop, dialers, limited, self.accounts.budget, topic, self._request_feeds, of_one)

        own = {diagnostics.TOPIC: make_feed(diagnostics.TOPIC, False)} if values["diagnostics"] else {}
        self.given = GivenSide(self.parties, self.board, self.accounts, limited, make_feed)
        types = dict.fromkeys(own, diagnostics.TYPE)
        self.taken = TakenSide(self.parties, self.accounts, limited, make_feed, types)
        rules = callers(self.parties.members, uri, self.parties.is_here)
        sides = (self.given, self.taken, own)
        self.entrance = Entrance(
            self.loop, self.parties, rules, self.accounts, limited, dialers, sides, self._register, self._request_feeds
        )
        self.overview = Overview(values, uri, self.loop, limited, *sides, self.parties, self.accounts)
        end = partial(self.loop.post, local_roscore.obey_shutdown)
        self.api = SlaveApi(uri, self.entrance.port, end, self._list_links)
        malformed = self.entrance.report_malformed
        serve("", values["port"], {OFFERS: LongPoll(self._give_offers)}, malformed, rules)
        # A new port at each start: by its URI, nodes know that their former connection has ended, also if they did not see it.
        slave = RpcServer("", 0, self.api.methods(), malformed, rules)
        calls = Workers(self.loop, 1)  # everything that is asked of the own roscore
        self.registrar = Registrar(roscore, f"http://{find_own_host()}:{slave.server_address[1]}/", calls)
        again = self.registrar.begin_again
        self.health = local_roscore.RoscoreCheck(self.loop, roscore, local_roscore.Identity(), calls, again)
        reader = Reader(self.parties, roscore)
        self.reads = RecurringJob(calls, lambda: READ if reader.is_told else READ_WHOLE, reader.read, self._on_read)

    def run(self) -> int:
        """Run until the end; the exit status."""
        program.on_signals(self.loop, self._end)
        self.entrance.open()
        for robot, channel in self.parties.peers.items():
            peer = RelayPeer(robot, channel.hosts, channel.port, self.parties.robot, len(self.parties.peers))
            peer.start(partial(self.loop.post, self._on_offers))
        self._register()
        notify("READY=1")
        self.loop.run(self._tick)
        self.registrar.withdraw()
        self.overview.end()
        return 0

    def _tick(self, now: float) -> float:
        """One pass: messages come and go in it, and due actions are done, which are not asked for with each message."""
        if now >= self.jobs_due:
            self.entrance.reopen(now)
            jobs = (self.health, self.reads, self.registrar, self.overview)
            due = [job.tick(now) for job in jobs]
            self.jobs_due = min([now + BEAT, *(time for time in due if time is not None)])
        if now >= self.feeds_due:
            self.feeds_due = now + PATIENCE
            for feed in self.overview.list_feeds():
                feed.tick(now)
            self.entrance.tick(now)
        return min(self.jobs_due, self.feeds_due)

    def _request_feeds(self, due: float) -> None:
        """Have the feeds looked at then."""
        self.feeds_due = min(self.feeds_due, due)

    def _list_links(self) -> List[BusLink]:
        return [link for feed in self.overview.list_feeds() for link in feed.list_links()]

    def _end(self) -> None:
        program.leave_after(5.0)
        self.loop.stop()

    def _on_read(self, found: Optional[Found], problem: Optional[Exception]) -> None:
        if found is not None and self.given.take(found):  # its health is looked at elsewhere
            self._register()

    def _on_offers(self, robot: str, offers: Optional[Offers], why: str) -> None:
        if self.taken.take(robot, offers, why):
            self._register()

    def _give_offers(self, address: str, may_wait: bool, robot: Any, revision: Any, wait: Any) -> List[Any]:
        """The offers of this relay to a robot: (revision, port of the data, topics and services with their types and nodes)."""
        if not isinstance(revision, str) or not isinstance(wait, (int, float)):
            raise RefusedCall(f"{OFFERS} takes a robot, a revision (text) and a wait (seconds)")
        if not self.parties.is_peer(robot, address):
            raise RefusedCall("no channel leads there")
        seconds = min(max(0.0, float(wait)), LONGEST_WAIT) if may_wait else 0.0  # in this order: not a number is 0
        found = self.board.wait(robot, revision, seconds)
        if found is None:
            raise RefusedCall("the own roscore has not been read yet")
        now, offers = found
        return [now, self.api.port, [[*offer[:3], list(offer.nodes)] for offer in offers]]

    def _register(self) -> None:
        """Register the topics and services that are given here for others, and the topics that are listened to for them."""
        self.api.published, self.api.subscribed = self.taken.published, self.given.list_subscribed()
        wanted = {(PUBLISHER, topic): kind for topic, kind in self.api.published.items()}
        wanted.update({(SUBSCRIBER, topic): kind for topic, kind in self.api.subscribed.items()})
        uri = f"rosrpc://{find_own_host()}:{self.api.port}"
        # A roscore keeps one provider: one of this robot is never replaced, so they have to be known.
        others = self.taken.providers if self.given.is_known else ()
        wanted.update({(PROVIDER, service): uri for service in others if not self.given.has_provider(service)})
        self.registrar.want(wanted)


def main() -> int:
    """Start the node."""
    read = program.read_parameters(__doc__.partition("\n")[0], parameters.RELAY)
    if read is None or read[0]["port"] is None:
        raise program.Fatal("--parameters is needed, with a port and channels")
    env_uri = os.environ["ROS_MASTER_URI"]
    uri = local_roscore.wait_for_roscore(env_uri)
    roscore = Roscore(env_uri, NAME)
    local_roscore.refuse_second(roscore, NAME)
    values = program.settle_parameters(roscore, NAME, read, parameters.RELAY)
    return MasterRelay(values, roscore, uri).run()


if __name__ == "__main__":
    program.run(main)
