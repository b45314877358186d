# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Prints each change of the roscore's registrations, with the time of the kernel's steady clock, which all containers share.

watch.py [LOOKS-A-SECOND] : lines are "TIME + publisher TOPIC NODE", "TIME - ...", "TIME dead" and "TIME answers".
"""

import os
import sys
import time
import xmlrpc.client

PAUSE = 1 / float(sys.argv[1] if len(sys.argv) > 1 else 20)
held, answers = set(), True


def report(*words):
    print(f"{time.monotonic():.3f}", *words, flush=True)


while True:
    try:
        roscore = xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"])
        parts = zip(("publisher", "subscriber", "service"), roscore.getSystemState("/watch")[2])
        seen = {f"{kind} {name} {node}" for kind, part in parts for name, nodes in part for node in nodes}
        if not answers:
            report("answers")
        for sign, items in (("-", held - seen), ("+", seen - held)):
            for item in sorted(items):
                report(sign, item)
        held, answers = seen, True
    except OSError:
        if answers:
            report("dead")
        held, answers = set(), False
    time.sleep(PAUSE)
