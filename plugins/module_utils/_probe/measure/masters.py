# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The discovery nodes of masters, with their TCP ports and clocks; and the relays of other robots."""

import time
import typing
import xmlrpc.client

from ..._base.deadlines import call_all, poll
from ..._base.plain_text import plain, quote
from ..._base.problem import tell_reason
from ..._contract.outcomes import Outcome
from ..._contract.ros import SeenRelay
from ..._machine import network as machine
from ..._machine.outcomes import classify_error, connect
from ..multicast.helper import LATEST
from ..ros_client.hosts import port_of
from ..ros_client.xml_rpc import server
from . import network

RELAYS = 20.0  # seconds for all relays
MOST_RELAYS, MOST_HOSTS = 64, 4  # relays that are asked, and addresses of one
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


def relays(planned: typing.Optional[typing.Mapping[str, typing.Any]]) -> typing.List[typing.Dict[str, typing.Any]]:
    """Ask the relays of other robots what they offer, as the relay here does, and try the ports of their data. `planned`: its parameters."""
    robot = str((planned or {}).get("robot", ""))
    places = {
        str(channel["peer"]): (list(map(str, channel["hosts"])), int(channel["port"]))
        for channel in (planned or {}).get("channels", ())
    }
    rows = [(peer, hosts[:MOST_HOSTS], port) for peer, (hosts, port) in sorted(places.items())[:MOST_RELAYS]]
    answers = call_all(lambda row: _ask_relay(robot, *row), rows, RELAYS, lambda row: None)
    return [answer for answer in answers if answer is not None]


def _ask_relay(robot: str, peer: str, hosts: typing.Sequence[str], port: int) -> typing.Dict[str, typing.Any]:
    """Ask a relay at the first of its addresses at which it answers."""
    not_tried = Outcome.NOT_TRIED
    found = SeenRelay(peer, port=port, outcome=not_tried, data_outcome=not_tried, data_port=0).plain()
    for host in hosts:
        found.update(host=plain(host))
        try:
            said = server(f"http://{host}:{port}/").rosfleetOffers(robot, "", 0.0)[1]
        except OSError as problem:
            found.update(outcome=classify_error(problem)[0].value, error=plain(problem.strerror or str(problem)))
        except Exception as problem:  # any: it is another computer's answer
            found.update(outcome=Outcome.FAILED.value, error=plain(str(problem)) or type(problem).__name__)
        else:
            # An answer with another number could be refused as a whole, with all that this computer has seen of others.
            is_port = isinstance(said, int) and not isinstance(said, bool) and 0 < said < 65536
            found["data_port"] = said if is_port else 0
            answer = connect(host, found["data_port"], CONNECT) if found["data_port"] else None
            data = answer.outcome if answer else Outcome.FAILED
            error = "" if data == Outcome.OPEN else plain(answer.words) if answer else "it told no valid port"
            return dict(found, outcome=Outcome.ANSWERED.value, data_outcome=data.value, error=error)
    return found


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
