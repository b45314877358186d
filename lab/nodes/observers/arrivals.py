# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Prints the time and the topic of each message that it hears, and of each answer of the service, which it calls ten times a second.

python3 arrivals.py SERVICE TOPIC...        rospy's own clients, as anybody has them
"""

import sys
import time
from functools import partial

import rospy
from std_srvs.srv import Trigger


def report(name, _message=None):
    print(f"{time.monotonic():.3f} {name}", flush=True)


def call():
    try:
        service = rospy.ServiceProxy(sys.argv[1], Trigger, persistent=True)
        while not rospy.is_shutdown():
            service()
            report("service")
            time.sleep(0.1)
    except rospy.ServiceException:
        time.sleep(0.1)


rospy.init_node("arrivals", anonymous=True)
for topic in sys.argv[2:]:
    rospy.Subscriber(topic, rospy.AnyMsg, partial(report, topic))
print("ready", flush=True)
while not rospy.is_shutdown():
    call()
