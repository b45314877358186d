# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The view of others: the masters as these see them, and the quality of the links."""

from itertools import takewhile
from typing import Deque, Dict, List, Sequence, Tuple

from ...protocol.members import Members
from ...protocol.messages import AnnouncedMaster, LinkQuality
from ...protocol.parameters import Settings
from .actions import ActionOutbox
from .local_master import LocalMaster
from .peer import FAR, Contact, Peer
from .peers import Peers


class MasterView:
    """The masters that others see."""

    def __init__(
        self, settings: Settings, members: Members, local: LocalMaster, peers: Peers, outbox: ActionOutbox
    ) -> None:
        self._settings, self._members, self._local, self._peers, self._outbox = settings, members, local, peers, outbox
        self._public: Dict[str, AnnouncedMaster] = {}

    def publish(self, now: float) -> None:
        """Compare the known masters with the listed ones, and list the difference. `now`: of the last tick.

        Masters are known by their URI here: one that is heard from two addresses is there while one of them is. A peer
        can answer with the URI of another one. So it is shown at the same address until it does not answer there over TCP.
        """
        self._peers.stale = False
        by_uri: Dict[str, List[Peer]] = {}
        for entry in self._peers.table.values():
            if entry.contact is not None:
                by_uri.setdefault(entry.contact.uri, []).append(entry)
        public = {uri: self._choose_master(uri, entries, now) for uri, entries in by_uri.items()}
        if self._local.master is not None:
            public[self._local.master.uri] = self._local.master
        before, self._public = self._public, public
        for uri, master in before.items():
            if uri not in public:
                self._outbox.event("removed", master._replace(online=False))
        for uri, master in public.items():
            if uri not in before:
                self._outbox.event("new", master)
            elif master != before[uri]:
                self._outbox.event("changed", master)

    def _choose_master(self, uri: str, entries: Sequence[Peer], now: float) -> AnnouncedMaster:
        """The master with this URI, of the peers that say so."""
        before = self._public.get(uri)
        at = before.monitor_uri if before is not None else ""

        def rank(entry: Peer) -> Tuple[bool, bool, bool]:
            return entry.monitor_uri == at and not entry.unreachable, entry.online, not entry.overdue

        best = max(entries, key=rank) if len(entries) > 1 else entries[0]
        if len(entries) > 1 and (best.overdue or not best.online) and best.contact_due == FAR and best.asked is None:
            self._peers.ask_soon(best, now)  # is it still there? A second peer claims its place
        return best.master()

    def report_twins(self, entry: Peer, contact: Contact) -> None:
        """Report a peer with the name of another master."""
        if contact.uri == self._local.uri:
            text = (
                f"{entry.monitor_uri} calls its master {contact.uri}, as this computer calls its own: nothing is"
                " exchanged with it; set ROS_HOSTNAME or ROS_IP before roscore starts, on both"
            )
            self._outbox.say("error", f"same {entry.key[0]}", text)
        for peer in self._peers.table.values() if self._members.master(contact.uri) is None else ():
            if peer.contact is not None and peer.contact.uri == contact.uri and peer.key[0] != entry.key[0]:
                text = (
                    f"{contact.name} ({contact.uri}) answers at {peer.key[0]} and at {entry.key[0]}: it keeps its place for"
                    " as long as it answers there"
                )
                self._outbox.say("warning", f"twice {contact.uri}", text)
        for other in self._public.values():
            if other.name == contact.name and other.uri != contact.uri:
                text = f"two masters are called {contact.name}: {other.uri} and {contact.uri}; give one another name"
                self._outbox.say("warning", f"name {contact.name}", text)

    def masters(self) -> List[AnnouncedMaster]:
        """All masters, the own one first."""
        own = self._local.uri
        return sorted(self._public.values(), key=lambda master: (master.uri != own, master.name, master.uri))

    def links(self, now: float) -> List[LinkQuality]:
        """The quality of the links to all masters, as `~linkstats` shows it."""
        links, local = [], self._local
        if local.master is not None:
            heard = local.beats[-1] if local.beats else now
            quality = self._quality(local.beats, self._settings.heartbeat_hz, local.since, now)
            links.append(LinkQuality(local.master.name, quality, now - heard, local.master.uri))
        for entry in self._peers.table.values():
            if entry.contact is not None:
                quality = self._quality(entry.beats, entry.rate, entry.since, now)
                links.append(LinkQuality(entry.contact.name, quality, now - entry.heard, entry.contact.uri))
        return links

    def _quality(self, beats: Deque[float], rate: float, since: float, now: float) -> float:
        if rate < 0.1:
            return -1.0
        window = min(self._settings.measurement_intervals / min(rate, 1.0), max(now - since, 1.0 / rate))
        received = sum(1 for _at in takewhile(lambda at: now - at <= window, reversed(beats)))  # the last ones
        return min(100.0, 100.0 * received / (rate * window))
