# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Talkers and listeners of earlier verifications on this computer that were killed, and are still registered.

They would be found as nodes that do not answer, on every robot.
"""

import re
import typing

from .._base.deadlines import call_all
from .._contract.outcomes import Outcome
from .._machine.outcomes import connect
from .measure.talker import node_of
from .ros_client.hosts import place_of
from .ros_client.listener import listener_of
from .ros_client.ros import Ros

CONNECT = 2.0  # seconds
# Any caller of the roscore can register such names, with any URIs: so many are looked at, and for so long.
MOST = 50
LONGEST = 10.0  # seconds for all together, and again to unregister those that have ended
UNREGISTER = ("unregisterPublisher", "unregisterSubscriber")


def end_ghosts(ros: Ros, computer: str) -> typing.List[str]:
    """Unregister them and return their names. Without a roscore nothing is done; other parts say that it is missing."""
    own = re.compile(rf"{node_of('', computer)}[^_]+\Z|/{listener_of(computer)}_\d+_\d+\Z")
    ended: typing.Dict[str, str] = {}  # node -> URI
    try:
        tables = ros.read_state()[:2]
        nodes = sorted({node for table in tables for nodes in table.values() for node in nodes if own.match(node)})
        found = call_all(lambda node: _find_ended(ros, node), nodes[:MOST], LONGEST, lambda node: "")
        ended = {node: uri for node, uri in zip(nodes, found) if uri}
        calls = [
            (method, topic, node)
            for method, table in zip(UNREGISTER, tables)
            for topic, nodes in table.items()
            for node in sorted(ended.keys() & set(nodes))
        ]
        call_all(lambda call: ros.ask(*call[:2], ended[call[2]], caller=call[2]), calls, LONGEST, lambda call: None)
    except (OSError, ValueError, TypeError):
        pass
    return list(ended)


def _find_ended(ros: Ros, node: str) -> str:
    """Return the URI of a node if no program listens there, else an empty text. A program that does not answer may be busy."""
    try:
        uri = str(ros.ask("lookupNode", node))
    except (OSError, ValueError):  # it has just gone
        return ""
    host, port = place_of(uri)
    outcome = connect(host, port, CONNECT).outcome if host and port else Outcome.NOT_TRIED
    return uri if outcome == Outcome.REFUSED else ""
