# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""all_there.py ROBOTS TOPICS: prints the time when the own roscore has /crowd_R/topic_N of all robots, every one of them.

It asks for the nodes first, four times a second, and for everything only when these are there: it must not cost much.
"""

import os
import sys
import time
import xmlrpc.client

robots, each = map(int, sys.argv[1:])
roscore = xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"])
print("ready", flush=True)
missing = [f"/crowd_{robot}" for robot in range(robots)]
while missing:
    time.sleep(0.25)
    calls = [{"methodName": "lookupNode", "params": ["/crowd", node]} for node in missing]
    found = roscore.system.multicall(calls)
    missing = [node for node, (answer,) in zip(missing, found) if answer[0] != 1]
while sum(topic.startswith("/crowd_") for topic, _nodes in roscore.getSystemState("/crowd")[2][0]) < robots * each:
    time.sleep(0.1)
print(f"{time.monotonic():.3f}", flush=True)
