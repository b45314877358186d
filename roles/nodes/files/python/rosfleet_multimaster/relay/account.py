# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The accounts of the robots: who is at the other end of a connection pays for it."""

from collections import deque
from typing import Callable, Collection, Deque, Dict, List

from ..edge.clock import monotonic
from ..edge.loop import Loop
from .core.budget import Budget
from .core.effort import Effort, make_efforts


class Account:
    """The account of a robot. Its connections take their turns one after the other, as far as its share of the processor goes."""

    def __init__(self, loop: Loop, robot: str, budget: Budget, effort: Effort) -> None:
        """`robot`: empty for all computers that belong to no robot; `budget`: of all robots together."""
        self.robot, self.budget = robot, budget
        self._loop, self._effort = loop, effort
        self._queue: Deque[Callable[[], None]] = deque()
        self._is_posted = False

    @property
    def may_go_on(self) -> bool:
        """True if something may be done for the robot now."""
        return not self._queue and self._effort.find_wait(monotonic(), self._loop.turn) is None

    @property
    def is_slowed(self) -> bool:
        """True if it had to wait for its share a short while ago."""
        return self._effort.is_slowed(monotonic())

    def spend(self, seconds: float) -> None:
        """Count so much time of the processor."""
        self._effort.spend(seconds, monotonic(), self._loop.turn)

    def queue(self, go_on: Callable[[], None]) -> None:
        """Have a function called as soon as it is its turn."""
        self._queue.append(go_on)
        if not self._is_posted:
            self._is_posted = True
            self._loop.post_later(0.0, self._go_on)

    def _go_on(self) -> None:
        while self._queue:
            wait = self._effort.find_wait(monotonic(), self._loop.turn)
            if wait is not None:
                self._loop.post_later(wait, self._go_on)
                return
            self._queue.popleft()()
        self._is_posted = False


class Accounts:
    """The accounts of all robots. They are few: robots are known by the plan."""

    def __init__(self, loop: Loop, robots: Collection[str], own: str) -> None:
        """`own`: this robot; `robots`: all of them."""
        self.budget = Budget(robots=robots, own=own)
        self._loop, self._efforts = loop, make_efforts(own)
        self._accounts: Dict[str, Account] = {}

    def find(self, robot: str) -> Account:
        """Return the account of a robot."""
        if robot not in self._accounts:
            self._accounts[robot] = Account(self._loop, robot, self.budget, Effort(robot, self._efforts))
        return self._accounts[robot]

    def list_slowed(self) -> List[str]:
        """List the robots that had to wait a short while ago, since their messages cost too much."""
        return sorted(robot for robot, account in list(self._accounts.items()) if account.is_slowed)
