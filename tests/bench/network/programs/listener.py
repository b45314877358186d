# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""listener.py TOPIC: prints the time of each message."""

import sys
import time

import rospy

rospy.init_node("listener", anonymous=True)
rospy.Subscriber(sys.argv[1], rospy.AnyMsg, lambda _message: print(f"{time.monotonic():.4f}", flush=True))
rospy.spin()
