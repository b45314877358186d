# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""all_there.py ROBOTS TOPICS: prints the time when the own roscore has /crowd_R/topic_N of all robots, every one of them.

It must not cost much, since twenty of it run beside what they look at: it asks for one node after the other, four times a
second until that is there, and for everything only when all nodes are. So the time is up to a quarter of a second late.
"""

import os
import sys
import time
import xmlrpc.client

robots, each = map(int, sys.argv[1:])
PAUSE = 0.25  # seconds
roscore = xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"])
print("ready", flush=True)
for robot in range(robots):
    while roscore.lookupNode("/crowd", f"/crowd_{robot}")[0] != 1:
        time.sleep(PAUSE)
while sum(topic.startswith("/crowd_") for topic, _nodes in roscore.getSystemState("/crowd")[2][0]) < robots * each:
    time.sleep(PAUSE)
print(f"{time.monotonic():.3f}", flush=True)
