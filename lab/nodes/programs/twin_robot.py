# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The nodes of a robot that has a twin: the same program, node names and topics on both.

Publishes /scan at 10 Hz and /camera at 50 Hz, each with the name of its computer, and /map once, latched. Prints what it hears on
/cmd_vel, with the time. It knows nothing of other robots.
"""

import socket
import time

import rospy
from std_msgs.msg import String

rospy.init_node("robot_nodes")
host = socket.gethostname()
scan = rospy.Publisher("/scan", String, queue_size=1)
camera = rospy.Publisher("/camera", String, queue_size=1)
chart = rospy.Publisher("/map", String, queue_size=1, latch=True)
rospy.Subscriber("/cmd_vel", String, lambda message: print(f"{time.monotonic():.3f} {message.data}", flush=True))
chart.publish(f"map of {host}")
rate = rospy.Rate(50)
number = 0
while not rospy.is_shutdown():
    camera.publish(f"{host} {number} " + "x" * 5000)
    if number % 5 == 0:
        scan.publish(f"scan of {host}")
    number += 1
    rate.sleep()
