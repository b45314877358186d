# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Wait until the roscore of ROS_MASTER_URI answers: `python3 -m rosfleet_multimaster.wait_for_master --timeout 60`.

Units of nodes that are not the bundled ones also set their parameters by it, and wait until they provide a service.
It needs Python 3.6 and no ROS, so it runs on every computer of the fleet.
"""

import argparse
import json
import os
import sys
import time
import xmlrpc.client
from typing import Any

from .edge.journal import plain_streams, say
from .protocol.plain_text import quote

CALLER = "/rosfleet_multimaster"
PAUSE = 0.2  # seconds between two looks


class Unavailable(Exception):
    """The awaited thing is not there yet."""


class Transport(xmlrpc.client.Transport):
    """Connections with a time limit: a roscore may take one and say nothing."""

    def make_connection(self, host: Any) -> Any:
        connection = super().make_connection(host)
        connection.timeout = 2.0  # seconds
        return connection


def ask(uri: str, method: str, *arguments: Any) -> Any:
    """The value that a roscore answers with. Raises Unavailable if the roscore gives no value."""
    try:
        code, text, value = getattr(xmlrpc.client.ServerProxy(uri, Transport()), method)(CALLER, *arguments)
    except Exception as problem:  # the network's, HTTP's and XML's own: whatever it is, not a roscore's answer
        raise Unavailable(f"the roscore at {uri} does not answer: {problem}") from None
    if code != 1:
        raise Unavailable(f"the roscore at {uri} says: {quote(text)}")
    return value


def ask_until(end: float, uri: str, method: str, *arguments: Any) -> Any:
    """The answer, as soon as there is one. Raises Unavailable when the time is over."""
    while True:
        try:
            return ask(uri, method, *arguments)
        except Unavailable:
            if time.monotonic() > end:
                raise
            time.sleep(PAUSE)


def main() -> int:
    """Wait, and return the exit status."""
    plain_streams()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--timeout", type=float, default=60.0, metavar="SECONDS")
    parser.add_argument(
        "--set", nargs=2, metavar=("NAMESPACE", "FILE"), help="the values there are then only the parameters of FILE"
    )
    parser.add_argument("--service", metavar="NAME", help="wait for this service too")
    options = parser.parse_args()
    uri, end = os.environ.get("ROS_MASTER_URI", "http://localhost:11311"), time.monotonic() + options.timeout
    try:
        ask_until(end, uri, "getUri")
        if options.set:
            namespace, path = options.set
            with open(path, encoding="utf-8") as stream:
                ask_until(end, uri, "setParam", namespace, json.load(stream))
        if options.service:
            ask_until(end, uri, "lookupService", options.service)
    except Unavailable as problem:
        say(f"{problem} (after {options.timeout:g} s)")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
