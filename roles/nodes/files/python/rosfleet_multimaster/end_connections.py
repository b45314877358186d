# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The program that ends TCP connections for master_sync. Only it has the right to (CAP_NET_ADMIN), and it does little else.

It ends a connection as asked, if that is one with a computer of the fleet that neither a roscore nor
discovery has (sync/core/permission.py), and not too many of them. It runs on the system's Python (`python3 -I`), on files of
root only, and without ROS.
"""

import json
import logging
from functools import partial
from typing import Any, List

from .edge import connections
from .edge.addresses import network
from .edge.clock import sleep
from .edge.journal import plain_streams, say
from .edge.process.systemd import notify, watchdog
from .protocol.members import Members
from .sync.connection_ender import EndedConnections, Pair, open_listener, serve_one
from .sync.core.permission import find_refusal

PER_SECOND = 256  # connections that are ended in a second; a request counts as one at least
IDLE = 10.0  # seconds between two signs of life without a watchdog


def answer(members: Members, problem: str, asked: List[Pair]) -> EndedConnections:
    """End those of these connections that may be ended. `problem`: why nothing can be; empty if it can."""
    if problem or not asked:
        return EndedConnections([], problem)
    try:
        own = network().own
        refused = {pair: find_refusal(members, *pair, own) for pair in asked}
        wanted = {pair for pair, refusal in refused.items() if not refusal}
        ended = connections.end_all(lambda found: (found.local, found.remote) in wanted) if wanted else []
    except OSError as error:
        return EndedConnections([], str(error))
    for found in ended:
        say(f"the connection from port {found.local[1]} to {found.remote[0]}:{found.remote[1]} is ended", logging.INFO)
    return EndedConnections(
        [(found.local, found.remote) for found in ended], "; ".join(sorted(set(refused.values()) - {""}))
    )


def main(parameters: str, path: str) -> None:
    """Answer for ever. `parameters`: the file of master_sync's, `path`: the socket."""
    plain_streams()
    with open(parameters, encoding="utf-8") as file:
        given: Any = json.load(file)
    problem = _problem()
    members = Members.from_parameters(given)
    patience = min(IDLE, watchdog() or IDLE)
    with open_listener(path) as listener:
        notify("READY=1", f"STATUS={problem or 'connections with lost robots are ended'}")
        while True:
            notify("WATCHDOG=1")
            count = serve_one(listener, patience, partial(answer, members, problem))
            sleep(max(1, count) / PER_SECOND)


def _problem() -> str:
    try:
        connections.check()
    except OSError as problem:
        text = f"connections cannot be ended here (CAP_NET_ADMIN, CONFIG_INET_DIAG_DESTROY): {problem}"
        say(text)
        return text
    return ""
