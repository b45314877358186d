# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""maker.py COUNT: creates a publisher on /first_N each half to one second, prints "TIME N", and publishes one text there."""

import random
import sys
import time

import rospy
from std_msgs.msg import String

rospy.init_node("maker")
held = []
for number in range(int(sys.argv[1])):
    time.sleep(random.uniform(0.5, 1))
    print(f"{time.monotonic():.4f}", number, flush=True)
    held.append(rospy.Publisher(f"/first_{number}", String, queue_size=1, latch=True))
    held[-1].publish("hello")
print("0 done", flush=True)
rospy.spin()
