# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Talkers and listeners of earlier verifications on this computer that were killed, and are still registered.

They would be found as nodes that do not answer, on every robot.
"""

import re
import typing
from urllib.parse import urlsplit

from .._client.listener import listener_of
from .._client.ros import Ros
from .._machine.outcomes import Outcome, connect
from .._verify.talker import node_of

CONNECT = 2.0  # seconds
UNREGISTER = ("unregisterPublisher", "unregisterSubscriber")


def end_ghosts(ros: Ros, computer: str) -> typing.List[str]:
    """Unregister them and return their names. Without a roscore nothing is done; other parts say that it is missing."""
    own = re.compile(rf"{node_of('', computer)}[^_]+\Z|/{listener_of(computer)}_\d+_\d+\Z")
    ended: typing.Dict[str, str] = {}  # node -> URI
    try:
        tables = ros.ask("getSystemState")[:2]
        for node in sorted({node for table in tables for _topic, nodes in table for node in nodes if own.match(node)}):
            uri = str(ros.ask("lookupNode", node))
            if _has_ended(uri):
                ended[node] = uri
        for method, table in zip(UNREGISTER, tables):
            for topic, nodes in table:
                for node in ended.keys() & set(nodes):
                    ros.ask(method, topic, ended[node], caller=node)
    except (OSError, ValueError, TypeError):
        pass
    return list(ended)


def _has_ended(uri: str) -> bool:
    """Return True if no program listens there. A program that does not answer may be busy."""
    parsed = urlsplit(uri)
    return connect(parsed.hostname or "", parsed.port or 0, CONNECT).outcome == Outcome.REFUSED
