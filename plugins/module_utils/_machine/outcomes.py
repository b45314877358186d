# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The outcome of a probe: one fixed word. Programs decide by the word; a sentence is made where a result is returned."""

import enum
import errno
import socket
import time
import typing


class Outcome(enum.Enum):
    """The outcome of a probe. The controller has the same words (plugins/plugin_utils/_verify/observe/outcomes.py)."""

    NOT_TRIED = "not_tried"
    ANSWERED = "answered"  # an echo reply came from the address itself
    OPEN = "open"  # a TCP connection opened
    REFUSED = "refused"  # nothing listens on the TCP port, or a packet filter says so
    NO_ANSWER = "no_answer"
    NETWORK_UNREACHABLE = "network_unreachable"  # this kernel, or the router that reports it, has no route
    HOST_UNREACHABLE = "host_unreachable"  # the next machine on the way did not answer ARP
    PROHIBITED = "prohibited"  # a packet filter on the way reports that it rejects
    TIME_EXCEEDED = "time_exceeded"  # routers pass the packet round in a circle
    TOO_LARGE = "too_large"  # a router reports that the packet must be smaller
    WRONG_SOURCE = "wrong_source"  # the echo reply came from a different address
    RESET = "reset"  # the other side has ended an open connection
    NO_LOCAL_PORT = "no_local_port"  # this computer has no free port for the connection
    NO_FILE = "no_file"  # this process has as many files open as it may
    NO_FILE_HERE = "no_file_here"  # all processes of this computer together have
    NO_MEMORY = "no_memory"  # the kernel here has none for the socket or the packet
    NOT_PERMITTED = "not_permitted"  # a packet filter here does not let it go out
    CLOSED_ROUTE = "closed_route"  # a rule or a route here leads nowhere
    UNKNOWN_NAME = "unknown_name"  # the name has no address
    FAILED = "failed"  # anything else: the errno says more


# What each stands for where packets are sent; ip-route(8) has those of routes, nf_hook_slow of the kernel that of packet filters.
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
    """Return the outcome that an exception stands for, and its errno where the kernel gave one."""
    if isinstance(problem, socket.timeout):
        return Outcome.NO_ANSWER, problem.errno
    if isinstance(problem, socket.gaierror):  # its number is none of the kernel's
        return Outcome.UNKNOWN_NAME, None
    number = problem.errno if isinstance(problem, OSError) else None
    return _OUTCOMES.get(number or 0, Outcome.FAILED), number


class Connection(typing.NamedTuple):
    """The answer of a TCP port."""

    outcome: Outcome
    errno: typing.Optional[int]
    milliseconds: typing.Optional[float]  # None unless it opened
    error: str  # the kernel's words; empty where it opened, or where no answer came

    @property
    def words(self) -> str:
        """Say in a few words what came of it."""
        return "open" if self.outcome == Outcome.OPEN else self.error or "no answer"


def connect(address: str, port: int, patience: float) -> Connection:
    """Open a TCP connection, and close it."""
    start = time.monotonic()
    try:
        socket.create_connection((address, port), timeout=patience).close()
    except OSError as problem:
        error = "" if isinstance(problem, socket.timeout) else problem.strerror or str(problem)
        return Connection(*classify_error(problem), None, error)
    except UnicodeError as problem:  # a name with an empty or a long part
        return Connection(Outcome.UNKNOWN_NAME, None, None, str(problem))
    return Connection(Outcome.OPEN, None, round((time.monotonic() - start) * 1000, 3), "")
