# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A limit in time for calls that know none."""

import threading
from typing import Any, Callable, List

_HANGING = 4  # jobs that may hang at once
_hanging: List[threading.Thread] = []
_lock = threading.Lock()  # of this list


def run_with_limit(seconds: float, job: Callable[[], Any]) -> Any:
    """The result of a job that knows no time limit, such as a call of rospy.

    Raises TimeoutError, at once too where several earlier jobs still hang; and what the job raises.
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
