# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Publishes on the topic NAME, and serves NAME/call."""

import rospy
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerResponse

name = rospy.myargv()[1]
rospy.init_node("giver")
rospy.Service(name + "/call", Trigger, lambda request: TriggerResponse(True, name))
publisher = rospy.Publisher(name, String, queue_size=1, latch=True)
publisher.publish(name)
rospy.spin()
