# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Reports the moment at which each thing works on a robot, from its boot on: an ordinary rospy node, which hears itself through a roscpp one.

alone.py ROBOT ADDRESS [OTHER]... : it publishes /ROBOT/talk, hears /ROBOT/back (topic_tools relay) and every /OTHER/talk, and
provides and calls the service /ROBOT/echo. Each line is "TIME EVENT", once: `own topic`, `own service`, `address` (eth0 has it, and
a carrier), `online MASTER` (list_masters says so), `heard OTHER`. TIME is of the kernel's steady clock, which all containers share.
"""

import fcntl
import socket
import struct
import sys
import threading
import time

import rospy
from fkie_multimaster_msgs.srv import DiscoverMasters
from std_msgs.msg import Int32
from std_srvs.srv import Trigger, TriggerResponse

SIOCGIFFLAGS, SIOCGIFADDR, IFF_RUNNING = 0x8913, 0x8915, 0x40
robot, address, *others = sys.argv[1:]
reported = set()


def report(event):
    if event not in reported:
        reported.add(event)
        print(f"{time.monotonic():.3f} {event}", flush=True)


def has_network():
    request = struct.pack("16s24x", b"eth0")
    try:
        found = fcntl.ioctl(probe, SIOCGIFADDR, request)[20:24]
        (flags,) = struct.unpack_from("=H", fcntl.ioctl(probe, SIOCGIFFLAGS, request), 16)
    except OSError:
        return False
    return socket.inet_ntoa(found) == address and bool(flags & IFF_RUNNING)


def look_at_network():
    while not has_network():
        time.sleep(0.01)
    report("address")


def call_own_service():
    rospy.wait_for_service(f"/{robot}/echo")
    if rospy.ServiceProxy(f"/{robot}/echo", Trigger)().message == robot:
        report("own service")


def list_masters():
    rospy.wait_for_service("/master_discovery/list_masters")
    while not rospy.is_shutdown():
        try:
            for master in rospy.ServiceProxy("/master_discovery/list_masters", DiscoverMasters)().masters:
                if master.online:
                    report(f"online {master.name}")
        except rospy.ServiceException:
            pass
        time.sleep(0.2)


probe = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
threading.Thread(target=look_at_network, daemon=True).start()
rospy.init_node(f"{robot}_alone")
rospy.Service(f"/{robot}/echo", Trigger, lambda _request: TriggerResponse(True, robot))
rospy.Subscriber(f"/{robot}/back", rospy.AnyMsg, lambda _message: report("own topic"))
for other in others:
    rospy.Subscriber(f"/{other}/talk", rospy.AnyMsg, lambda _message, other=other: report(f"heard {other}"))
for work in (call_own_service, list_masters):
    threading.Thread(target=work, daemon=True).start()
publisher = rospy.Publisher(f"/{robot}/talk", Int32, queue_size=1)
while not rospy.is_shutdown():
    publisher.publish(1)
    time.sleep(0.1)
