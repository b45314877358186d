# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The nodes of a robot that has a twin: the same program with the same names on both. It knows nothing of other robots.

It publishes the name of its computer, offers a service and an action, has a tree of frames (map, odom, base_link, laser) in which
the laser is as far ahead as the robot's number says, and prints the messages on /cmd_vel and /goal, with the time.
"""

import re
import socket
import time

import actionlib
import rospy
from actionlib.msg import TestAction, TestFeedback, TestResult
from geometry_msgs.msg import PoseStamped, TransformStamped
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerResponse
from tf2_msgs.msg import TFMessage

HOST = socket.gethostname()
NUMBER = int((re.findall(r"\d+", HOST) or ["0"])[0])


def transform(parent, child, ahead=0.0):
    made = TransformStamped()
    made.header.frame_id, made.child_frame_id, made.header.stamp = parent, child, rospy.Time.now()
    made.transform.translation.x, made.transform.rotation.w = ahead, 1.0
    return made


def move(goal):
    """Three feedbacks, then the result. The first ones may find a client that is still connecting, as anywhere in ROS."""
    for step in range(3):
        rospy.sleep(0.2)
        action.publish_feedback(TestFeedback(feedback=step))
    action.set_succeeded(TestResult(result=2 * goal.goal))


def report(text):
    print(f"{time.monotonic():.3f} {text}", flush=True)


rospy.init_node("robot_nodes")
rospy.set_param("/robot_description", f"<robot name='{HOST}'/>")
scan = rospy.Publisher("/scan", String, queue_size=1)
camera = rospy.Publisher("/camera/image_raw/compressed", String, queue_size=1)
odometry = rospy.Publisher("/odom", PoseStamped, queue_size=1)
moving = rospy.Publisher("/tf", TFMessage, queue_size=10)
fixed = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
chart = rospy.Publisher("/map", String, queue_size=1, latch=True)
rospy.Subscriber("/cmd_vel", String, lambda message: report(message.data))
rospy.Subscriber("/goal", PoseStamped, lambda message: report(f"goal in {message.header.frame_id}"))
rospy.Service("/reset", Trigger, lambda request: TriggerResponse(True, HOST))
action = actionlib.SimpleActionServer("/move_base", TestAction, move, auto_start=False)
action.start()
chart.publish(f"map of {HOST}")
fixed.publish(TFMessage([transform("map", "odom"), transform("base_link", "laser", float(NUMBER))]))
rate = rospy.Rate(50)
step = 0
while not rospy.is_shutdown():
    camera.publish(f"{HOST} {step} " + "x" * 5000)
    if step % 5 == 0:
        scan.publish(f"scan of {HOST}")
        moving.publish(TFMessage([transform("odom", "base_link")]))
        pose = PoseStamped()
        pose.header.frame_id, pose.header.stamp = "odom", rospy.Time.now()
        odometry.publish(pose)
    step += 1
    rate.sleep()
