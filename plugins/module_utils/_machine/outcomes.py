# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The outcome of a probe: one fixed word. Programs decide by the word; a sentence is made when a result is returned."""

import errno
import socket
import time
import typing

from .._base.deadlines import stretch
from .._contract.outcomes import Outcome

# The meaning of each if packets are sent; ip-route(8) has those of routes, nf_hook_slow of the kernel that of packet filters.
_OUTCOMES = {
    errno.ECONNREFUSED: Outcome.REFUSED,
    errno.ECONNRESET: Outcome.RESET,
    errno.EPIPE: Outcome.RESET,
    errno.ENETUNREACH: Outcome.NETWORK_UNREACHABLE,
    errno.EHOSTUNREACH: Outcome.HOST_UNREACHABLE,
    errno.ETIMEDOUT: Outcome.NO_ANSWER,
    errno.EADDRNOTAVAIL: Outcome.NO_LOCAL_PORT,
    errno.EMFILE: Outcome.NO_FILE,
    errno.ENFILE: Outcome.NO_FILE_HERE,
    errno.ENOBUFS: Outcome.NO_MEMORY,
    errno.ENOMEM: Outcome.NO_MEMORY,
    errno.EPERM: Outcome.NOT_PERMITTED,
    errno.EACCES: Outcome.CLOSED_ROUTE,  # prohibit
    errno.EINVAL: Outcome.CLOSED_ROUTE,  # blackhole
}


def classify_error(problem: typing.Optional[BaseException]) -> typing.Tuple[Outcome, typing.Optional[int]]:
    """Return the outcome that an exception means, and its errno if the kernel gave one."""
    if isinstance(problem, socket.timeout):
        return Outcome.NO_ANSWER, problem.errno
    if isinstance(problem, socket.gaierror):  # its number is no errno of the kernel
        return Outcome.UNKNOWN_NAME, None
    number = problem.errno if isinstance(problem, OSError) else None
    return _OUTCOMES.get(number or 0, Outcome.FAILED), number


class PortAnswer(typing.NamedTuple):
    """The answer of a TCP port."""

    outcome: Outcome
    errno: typing.Optional[int]
    milliseconds: typing.Optional[float]  # None unless it opened
    error: str  # the kernel's words; empty if it opened, or if no answer came

    @property
    def words(self) -> str:
        """Describe the outcome in a few words."""
        return "open" if self.outcome == Outcome.OPEN else self.error or "no answer"


def connect(address: str, port: int, patience: float) -> PortAnswer:
    """Open a TCP connection within so many seconds, at the pace of this machine, and close it."""
    start = time.monotonic()
    try:
        socket.create_connection((address, port), timeout=stretch(patience)).close()
    except OSError as problem:
        error = "" if isinstance(problem, socket.timeout) else problem.strerror or str(problem)
        return PortAnswer(*classify_error(problem), None, error)
    except UnicodeError as problem:  # a name with an empty or a long part
        return PortAnswer(Outcome.UNKNOWN_NAME, None, None, str(problem))
    return PortAnswer(Outcome.OPEN, None, round((time.monotonic() - start) * 1000, 3), "")
