# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages with the time in them: `give TOPIC SIZE RATE SECONDS TOPICS` publishes, `take TOPIC SECONDS TOPICS` prints their ages.

With several TOPICS, each has its number behind its name. All containers share the kernel's steady clock. A rospy node of anybody.
"""

import json
import sys
import time

import rospy
from std_msgs.msg import String


def name_all(topic, count):
    """The names of the topics."""
    return [topic] if count == 1 else [f"{topic}{number}" for number in range(count)]


def give(topic, size, rate, seconds, count):
    """Publish at even distances."""
    publishers = [rospy.Publisher(name, String, queue_size=5) for name in name_all(topic, count)]
    until = time.monotonic() + 60
    while time.monotonic() < until and not all(one.get_num_connections() for one in publishers):
        time.sleep(0.1)
    began, number = time.monotonic(), 0
    while (now := time.monotonic()) < began + seconds:
        due = began + number / rate
        if now < due:
            time.sleep(due - now)
        for publisher in publishers:
            publisher.publish(f"{time.monotonic():.6f} ".ljust(size, "x"))
        number += 1
    print(f"{time.monotonic():.3f} sent {number * count}", flush=True)


def take(topic, seconds, count):
    """Note the ages until there was nothing for a while."""
    ages, size, last = [], [0], [0.0]

    def note(message):
        now = time.monotonic()
        ages.append(now - float(message._buff[4:24].split()[0]))
        size[0] += len(message._buff)
        last[0] = now

    for name in name_all(topic, count):
        rospy.Subscriber(name, rospy.AnyMsg, note, queue_size=None, buff_size=1 << 24, tcp_nodelay=True)
    until = time.monotonic() + seconds + 60
    while time.monotonic() < until and not (ages and time.monotonic() > last[0] + 3):
        time.sleep(0.1)
    ages.sort()
    found = {"count": len(ages), "bytes": size[0]}
    if ages:
        found.update(p50=1000 * ages[len(ages) // 2], p99=1000 * ages[int(len(ages) * 0.99)])
    print(f"{time.monotonic():.3f} {json.dumps(found)}", flush=True)


deed, topic, *numbers = sys.argv[1:]
rospy.init_node(deed, anonymous=True)
if deed == "give":
    give(topic, int(numbers[0]), float(numbers[1]), float(numbers[2]), int(numbers[3]))
else:
    take(topic, float(numbers[0]), int(numbers[1]))
