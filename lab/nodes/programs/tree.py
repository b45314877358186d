# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""`tree.py PARENT CHILD ...`: looks up in tf2's buffer the places of frames in another one, and prints how far ahead each is.

An ordinary listener of /tf and /tf_static. It waits half a minute for all of them.
"""

import sys
import time

import rospy
from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore, TransformException

parent, *children = sys.argv[1:]
rospy.init_node("tree", anonymous=True)
buffer = BufferCore(rospy.Duration(10.0))


def take(put):
    return lambda message: [put(transform, "tree") for transform in message.transforms]


rospy.Subscriber("/tf", TFMessage, take(buffer.set_transform))
rospy.Subscriber("/tf_static", TFMessage, take(buffer.set_transform_static))
found, until = {}, time.monotonic() + 30
while len(found) < len(children) and time.monotonic() < until:
    time.sleep(0.1)
    for child in children:
        try:
            seen = buffer.lookup_transform_core(parent, child, rospy.Time(0))
        except TransformException:
            continue
        found[child] = seen.transform.translation.x
print(*(f"{child}={found.get(child, 'not there')}" for child in children))
