# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The throughput to other computers: a short stream to the talker of each, one after the other, as a node's data would go.

The talker is found at the own roscore, so names, routes and packet filters are those of any node.
"""

import time
import typing

from ..._base.plain_text import plain
from ..._base.problem import explain_error
from ..._contract.ros import Stream
from ..ros_client import tcpros
from ..ros_client.listener import place_of
from ..ros_client.ros import Ros
from .talker import node_of, topic_of

SPARE = 10.0  # seconds, besides those of the streams, for all that do not answer


def streams(
    ros: Ros, talkers: typing.List[str], label: str, own: str, seconds: float
) -> typing.List[typing.Dict[str, typing.Any]]:
    """Send a stream to each talker, and return the result of each, as plain data."""
    deadline = time.monotonic() + SPARE + len(talkers) * seconds
    caller = node_of(label, own).replace("talker", "stream", 1)
    return [_stream(ros, talker, label, caller, seconds, deadline).plain() for talker in talkers]


def _stream(ros: Ros, talker: str, label: str, caller: str, seconds: float, deadline: float) -> Stream:
    if time.monotonic() > deadline:
        return Stream(talker, error="others took too long")
    topic = topic_of(talker)
    try:
        place = place_of(topic, ros.ask("lookupNode", node_of(label, talker)), caller)
        came, took = tcpros.send_stream(place, topic, caller, seconds)
    except Exception as problem:  # whatever a stranger answers
        return Stream(talker, error=plain(explain_error(problem)))
    return Stream(talker, round(came * 8 / took / 1e6, 1))
