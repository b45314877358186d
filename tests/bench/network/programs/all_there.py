# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""all_there.py ROBOTS TOPICS: prints the time when the own roscore has /crowd_R/topic_N of all robots, every one of them.

It must not cost much, since twenty of it run beside what they look at: it asks for the topics of one robot after the other,
four times a second until these are there, and counts them in the text of the answer. So the time is up to a quarter of a
second late.
"""

import http.client
import os
import sys
import time
import urllib.parse
import xmlrpc.client

robots, each = map(int, sys.argv[1:])
PAUSE = 0.25  # seconds
roscore = http.client.HTTPConnection(urllib.parse.urlsplit(os.environ["ROS_MASTER_URI"]).netloc)


def published(robot: int) -> int:
    """The number of topics of a robot that the roscore knows."""
    question = xmlrpc.client.dumps(("/all_there", f"/crowd_{robot}"), "getPublishedTopics")
    roscore.request("POST", "/RPC2", question, {"Content-Type": "text/xml"})
    return roscore.getresponse().read().count(b"/topic_")


print("ready", flush=True)
for robot in range(robots):
    while published(robot) < each:
        time.sleep(PAUSE)
print(f"{time.monotonic():.3f}", flush=True)
