# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Prints each change of what the roscore holds, with the time of the kernel's steady clock, which all containers share.

watch.py [LOOKS-A-SECOND] : lines are "TIME + publisher TOPIC NODE", "TIME - ...", "TIME dead" and "TIME answers".
"""

import os
import sys
import time
import xmlrpc.client

PAUSE = 1 / float(sys.argv[1] if len(sys.argv) > 1 else 20)
held, answers = set(), True


def tell(*words):
    print(f"{time.monotonic():.3f}", *words, flush=True)


while True:
    try:
        roscore = xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"])
        parts = zip(("publisher", "subscriber", "service"), roscore.getSystemState("/watch")[2])
        seen = {f"{kind} {name} {node}" for kind, part in parts for name, nodes in part for node in nodes}
        if not answers:
            tell("answers")
        for sign, items in (("-", held - seen), ("+", seen - held)):
            for item in sorted(items):
                tell(sign, item)
        held, answers = seen, True
    except OSError:
        if answers:
            tell("dead")
        held, answers = set(), False
    time.sleep(PAUSE)
