# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Says some messages on each of many topics as soon as a subscriber is connected, and as many once the connections rest.

first_words.py hear COUNT FOLDER... : hears FOLDER/0, FOLDER/1, ... and prints "TIME WHEN NUMBER TOPIC" for each message; WHEN
is "early" or "rested", NUMBER that of the message. It prints "ready" once it has subscribed to all.
first_words.py say COUNT FOLDER...  : publishes them, and prints "ready" once it has said everything. It answers questions of
other nodes 100 ms late, as over a radio link.
"""

import functools
import sys
import threading
import time

import rospy
from rospy.impl.masterslave import ROSHandler
from std_msgs.msg import String

role, count, *folders = sys.argv[1:]
EACH, PAUSE = 25, 0.004  # messages, and seconds from one to the next
APART = 0.05  # seconds from one new topic to the next: so no topic waits for the others
SETTLED = 1.0  # seconds without a change of a topic's connections
LINK = 0.1  # seconds until a question is answered
topics = [f"{folder}/{number}" for number in range(int(count)) for folder in folders]
publishers = []


def late(method):
    @functools.wraps(method)
    def answer(*arguments):
        time.sleep(LINK)
        return method(*arguments)

    return answer


def publish():
    for topic in topics:
        publishers.append(rospy.Publisher(topic, String, queue_size=2 * EACH))
        time.sleep(APART)


class Speech:
    """The messages of one topic."""

    def __init__(self, publisher):
        self.publisher, self.ends, self.since, self.said, self.due = publisher, [], 0.0, 0, 0.0

    def go_on(self):
        """Say all that is due. False once everything is said."""
        now, ends = (
            time.monotonic(),
            [(end.local_endpoint, end.remote_endpoint) for end in self.publisher.impl.connections],
        )
        if ends != self.ends:
            self.ends, self.since = ends, now
        early = self.said < EACH
        if ends and now > (self.due if early or self.said > EACH else self.since + SETTLED):
            self.publisher.publish(f"{'early' if early else 'rested'} {self.said % EACH} {self.publisher.name}")
            self.said, self.due = self.said + 1, now + PAUSE
        return self.said < 2 * EACH


def speak():
    ROSHandler.requestTopic = late(ROSHandler.requestTopic)
    threading.Thread(target=publish, daemon=True).start()
    speeches, over = {}, 0
    while over < len(topics):
        speeches.update((each.name, Speech(each)) for each in publishers[len(speeches) + over :])
        for name, speech in list(speeches.items()):
            if not speech.go_on():
                del speeches[name]
                over += 1
        time.sleep(0.001)


def hear():
    for topic in topics:
        rospy.Subscriber(topic, String, lambda message: print(f"{time.monotonic():.3f} {message.data}", flush=True))
        time.sleep(APART)


rospy.init_node(f"first_words_{role}")
{"say": speak, "hear": hear}[role]()
print("ready", flush=True)
rospy.spin()
