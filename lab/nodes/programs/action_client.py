# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""`action_client.py ACTION`: sends the goal 21 to the action, once, and prints the number of feedbacks and the result.

A rospy node that hears twice of a publisher, before its first question to that one is answered, connects twice: it closes
the first connection, and the messages of that one are lost. On one roscore that happens if two clients of an action start
at once; between robots each publisher is announced by both roscores. `wait_for_server` of actionlib is content with the first
connection. So this client waits until its connections have stayed the same for a while, as every sender of a single message
must. It sends one goal: a loss is a failure.
"""

import sys
import time

import actionlib
import rospy
from actionlib.msg import TestAction, TestGoal

SETTLED, PATIENCE = 1.0, 30.0  # seconds without a change of the connections, and until then at most


def connections(client):
    """The connections of the five topics, each by its two ends."""
    own = client.action_client
    topics = (own.pub_goal, own.pub_cancel, own.status_sub, own.feedback_sub, own.result_sub)
    return [[(end.local_endpoint, end.remote_endpoint) for end in topic.impl.connections] for topic in topics]


def settle(client):
    """Wait until the connections have stayed the same."""
    seen, since, until = connections(client), time.monotonic(), time.monotonic() + PATIENCE
    while time.monotonic() - since < SETTLED:
        if time.monotonic() > until:
            sys.exit("the connections with the action server did not come to rest within 30 s")
        time.sleep(0.02)
        now = connections(client)
        if now != seen:
            seen, since = now, time.monotonic()


feedbacks = []
rospy.init_node("action_client", anonymous=True)
client = actionlib.SimpleActionClient(sys.argv[1], TestAction)
if not client.wait_for_server(rospy.Duration(30)):
    sys.exit("the action server did not appear within 30 s")
settle(client)
client.send_goal(TestGoal(goal=21), feedback_cb=feedbacks.append)
if not client.wait_for_result(rospy.Duration(15)):
    sys.exit("the action gave no result within 15 s")
print(len(feedbacks), client.get_result().result)
