# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The discovery nodes of masters, with their TCP ports and clocks; and the relays of other robots."""

import time
import typing
import xmlrpc.client

from ..._base.deadlines import call_all, poll, stretch
from ..._base.plain_text import plain, quote
from ..._base.problem import explain_error
from ..._contract.outcomes import Outcome
from ..._contract.ros import CrossingTopic, SeenRelay
from ..._machine import network as machine
from ..._machine.outcomes import classify_error, connect
from ..multicast.helper import LATEST
from ..ros_client import tcpros
from ..ros_client.documents import NODE
from ..ros_client.hosts import place_of, port_of
from ..ros_client.ros import CALLER, Ros
from ..ros_client.xml_rpc import server
from . import network

RELAYS = 20.0  # seconds for all relays
TYPES = 12.0  # seconds for all nodes here that are asked for types; one that hangs takes two calls at most
MOST_RELAYS, MOST_HOSTS = 64, 4  # relays that are asked, and addresses of one
MOST_NODES = 50  # of an offer, as a relay has it
RELAY = "/master_relay"
HEARD = 2  # topics of one robot that are heard through both relays
MOST_LISTENERS = 4  # nodes here that are asked for the type of such a topic
ANY_TYPE = ("*", "")
LARGE = ("sensor_msgs/Image", "sensor_msgs/CompressedImage", "sensor_msgs/PointCloud2")  # types that are heard last
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
            found["clock_error"] = f"getCurrentTime failed: {quote(explain_error(problem))}"
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


Row = typing.Dict[str, typing.Any]
Offer = typing.Tuple[
    str, str, typing.Tuple[str, ...]
]  # the relays' name of a topic, its type, the nodes that publish it


def relays(
    planned: typing.Optional[typing.Mapping[str, typing.Any]], ros: typing.Optional[Ros] = None
) -> typing.List[Row]:
    """Ask the relays of other robots for their offers, as the relay here does, try the ports of their data, and hear topics through both.

    `planned`: the parameters of the relay here; `ros`: whose roscore has the topics that it publishes.
    """
    robot = str((planned or {}).get("robot", ""))
    channels = list((planned or {}).get("channels", ()))
    places = {str(channel["peer"]): (list(map(str, channel["hosts"])), int(channel["port"])) for channel in channels}
    rows = [(peer, hosts[:MOST_HOSTS], port) for peer, (hosts, port) in sorted(places.items())[:MOST_RELAYS]]
    answers = call_all(lambda row: _ask_relay(robot, *row), rows, RELAYS, lambda row: None)
    found = [answer for answer in answers if answer is not None]
    if ros is not None and found:
        _hear_crossing(ros, robot, channels, found)
    return [row for row, _offers in found]


def _ask_relay(robot: str, peer: str, hosts: typing.Sequence[str], port: int) -> typing.Tuple[Row, typing.List[Offer]]:
    """Ask a relay at the first of its addresses at which it answers; return its row, and the topics that it offers."""
    not_tried = Outcome.NOT_TRIED
    found = SeenRelay(peer, port=port, outcome=not_tried, data_outcome=not_tried, data_port=0).plain()
    for host in hosts:
        found.update(host=plain(host))
        try:
            answered = server(f"http://{host}:{port}/", NODE).rosfleetOffers(robot, "", 0.0)
            said, offers = answered[1], answered[2:]
        except OSError as problem:
            found.update(outcome=classify_error(problem)[0].value, error=plain(problem.strerror or str(problem)))
        except Exception as problem:  # any: it is another computer's answer
            found.update(outcome=Outcome.FAILED.value, error=plain(str(problem)) or type(problem).__name__)
        else:
            port = _read_port(said)
            answer = connect(host, port, CONNECT) if port else None
            data = answer.outcome if answer else Outcome.FAILED
            error = "" if data == Outcome.OPEN else plain(answer.words) if answer else "it gave no valid port"
            found.update(outcome=Outcome.ANSWERED.value, data_port=port, data_outcome=data.value, error=error)
            return found, list(_read_offers(*offers[:1]))
    return found, []


def _read_port(said: typing.Any) -> int:
    """Read a port; 0 for any other number, since an answer with it could be refused as a whole."""
    is_port = isinstance(said, int) and not isinstance(said, bool) and 0 < said < 65536
    return int(said) if is_port else 0


def _read_offers(offers: typing.Any = ()) -> typing.Iterator[Offer]:
    """Read the topics in the offers of another relay; what has another form is left out."""
    for entry in offers if isinstance(offers, list) else ():
        if isinstance(entry, list) and len(entry) == 4 and entry[0] == "topic" and isinstance(entry[3], list):
            yield str(entry[1]), str(entry[2]), tuple(map(str, entry[3][:MOST_NODES]))


