# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A program with a Copies alone, to be killed: `copies_program.py OWN-URI OTHER-URI NAME ...`."""

import sys

from rosfleet_multimaster.edge.clock import monotonic
from rosfleet_multimaster.edge.loop import Loop, Workers
from rosfleet_multimaster.edge.process import program
from rosfleet_multimaster.edge.roscore import Roscore
from rosfleet_multimaster.protocol.filters import Filters
from rosfleet_multimaster.protocol.members import MemberRobot, Members
from rosfleet_multimaster.protocol.messages import AnnouncedMaster
from rosfleet_multimaster.sync.copies import Copies
from rosfleet_multimaster.sync.core.sync import Sync

NAME = "robot2"


def announced(uri, name=NAME, online=True):
    return AnnouncedMaster(name, uri, "http://127.0.0.1:11611", "/master_discovery", 1.0, 1.0, online)


def make(own_uri, other_uri, names, loop, on_change=lambda: None, namespace=""):
    """A Copies, and the core that knows one other robot."""
    uri = other_uri.rstrip("/").lower()
    entry = {"robot": NAME, "name": NAME, "uris": [uri], "rpc_port": 11611, "addresses": ["127.0.0.1"], "hosts": []}
    core = Sync(Filters({}), own_uri, "/master_sync", False, False, 0.0, Members([MemberRobot.from_entry(entry)]))
    entries = [{"from": NAME, "names": list(names), **({"as": namespace} if namespace else {})}] if names else []
    calls, limited = Workers(loop, 1), program.LimitedLog()
    return Copies(loop, Roscore(own_uri, "/master_sync"), core, calls, limited, entries, on_change), core


def main():
    """Run until it is killed."""
    own_uri, other_uri, *names = sys.argv[1:]
    loop = Loop()
    copies, core = make(own_uri, other_uri, names, loop)
    copies.take_over()
    core.take_announcement(announced(other_uri), monotonic())
    loop.run(lambda now: copies.tick(now) or now + 1.0)


if __name__ == "__main__":
    main()
