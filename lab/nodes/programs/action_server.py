# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""An action that gives feedback and then doubles its goal: an ordinary actionlib server."""

import sys

import actionlib
import rospy
from actionlib.msg import TestAction, TestFeedback, TestResult


def double(goal):
    """Three feedbacks, then the result. The first ones may find a client that is still connecting, as anywhere in ROS."""
    for step in range(3):
        rospy.sleep(0.2)
        server.publish_feedback(TestFeedback(feedback=step))
    server.set_succeeded(TestResult(result=2 * goal.goal))


rospy.init_node(sys.argv[1])
server = actionlib.SimpleActionServer("/" + sys.argv[1] + "/double", TestAction, double, auto_start=False)
server.start()
rospy.spin()
