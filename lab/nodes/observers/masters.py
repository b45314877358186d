# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Prints each change of list_masters, with the time of the kernel's steady clock, which all containers share.

masters.py [LOOKS-A-SECOND] : lines are "TIME + NAME URI MONITOR-URI online", "TIME - NAME URI MONITOR-URI offline" ...
"""

import sys
import time

import rospy
from fkie_multimaster_msgs.srv import DiscoverMasters

PAUSE = 1 / float(sys.argv[1] if len(sys.argv) > 1 else 10)
list_masters = rospy.ServiceProxy("/master_discovery/list_masters", DiscoverMasters)
held = set()
while True:
    try:
        masters = list_masters().masters
    except rospy.ServiceException:  # discovery starts, or is stopped
        masters = None
    if masters is not None:
        words = ("offline", "online")
        seen = {f"{one.name} {one.uri} {one.monitoruri} {words[bool(one.online)]}" for one in masters}
        for sign, items in (("-", held - seen), ("+", seen - held)):
            for item in sorted(items):
                print(f"{time.monotonic():.3f}", sign, item, flush=True)
        held = seen
    time.sleep(PAUSE)
