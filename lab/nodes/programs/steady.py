# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A node that publishes on each topic that is named, twenty times a second, one latched message on /map, and offers /reset."""

import sys

import rospy
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerResponse

rospy.init_node("steady")
publishers = [rospy.Publisher(topic, String, queue_size=1) for topic in sys.argv[1:]]
chart = rospy.Publisher("/map", String, queue_size=1, latch=True)
chart.publish("map")
rospy.Service("/reset", Trigger, lambda request: TriggerResponse(True, ""))
print("ready", flush=True)
rate = rospy.Rate(20)
while not rospy.is_shutdown():
    for publisher in publishers:
        publisher.publish("message")
    rate.sleep()
