# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The topics of all talkers, heard by one node of this computer."""

import time
import typing

from ..._base.deadlines import PAUSE, call_all, poll
from ..._base.plain_text import plain, quote
from ..._base.problem import explain_error
from ..._contract.outcomes import Outcome
from ..._machine.outcomes import connect
from ..ros_client.hosts import place_of
from ..ros_client.listener import Message, TopicListener, listener_of
from ..ros_client.ros import Ros, wait_for_roscore
from .network import TRIES
from .talker import sentence_of, topic_of

LEAST = 5.0  # seconds that are listened at least, also if the roscore was waited for
REGISTERING = 5.0  # seconds for the registration of a node that was heard
CONNECT, REACHING = 2.0, 10.0  # seconds that a connection to a publisher may take, and all of them


def topics(
    ros: Ros, talkers: typing.List[str], label: str, own: str, deadline: float
) -> typing.List[typing.Dict[str, typing.Any]]:
    """Hear the topics of all talkers with one node, and look up the registered publishers of each."""
    if not talkers or ros.problem():
        return []
    gone = wait_for_roscore(ros, deadline)["error"]  # it may start only now
    # The probe does not subscribe at a roscore without an answer: it would have to wait for the unsubscription, too.
    heard, errors, steps = ({}, {}, None) if gone else listen(ros, talkers, label, own, deadline)
    settled = time.monotonic() + REGISTERING
    try:
        published = read_publishers(ros)
    except OSError as problem:
        published, errors = {}, dict.fromkeys(map(topic_of, talkers), str(problem))
    rows = []
    for talker in talkers:
        name = topic_of(talker)
        entry = _topic(talker, name, heard.get(name, {}), sentence_of(label, talker))
        entry.update(listened=steps is not None, step="" if entry["heard"] else (steps or {}).get(name, ""))
        nodes = published.get(name) or ([heard[name]["node"]] if heard.get(name, {}).get("node") else [])
        entry["publishers"] = [
            {"node": node, "uri": _uri(ros, node, settled if entry["heard"] else 0.0)} for node in nodes
        ]
        if not entry["heard"] and not entry["error"]:
            entry["error"] = _say_why(ros, name, published, errors)
        rows.append(entry)
    _reach_unheard(rows)
    return rows


def _say_why(ros: Ros, name: str, published: typing.Mapping[str, typing.Any], errors: typing.Mapping[str, str]) -> str:
    unknown = published and name not in published
    return f"the topic is not registered at {ros.uri}" if unknown else errors.get(name) or "nothing"


def _reach_unheard(rows: typing.List[typing.Dict[str, typing.Any]]) -> None:
    unheard = [entry for entry in rows if entry["publishers"] and not entry["heard"]]
    for entry, (outcome, text) in zip(
        unheard, call_all(_reach, unheard, REACHING, lambda entry: (Outcome.NO_ANSWER, "no answer"))
    ):
        entry.update(reached=text, reached_outcome=outcome.value)


def _reach(entry: typing.Dict[str, typing.Any]) -> typing.Tuple[Outcome, str]:
    """Connect to the publisher of a topic that was not heard: this distinguishes a late message from a way that is closed."""
    host, port = place_of(entry["publishers"][0]["uri"])
    if not host:
        return Outcome.FAILED, "its URI is none"
    answer = connect(host, port, CONNECT)
    return answer.outcome, answer.words


def _topic(talker: str, name: str, message: typing.Dict[str, typing.Any], wanted: str) -> typing.Dict[str, typing.Any]:
    """Compare the text that was heard on a topic (empty for nothing) with the wanted one."""
    heard = message.get("text") == wanted
    return {
        "computer": talker,
        "topic": name,
        "publishers": [],
        "reached": "",
        "reached_outcome": Outcome.NOT_TRIED.value,
        "heard": heard,
        "text": plain(message.get("text", "")),
        "seconds": message.get("seconds"),
        "error": f"heard {quote(message.get('text', ''))} instead" if message and not heard else "",
    }


def read_publishers(ros: Ros) -> typing.Dict[str, typing.List[str]]:
    """Read {topic: publishers} from the roscore. Raises OSError.

    A roscore may answer 500 while much is registered at the same time: it iterates over a table that changes.
    """
    for unused in range(TRIES - 1):
        try:
            return ros.read_state()[0]
        except OSError:
            time.sleep(PAUSE)
    return ros.read_state()[0]


def listen(
    ros: Ros, talkers: typing.List[str], label: str, own: str, deadline: float
) -> typing.Tuple[typing.Dict[str, Message], typing.Dict[str, str], typing.Optional[typing.Dict[str, str]]]:
    """Listen to all talkers.

    Return {topic: text, node and seconds} of topics that were heard, {topic: why it was not}, and {topic: how far the call has come};
    None instead if the listener itself has failed.
    """
    wanted = {topic_of(talker): sentence_of(label, talker) for talker in talkers}
    try:
        listener = TopicListener(ros, listener_of(own), wanted)
        listener.run(max(deadline, time.monotonic() + LEAST))
    except OSError as problem:
        return {}, dict.fromkeys(wanted, f"the listener failed: {explain_error(problem)}"), None
    return listener.heard, listener.errors, dict(listener.steps)


def _uri(ros: Ros, node: str, end: float) -> str:
    """Return the URI of a node; empty if it is not registered, also at the end (monotonic seconds).

    With upstream's nodes, publishers that were heard were not registered for a moment. Why is not known.
    """

    def look() -> str:
        try:
            return str(ros.ask("lookupNode", node))
        except OSError:
            return ""  # it ended since

    return str(poll(look, bool, end))
