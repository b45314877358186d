# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The announcements of the own master, and their times: its state, that it has gone, requests for theirs."""

from typing import Dict, List, Optional, Tuple

from ...protocol.heartbeat import Kind
from ...protocol.messages import AnnouncedMaster
from ...protocol.parameters import Settings
from .actions import ActionOutbox
from .local_master import LocalMaster
from .peer import LONG_AGO
from .peers import Peers

REPEAT_CHANGES = (0.0, 0.2, 1.0)  # seconds after a change: one lost datagram must not delay it
REPEAT_REQUESTS = (0.0, 1.0, 5.0)  # seconds after the start
OFTEN = 1.0  # heartbeats a second, of which the next one is soon enough to announce that a master's foreign registrations have changed
ANSWER_PAUSE = 0.1  # seconds between two answers to one address
MAX_ANSWERED = 4096  # addresses that are answered in a second


class Announcements:
    """The announcements of the own master, and the requests of a start."""

    def __init__(self, settings: Settings, local: LocalMaster, peers: Peers, outbox: ActionOutbox) -> None:
        self._settings, self._local, self._peers, self._outbox = settings, local, peers, outbox
        self._announce: List[float] = []  # when the state is announced, or that it has gone
        self._request: List[float] = []  # when the others are asked
        self._next_beat = 0.0
        self._left = False
        self._answered: Dict[Optional[str], float] = {}

    def take(self, before: Optional[AnnouncedMaster], master: AnnouncedMaster, now: float) -> None:
        """Announce a state that is new or changed, several times."""
        self._left = False
        if before is None or not before.online:
            self.greet(now)
        elif before.local_stamp != master.local_stamp or (
            before.stamp != master.stamp and self._settings.heartbeat_hz < OFTEN
        ):
            self._announce = [now + after for after in REPEAT_CHANGES]

    def greet(self, now: float) -> None:
        """Greet the others and ask them, since this master or its network has just come."""
        self._announce = [now + after for after in REPEAT_CHANGES]
        self._request = [now + after for after in REPEAT_REQUESTS]

    def stop(self) -> None:
        """Announce nothing of a roscore that does not answer."""
        self._announce = []

    def say_gone(self, now: float) -> None:
        """Ask the others, once, to forget the own master."""
        if not self._left:
            self._left = True
            self._announce = [now + after for after in REPEAT_CHANGES]

    def leave(self) -> None:
        """Announce that this node ends."""
        self._to_all(self._local.record(Kind.LEAVE))

    def refresh(self, now: float) -> None:
        """Ask all masters for their state now."""
        for host in set(self._peers.addresses()):
            self._outbox.send(self._local.record(Kind.REQUEST), host)
        self._request = [now]

    def answer(self, host: str, multicast: bool, now: float) -> None:
        """Answer a request."""
        if not self._local.online:
            return
        if len(self._answered) >= MAX_ANSWERED:
            text = f"{len(self._answered)} addresses asked for the state within a second: the others are not answered"
            self._outbox.say("warning", "requests", text)
            return
        group: Tuple[Optional[str], ...] = (None,) if multicast and self._settings.send_mcast else ()
        for target in group + (host,):
            if now - self._answered.get(target, LONG_AGO) >= ANSWER_PAUSE:
                self._answered[target] = now
                self._outbox.send(self._local.record(Kind.STATE), target)

    def tick(self, now: float) -> None:
        """Send the announcements that are due."""
        self._announce_state(now)
        if self._local.online and any(due <= now for due in self._request):
            self._request = [due for due in self._request if due > now]
            self._ask_for_states()

    def tidy(self, now: float) -> None:
        """Forget the addresses that were answered long enough ago."""
        self._answered = {host: at for host, at in self._answered.items() if now - at < ANSWER_PAUSE}

    def due(self) -> List[float]:
        """The times at which something is to be announced."""
        announcements = [] if self._local.master is None else list(self._announce)
        return [*announcements, *self._request, self._next_beat] if self._local.online else announcements

    def _announce_state(self, now: float) -> None:
        announce = self._local.master is not None and any(due <= now for due in self._announce)
        self._announce = [due for due in self._announce if due > now]
        if self._local.online and (announce or now >= self._next_beat):
            self._next_beat = now + 1.0 / max(self._settings.heartbeat_hz, 0.02)
            self._to_all(self._local.record(Kind.STATE))
        elif announce:
            self._to_all(self._local.record(Kind.LEAVE))

    def _ask_for_states(self) -> None:
        if self._settings.listen_mcast and self._settings.send_mcast:
            self._outbox.send(self._local.record(Kind.REQUEST), None)
        for host in self._settings.robot_hosts:
            self._outbox.send(self._local.record(Kind.REQUEST), host)

    def _to_all(self, datagram: bytes) -> None:
        hosts = list(self._settings.robot_hosts)
        if self._settings.send_mcast:
            self._outbox.send(datagram, None)
        else:
            hosts += self._peers.addresses()
        for host in dict.fromkeys(hosts):
            self._outbox.send(datagram, host)
