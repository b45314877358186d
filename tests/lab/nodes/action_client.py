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
if not client.wait_for_server(rospy.Duration(20)):
    sys.exit("the action server did not appear within 20 s")
for _attempt in range(3):  # the first goal or result may find a connection that is being made, as anywhere in ROS
    feedbacks.clear()
    client.send_goal(TestGoal(goal=21), feedback_cb=feedbacks.append)
    if client.wait_for_result(rospy.Duration(10)):
        print(len(feedbacks), client.get_result().result)
        break
else:
    sys.exit("the action gave no result within 10 s, three times")
