# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Twice a second: a new publisher, and how long it takes until a subscriber of the same roscore hears it.

newcomer.py NODE TOPIC : lines are "TIME SECONDS". The publisher of TOPIC comes and goes too, so that the roscore has all of
its subscribers, wherever they are, to notify.
"""

import sys
import time

import rospy
from std_msgs.msg import Int32

node, busy = sys.argv[1:]
heard = set()
rospy.init_node(node)
rospy.Subscriber(f"/{node}/new", Int32, lambda message: heard.add(message.data))
number = 0
while not rospy.is_shutdown():
    number += 1
    publishers = [rospy.Publisher(busy, Int32, queue_size=1)]
    started = time.monotonic()
    publishers.append(rospy.Publisher(f"/{node}/new", Int32, queue_size=1, latch=True))
    publishers[1].publish(number)
    while number not in heard and not rospy.is_shutdown():
        time.sleep(0.005)
    print(f"{started:.3f} {time.monotonic() - started:.3f}", flush=True)
    for publisher in publishers:
        publisher.unregister()
    time.sleep(0.5)
