# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Listens to /diagnostics, and prints all of its texts as JSON: diagnostics.py SECONDS. An ordinary rospy node.

A list of messages, each a list of (level, name, message, [[key, value], ...]).
"""

import json
import sys
import time

import rospy
from diagnostic_msgs.msg import DiagnosticArray

heard = []


def take(message):
    """Keep the texts of a message."""
    heard.append(
        [
            [entry.level[0] if isinstance(entry.level, bytes) else entry.level, entry.name, entry.message]
            + [[[value.key, value.value] for value in entry.values]]
            for entry in message.status
        ]
    )


rospy.init_node("diagnostics_listener", anonymous=True)
rospy.Subscriber("/diagnostics", DiagnosticArray, take)
time.sleep(float(sys.argv[1]))
print(json.dumps(heard))
