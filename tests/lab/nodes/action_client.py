# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Sends the goal 21 to the action and prints the number of feedbacks and the result."""

import sys

import actionlib
import rospy
from actionlib.msg import TestAction, TestGoal

feedbacks = []
rospy.init_node("action_client", anonymous=True)
client = actionlib.SimpleActionClient("/" + sys.argv[1] + "/double", TestAction)
if not client.wait_for_server(rospy.Duration(60)):
    sys.exit("the action server did not appear within 60 s")
# One goal only: a second one would hide that messages get lost between two robots.
client.send_goal(TestGoal(goal=21), feedback_cb=feedbacks.append)
if not client.wait_for_result(rospy.Duration(60)):
    sys.exit("the action gave no result within 60 s")
print(len(feedbacks), client.get_result().result)
