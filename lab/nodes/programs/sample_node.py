# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A rospy node with one of each: a publisher, a subscriber, a service, a parameter that it listens to.

    sample_node.py NAME

It prints when it hears of a publisher's message on /NAME/in, and when the parameter /NAME/word has changed.
"""

import sys
import time

import rospy
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerResponse

name = sys.argv[1]


def say(text):
    print(f"{time.time():.3f} {text}", flush=True)


rospy.init_node(name)
out = rospy.Publisher(f"/{name}/out", String, queue_size=10, latch=True)
rospy.Subscriber(f"/{name}/in", String, lambda message: say(f"heard {message.data}"))
rospy.Service(f"/{name}/serve", Trigger, lambda request: TriggerResponse(True, name))
rospy.set_param(f"/{name}/word", "first")
out.publish(name)
word = None
while not rospy.is_shutdown():
    now = rospy.get_param_cached(f"/{name}/word")
    if now != word:
        word = now
        say(f"word {word}")
    time.sleep(0.02)