def _hear_crossing(
    ros: Ros,
    robot: str,
    channels: typing.Sequence[typing.Mapping[str, typing.Any]],
    found: typing.Sequence[typing.Tuple[Row, typing.List[Offer]]],
) -> None:
    """Hear topics that come by the relay here from one robot alone, as a node of this robot hears them."""
    try:
        publishers, subscribers = ros.read_state()[:2]
        here = {topic for topic, nodes in publishers.items() if RELAY in nodes}
        relay = str(ros.ask("lookupNode", RELAY))
    except OSError:
        return  # the services and the roscore have rows of their own
    own = {row["robot"]: _name_here(row["robot"], channels, offers, here) for row, offers in found}
    jobs = [
        (row, topic, offer)
        for row, _offers in found
        if row["data_outcome"] == Outcome.OPEN.value
        for topic, offer in _choose(own, row["robot"])
    ]
    # A call has limits of its own. So a late one began late, behind those of other relays: it says nothing of its relay.
    heard = call_all(lambda job: _hear(relay, robot, *job), jobs, RELAYS, lambda job: None)
    crossings = [(topic, offer[1], crossing) for (_row, topic, offer), crossing in zip(jobs, heard) if crossing]
    for (row, _topic, _offer), crossing in zip(jobs, heard):
        row["crossing"] = [*row["crossing"], *filter(None, [crossing])]
    _compare(ros, subscribers, crossings)


def _compare(
    ros: Ros,
    subscribers: typing.Mapping[str, typing.Sequence[str]],
    crossings: typing.Sequence[typing.Tuple[str, str, Row]],
) -> None:
    """Add to topics (name, type, row) the nodes here that subscribe them with another type: the roscore has that of the last publisher alone.

    Each node is asked once, and all have a limit of their own: where nodes hang, the rows stay as they are.
    """
    listeners = {
        topic: [node for node in sorted(subscribers.get(topic, ())) if node != RELAY][:MOST_LISTENERS]
        for topic, kind, _row in crossings
        if kind not in ANY_TYPE
    }
    nodes = list(dict.fromkeys(node for some in listeners.values() for node in some))
    deadline = time.monotonic() + stretch(TYPES)
    answers = call_all(lambda node: _ask_types(ros, node, deadline), nodes, TYPES, lambda _node: {})
    types = dict(zip(nodes, answers))
    for topic, kind, row in crossings:
        unlike = [node for node in listeners.get(topic, ()) if types[node].get(topic, "") not in (kind, *ANY_TYPE)]
        row["unlike"] = list(map(plain, unlike))


def _ask_types(ros: Ros, node: str, deadline: float) -> typing.Dict[str, str]:
    """Ask a node here for the types with which it subscribes topics; empty without an answer, and after the deadline (monotonic seconds)."""
    try:
        if time.monotonic() > deadline:
            return {}
        answer = server(str(ros.ask("lookupNode", node))).getSubscriptions(CALLER)
        return {str(name): str(kind) for name, kind in answer[2]}
    except Exception:  # any: it is somebody's node, and others say that it does not answer
        return {}


def _name_here(
    peer: str,
    channels: typing.Sequence[typing.Mapping[str, typing.Any]],
    offers: typing.Sequence[Offer],
    here: typing.Container[str],
) -> typing.Dict[str, Offer]:
    """Return {name here: offer} of the topics that a peer offers and the relay here publishes."""
    named: typing.Dict[str, Offer] = {}
    for channel in channels:
        outer, inner = str(channel["as"]), str(channel["base"])
        for offer in offers if channel["peer"] == peer else ():
            name = inner + offer[0][len(outer) :] if channel["inner"] else offer[0]
            if name in here and (not channel["inner"] or offer[0].startswith(outer)):
                named.setdefault(name, offer)
    return named


def _choose(own: typing.Mapping[str, typing.Mapping[str, Offer]], peer: str) -> typing.List[typing.Tuple[str, Offer]]:
    """Choose few topics of a robot that no other robot offers, too: a header would be of either."""
    others = {topic for robot, named in own.items() if robot != peer for topic in named}
    alone = [(topic, offer) for topic, offer in own[peer].items() if topic not in others]
    return sorted(alone, key=lambda one: (one[1][1] in LARGE, one[0]))[:HEARD]


def _hear(relay: str, robot: str, row: Row, topic: str, offer: Offer) -> Row:
    """Hear a topic at the relay here; where no header comes, ask the other relay as that of this robot does."""
    try:
        _code, _said, protocol = server(relay).requestTopic(CALLER, topic, [["TCPROS"]])
        place = (place_of(relay)[0], _read_port(protocol[2]))
        message = tcpros.hear_any(place, {"callerid": CALLER, "topic": topic})
        return _make_crossing(topic, offer, message=message)
    except Exception as problem:  # any: what is heard is another computer's
        outcome, error = classify_error(problem)[0], plain(explain_error(problem)) or type(problem).__name__
    name, _type, nodes = offer
    asked = {
        "callerid": CALLER,
        "topic": name,
        "rosfleet_relay": robot,
        "rosfleet_publisher": nodes[0] if nodes else "",
    }
    try:
        tcpros.hear_any((row["host"], row["data_port"]), asked)
        there = Outcome.ANSWERED
    except Exception as problem:
        there = classify_error(problem)[0]
    return _make_crossing(topic, offer, outcome=outcome, there=there, error=error)


def _make_crossing(topic: str, offer: Offer, **values: typing.Any) -> Row:
    first: Row = {"outcome": Outcome.ANSWERED, "message": False, "there": Outcome.NOT_TRIED, "error": ""}
    return CrossingTopic(plain(topic), tuple(map(plain, offer[2])), **{**first, **values}).plain()


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
