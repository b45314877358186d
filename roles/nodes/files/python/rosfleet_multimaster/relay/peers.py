# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The relays of other robots: each is asked for its offers, and answers as soon as there is something new."""

import random
from functools import partial
from typing import Any, Callable, NamedTuple, Optional, Sequence

from ..edge.clock import monotonic, processor_time, sleep
from ..edge.loop import start_thread
from ..edge.patience import Pace
from ..edge.rpc_client import SMALL, Rpc
from .core.channels import Offer, read_offers

OFFERS = "rosfleetOffers"
WAIT, TIMEOUT = (
    (3.0, 5.0),
    3.0,
)  # seconds that the other relay may wait for news, and more for the answer: a cut link is seen by then
RETRY = 0.2  # seconds until one that does not answer is asked again
LOST = 10.0  # seconds after which its topics are withdrawn; one that is started again is back before


class Offers(NamedTuple):
    """The offers of a relay, and the place of its data."""

    host: str
    port: int  # of its data
    entries: Sequence[Offer]


def read_answer(value: Any, peers: int = 1) -> Any:
    """Read (revision, port, offers) of one of so many relays. Raises ValueError."""
    if not isinstance(value, list) or len(value) != 3 or not isinstance(value[0], str) or not isinstance(value[1], int):
        raise ValueError("it answers no revision with a port and offers")
    return value[0], value[1], read_offers(value[2], peers)


class RelayPeer:
    """Asks one relay, in a thread of its own."""

    def __init__(self, robot: str, hosts: Sequence[str], port: int, own_robot: str, peers: int = 1) -> None:
        """`peers`: how many there are, which share the memory for offers."""
        self.robot, self._hosts, self._port, self._own_robot = robot, hosts, port, own_robot
        self._read = partial(read_answer, peers=peers)

    def start(self, on_offers: Callable[[str, Optional[Offers], str], None]) -> None:
        """Begin to ask. `on_offers(robot, offers, why)` is called in the thread; None: it has been silent for a while, and why."""
        start_thread(f"peer-{self.robot}", lambda: self._follow(on_offers))

    def _follow(self, on_offers: Callable[[str, Optional[Offers], str], None]) -> None:
        number, revision, answered = 0, "", monotonic()
        rpc: Optional[Rpc] = None
        pace = Pace()
        while True:
            host = self._hosts[number % len(self._hosts)]
            try:
                wait = random.uniform(*WAIT) if revision else 0.0  # the first question is whether it is there
                rpc = rpc or Rpc(f"http://{host}:{self._port}", wait + TIMEOUT, SMALL)
                rpc.limit(wait + TIMEOUT)
                before, began, spent = revision, monotonic(), processor_time()
                revision, port, entries = rpc.call(OFFERS, self._own_robot, revision, wait, read=self._read)
                answered = monotonic()
                if revision != before:
                    on_offers(self.robot, Offers(host, port, entries), "")
                early = revision == before and answered - began < wait / 2
                sleep(max(0.0, pace.next(answered, processor_time() - spent, False, early) - monotonic()))
            except Exception as problem:  # any: the answers are another computer's
                if rpc is not None:
                    rpc.close()
                rpc, revision, number = None, "", number + 1
                if monotonic() - answered > LOST:
                    on_offers(self.robot, None, str(problem))
                sleep(RETRY)
