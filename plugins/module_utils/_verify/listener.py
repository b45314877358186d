# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""A program like `rostopic echo` for many topics in one node: it writes the message of each, and its node.

Runs as a program of its own under the Python of this computer's ROS, which may be 2.7 (kinetic, melodic); it is handed
over as text, so nothing here may import another part of the collection.
"""

import json
import os
import sys
import time


def main(name, deadline, wanted):
    """Listen as the node `name` until each topic of `wanted` ({topic: text}) has said its text, or until the deadline.

    The deadline is a time of the wall clock, since Python and rospy may need many seconds to start on a busy computer.
    """
    import rospy  # noqa: PLC0415 only where it runs as a program
    import std_msgs.msg  # noqa: PLC0415

    began = time.time()
    heard = {}

    def hear(message, topic):
        if topic not in heard or heard[topic]["text"] != wanted[topic]:  # an older talker may come first
            node = getattr(message, "_connection_header", {}).get("callerid", "")
            heard[topic] = {"text": message.data, "node": node, "seconds": round(time.time() - began, 1)}

    rospy.init_node(name, anonymous=True, disable_rosout=True)
    for topic in wanted:
        rospy.Subscriber(topic, std_msgs.msg.String, hear, topic)
    while time.time() < deadline and not rospy.is_shutdown():
        if all(heard.get(topic, {}).get("text") == text for topic, text in wanted.items()):
            break
        time.sleep(0.05)
    sys.stdout.write(json.dumps(heard) + "\n")
    sys.stdout.flush()
    rospy.signal_shutdown("done")  # unregisters, as long as the roscore takes for it
    os._exit(0)  # a thread that still connects to somebody is not waited for


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), json.load(sys.stdin))
