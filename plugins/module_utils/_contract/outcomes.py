# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The outcome of a probe: one fixed word, by which modules and checks decide."""

import enum


class Outcome(enum.Enum):
    """The outcome of a probe."""

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
    NO_MEMORY = "no_memory"  # the kernel here has no memory for the socket or the packet
    NOT_PERMITTED = "not_permitted"  # a packet filter here does not let it go out
    CLOSED_ROUTE = "closed_route"  # a rule or a route here leads nowhere
    UNKNOWN_NAME = "unknown_name"  # the name has no address
    FAILED = "failed"  # anything else: the errno says more
