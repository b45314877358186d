# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Publishes 20 messages a second and prints a line "TIME TOPIC NODE" for each that it hears: an ordinary rospy node.

chatter.py NAME [+TOPIC | TOPIC]... : those with a + are published, the others heard. NODE is who has sent the message; TIME
is of the kernel's steady clock, which all containers share.
"""

import sys
import time

import rospy
from std_msgs.msg import Int32

name, *topics = sys.argv[1:]


def print_message(message, topic):
    print(f"{time.monotonic():.3f} {topic} {message._connection_header['callerid']}", flush=True)


rospy.init_node(name)
publishers = [rospy.Publisher(topic[1:], Int32, queue_size=1) for topic in topics if topic.startswith("+")]
for topic in topics:
    if not topic.startswith("+"):
        rospy.Subscriber(topic, rospy.AnyMsg, print_message, topic)
while not rospy.is_shutdown():
    for publisher in publishers:
        publisher.publish(1)
    time.sleep(0.05)
