# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Has the giver register and unregister publishers, and measures until the own roscore knows, and knows no longer.

taker.py GIVER PORT COUNT PAUSE       prints [seconds until it is there, seconds until it is gone] for each change
taker.py GIVER PORT fill NODES TOPICS has so many nodes with so many topics each made, and prints seconds until all are there

Changes come at random moments, after PAUSE to 3 * PAUSE seconds. null: not within 60 s. The roscore is asked for one
node while a change is awaited, after each millisecond or 2 % of the time so far, and not at all otherwise.
"""

import json
import os
import random
import socket
import sys
import time
import xmlrpc.client

LIMIT, LOOK, SHARE = 60.0, 0.001, 0.02


class Giver:
    def __init__(self, address, port):
        self.lines = socket.create_connection((address, port)).makefile("rw")

    def ask(self, order, wanted):
        """The times before and after it was done."""
        self.lines.write(json.dumps([order, wanted]) + "\n")
        self.lines.flush()
        return json.loads(self.lines.readline())


def until(look, since):
    """Seconds from a time until it is so."""
    while not look():
        if time.monotonic() - since > LIMIT:
            return None
        time.sleep(max(LOOK, SHARE * (time.monotonic() - since)))
    return time.monotonic() - since


def known(node):
    return roscore.lookupNode("/taker", node)[0] == 1


giver = Giver(sys.argv[1], int(sys.argv[2]))
roscore = xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"])
if sys.argv[3] == "fill":
    nodes, each = map(int, sys.argv[4:])
    wanted = [[f"/full_{node}", f"/full_{node}/topic_{number}"] for node in range(nodes) for number in range(each)]
    LOOK = 0.2
    _before, after = giver.ask("register", wanted)
    print(
        until(
            lambda: sum("/full_" in topic for topic, _nodes in roscore.getSystemState("/taker")[2][0]) == len(wanted),
            after,
        )
    )
    sys.exit()

count, pause = int(sys.argv[3]), float(sys.argv[4])
for number in range(count):
    name = f"/bench_{os.getpid()}_{number}"
    change = [[name, f"{name}/data"]]
    times = []
    for order, there in (("register", True), ("unregister", False)):
        time.sleep(random.uniform(pause, 3 * pause))
        _before, after = giver.ask(order, change)
        times.append(until(lambda name=name, there=there: known(name) is there, after))
    print(json.dumps(times), flush=True)
