# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The silence of a roscore: many parts of a look ask it, and one that hangs, or that a packet filter hides, would keep each of them."""

import time
import typing

from ..._contract.outcomes import Outcome
from ..._machine.outcomes import classify_error

LONGEST = 15.0  # seconds without an answer to any question, after which others wait no more; lost packets take less


class Silence:
    """The time for which a roscore has answered no question of this process."""

    def __init__(self) -> None:
        self._answered = float("-inf")  # when it answered last (monotonic seconds)
        self._since: typing.Optional[float] = None  # when the first question since was asked
        self._problem: typing.Optional[OSError] = None  # what the last question met, once the silence is a long one

    def ask(self, question: typing.Callable[[], typing.Any], patient: bool) -> typing.Any:
        """Ask; in a long silence only the patient do, and others get the same OSError at once."""
        problem = self._problem
        if problem is not None and not patient:
            raise OSError(str(problem)) from problem.__cause__
        began = time.monotonic()
        try:
            answer = question()
        except OSError as problem:
            if classify_error(problem.__cause__)[0] == Outcome.NO_ANSWER:
                self._note(began, problem)
            else:
                self._end()
            raise
        self._end()
        return answer

    def _note(self, began: float, problem: OSError) -> None:
        if began < self._answered:  # another question was answered meanwhile
            return
        if self._since is None:
            self._since = began
        if time.monotonic() - self._since >= LONGEST:
            self._problem = problem

    def _end(self) -> None:
        self._answered, self._since, self._problem = time.monotonic(), None, None
