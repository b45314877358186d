# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Subscribes to a topic, whether anybody publishes there or not, and prints a line for each message."""

import sys

import rospy

rospy.init_node("listener", anonymous=True)
rospy.Subscriber(sys.argv[1], rospy.AnyMsg, lambda message: print("heard", flush=True))
rospy.spin()
