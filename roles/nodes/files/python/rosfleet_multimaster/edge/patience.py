# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Patience with others: a limit in time for calls that have no limit of their own, and a pace of questions to who answers them too fast."""

import threading
from typing import Any, Callable, List

# Of a Pace
BURST, RATE = 20, 20.0  # answers at once, and answers a second after these
WHOLE = 20  # a whole state counts as so many answers
SHARE = 4  # the pause after an answer, in times of the processor time that it took
EARLY = 1.0  # seconds until the next question, if an answer without news came early
_HANGING = 4  # jobs that may hang at once
_hanging: List[threading.Thread] = []
_lock = threading.Lock()  # of this list


def run_with_limit(seconds: float, job: Callable[[], Any]) -> Any:
    """The result of a job that knows no time limit, such as a call of rospy.

    Raises TimeoutError, at once, too, if several earlier jobs still hang; and the errors of the job.
    """
    with _lock:
        _hanging[:] = [thread for thread in _hanging if thread.is_alive()]
        if len(_hanging) >= _HANGING:
            raise TimeoutError(f"{_HANGING} earlier calls have not come back yet")
    results: List[Any] = []
    problems: List[Exception] = []

    def work() -> None:
        try:
            results.append(job())
        except Exception as problem:  # rospy raises many
            problems.append(problem)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(seconds)
    if results:
        return results[0]
    if not problems:
        with _lock:
            _hanging.append(thread)
        raise TimeoutError(f"no answer within {seconds:g} s")
    raise problems[0]


class Pace:
    """The pace of the questions to one computer for its changes, however fast it answers.

    Free of clocks: times are arguments, in seconds of a clock that never steps.
    """

    def __init__(self) -> None:
        self._left, self._at = float(BURST), 0.0

    def next(self, now: float, took: float, whole: bool, early: bool) -> float:
        """The time of the next question, after an answer. `took`: seconds of a processor for it.

        `whole`: it was a whole state. `early`: it had no news, and did not wait for them.
        """
        self._left = min(BURST, self._left + (now - self._at) * RATE) - (WHOLE if whole else 1)
        self._at = now
        return now + max(-self._left / RATE, took * SHARE, EARLY if early else 0.0)
