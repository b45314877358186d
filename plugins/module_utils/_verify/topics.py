# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The topics of all talkers, heard by one node of this computer."""

import inspect
import json
import re
import time
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.foreign import last_line
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.plain_text import plain
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import listener
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify.network import TRIES
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify.ros import NO_SCRIPT, SHORTEST, Ros
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify.talker import sentence_of, topic_of
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify.waiting import PAUSE, awaited

LAST = 3  # seconds before the end at which the listener says what it has heard until then


def topics(
    ros: Ros, talkers: typing.List[str], label: str, own: str, deadline: float
) -> typing.List[typing.Dict[str, typing.Any]]:
    """Hear the topics of all talkers with one node, and look up the registered publishers of each."""
    if not talkers or ros.missing():
        return []
    awaited(lambda: _answers(ros), bool, deadline)
    heard, error = listen(ros, talkers, label, own, deadline)
    try:
        published = _published(ros)
    except OSError as problem:
        published, error = {}, str(problem)
    found = []
    for talker in talkers:
        name = topic_of(talker)
        entry = _topic(talker, name, heard.get(name, {}), sentence_of(label, talker))
        nodes = published.get(name) or ([heard[name]["node"]] if heard.get(name, {}).get("node") else [])
        entry["publishers"] = [{"node": node, "uri": _uri(ros, node)} for node in nodes]
        if not entry["heard"] and not entry["error"]:
            unknown = published and name not in published
            entry["error"] = f"the topic is not registered at {ros.uri}" if unknown else error or "nothing"
        found.append(entry)
    return found


def _topic(talker: str, name: str, said: typing.Dict[str, typing.Any], wanted: str) -> typing.Dict[str, typing.Any]:
    """Compare what was heard on a topic (empty for nothing) with the text that is wanted."""
    heard = said.get("text") == wanted
    return {
        "computer": talker,
        "topic": name,
        "publishers": [],
        "heard": heard,
        "text": plain(said.get("text", "")),
        "seconds": said.get("seconds"),
        "error": f"heard '{plain(said.get('text', ''))}' instead" if said and not heard else "",
    }


def _published(ros: Ros) -> typing.Dict[str, typing.List[str]]:
    """Read {topic: publishers} from the roscore. Raises OSError.

    A roscore may answer 500 while much is registered at the same time: it iterates over what is being changed.
    """
    for unused in range(TRIES - 1):
        try:
            return dict(ros.ask("getSystemState")[0])
        except OSError:
            time.sleep(PAUSE)
    return dict(ros.ask("getSystemState")[0])


def _answers(ros: Ros) -> bool:
    try:
        return bool(ros.ask("getUri"))
    except OSError:
        return False


def listen(
    ros: Ros, talkers: typing.List[str], label: str, own: str, deadline: float
) -> typing.Tuple[typing.Dict[str, typing.Dict[str, typing.Any]], str]:
    """Run the listener; return {topic: text, node and seconds} of what it heard, and an error or ''.

    One node for all topics: rospy takes half a second of a processor to start, and there is one for each computer.
    """
    words = ros.python()
    if not words:
        return {}, NO_SCRIPT
    wanted = {topic_of(talker): sentence_of(label, talker) for talker in talkers}
    limit = max(deadline - time.monotonic(), SHORTEST)
    words += ["-c", inspect.getsource(listener), listener_of(own), f"{time.time() + limit - LAST:.1f}"]
    output, error = ros.program("the listener", words, limit, json.dumps(wanted))
    heard = last_line(output.encode())
    if not isinstance(heard, dict):
        return {}, f"the listener failed: {error or 'it printed nothing'}"
    return {topic: _said(heard[topic]) for topic in wanted if isinstance(heard.get(topic), dict)}, error


def _said(told: typing.Dict[str, typing.Any]) -> typing.Dict[str, typing.Any]:
    """Return what the listener told of a topic in the types that it should have: it ran with a workspace's modules."""
    seconds = told.get("seconds")
    return {
        "text": plain(told.get("text", "")),
        "node": plain(told.get("node", "")),
        "seconds": seconds if isinstance(seconds, (int, float)) and 0 <= seconds < 1e6 else None,
    }


def _uri(ros: Ros, node: str) -> str:
    try:
        return ros.ask("lookupNode", node)
    except OSError:
        return ""  # it ended since


def listener_of(computer: str) -> str:
    """Return the beginning of the node name of the listener; rospy makes the rest of it."""
    return re.sub(r"\W", "_", f"multimaster_verify_listener_{computer}")
