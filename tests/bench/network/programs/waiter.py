# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""waiter.py COUNT: subscribes to /first_N, prints "TIME N" for each message and "0 ready" as soon as all are subscribed."""

import sys
import time

import rospy
from std_msgs.msg import String

rospy.init_node("waiter")
for number in range(int(sys.argv[1])):
    rospy.Subscriber(
        f"/first_{number}", String, lambda _message, number=number: print(f"{time.monotonic():.4f}", number, flush=True)
    )
print("0 ready", flush=True)
rospy.spin()
