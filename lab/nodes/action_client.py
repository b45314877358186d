# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Sends the goal 21 to the action and prints the number of feedbacks and the result."""

import sys

import actionlib
import rospy
from actionlib.msg import TestAction, TestGoal

SETTLED = 1.0  # seconds without a change of the connections: while masters meet, one may be made anew
ATTEMPTS = 3

feedbacks = []
rospy.init_node("action_client", anonymous=True)
client = actionlib.SimpleActionClient("/" + sys.argv[1] + "/double", TestAction)
if not client.wait_for_server(rospy.Duration(30)):
    sys.exit("the action server did not appear within 30 s")
rospy.sleep(SETTLED)
for attempt in range(1, ATTEMPTS + 1):
    feedbacks.clear()
    client.send_goal(TestGoal(goal=21), feedback_cb=feedbacks.append)
    if client.wait_for_result(rospy.Duration(15)):
        print(len(feedbacks), client.get_result().result)
        break
    print("attempt %d of %d: the action gave no result within 15 s" % (attempt, ATTEMPTS), file=sys.stderr)
else:
    sys.exit(1)
