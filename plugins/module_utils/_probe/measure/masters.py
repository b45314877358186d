# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The discovery nodes of masters: the TCP port, and the clock."""

import time
import typing
import xmlrpc.client

from ..._base.deadlines import poll
from ..._base.plain_text import quote
from ..._base.problem import tell_reason
from ..._contract.outcomes import Outcome
from ..._machine import network as machine
from ..._machine.outcomes import connect
from ..multicast.helper import LATEST
from ..ros_client.hosts import port_of
from ..ros_client.xml_rpc import server
from . import network

CONNECT = 2.0  # seconds that a TCP connection may take: one lost SYN is sent again after one second


OUTSIDER = ("address", "name", "uri", "why")

SAMPLES = 3  # readings of a clock


def discovery(master: typing.Dict[str, typing.Any], deadline: float) -> typing.Dict[str, typing.Any]:
    """Try the TCP port of a master's discovery node until the deadline, and compare its clock with the one here."""
    found = {"computer": master["computer"], "address": master["address"], "port": master["rpc_port"]}
    found.update(poll(lambda: _connect(master["address"], master["rpc_port"]), lambda seen: seen["open"], deadline))
    found["roscore"], found["roscore_outcome"] = _roscore(master)
    found["route"] = network.route_to_plain(machine.route_to(master["address"]))
    found.update(clock_offset_s=None, clock_uncertainty_s=None, clock_error="")
    if found["open"]:
        try:
            offset, uncertainty = clock_offset(master["monitor_uri"])
            found.update(clock_offset_s=round(offset, 6), clock_uncertainty_s=round(uncertainty, 6))
        except (OSError, xmlrpc.client.Error, ValueError, TypeError, IndexError) as problem:
            found["clock_error"] = f"getCurrentTime failed: {quote(tell_reason(problem))}"
        except Exception as problem:  # http.client's and expat's own: something else than a discovery node
            found["clock_error"] = f"getCurrentTime failed: {type(problem).__name__}: {quote(problem)}"
    return found


def _roscore(master: typing.Dict[str, typing.Any]) -> typing.Tuple[str, str]:
    """Try the port of a master's roscore; return "open", or why it does not open, and the outcome. Without a URI it is not tried."""
    port = port_of(master.get("uri") or "")
    if not port:
        return "", Outcome.NOT_TRIED.value
    answer = _connect(master.get("roscore") or master["address"], port)
    return "open" if answer["open"] else answer["error"], answer["outcome"]


def outsiders(monitor_uri: str) -> typing.List[typing.Dict[str, str]]:
    """Return the senders that a discovery node of this computer ignores; empty if it is upstream's, or does not answer."""
    try:
        rows = server(monitor_uri).getOutsiders()[1]
        return [{key: str(value) for key, value in zip(OUTSIDER, row)} for row in rows]
    except Exception:  # the other parts say that it does not answer
        return []


def _connect(address: str, port: int) -> typing.Dict[str, typing.Any]:
    answer = connect(address, port, CONNECT)
    opened = answer.outcome == Outcome.OPEN
    return {
        "open": opened,
        "connect_ms": answer.milliseconds,
        "error": "" if opened else answer.error or f"no answer within {CONNECT:g} s",
        "outcome": answer.outcome.value,
        "errno": answer.errno,
    }


def clock_offset(monitor_uri: str) -> typing.Tuple[float, float]:
    """Return the seconds that the clock of a discovery node is ahead, by its getCurrentTime, and the uncertainty. A strange answer may raise any exception.

    The clock was read at some time between question and answer, so the quickest of a few says most (RFC 5905, section 10).
    """
    samples = []
    for number in range(SAMPLES):
        asked, began = time.time(), time.monotonic()
        theirs = float(server(monitor_uri).getCurrentTime()[1])
        if not 0 <= theirs < LATEST:  # no answer of a module may have any number
            raise ValueError(f"{theirs} is no time")
        half = (time.monotonic() - began) / 2
        samples.append((half, theirs - (asked + half)))
    half, offset = min(samples)
    return offset, half
