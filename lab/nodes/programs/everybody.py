# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Publishes and serves under its computer's name, hears and calls all others, and prints whom it reached, as JSON.

python3 everybody.py OWN OTHER... : names of computers. An ordinary rospy node that knows nothing of the collection.
"""

import json
import socket
import sys
import threading
import time
import xmlrpc.client

import rospy
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerResponse

PATIENCE = 45.0  # seconds, most of which are the starts of all these nodes on one machine
own, others = sys.argv[1], sys.argv[2:]
heard, called = {}, {}


def name(computer):
    """The names of its topic and its service, as ROS allows them."""
    return "/everybody/" + computer.replace("-", "_")


def call(other):
    """Call a computer's service until it answers."""
    service = rospy.ServiceProxy(name(other) + "/where", Trigger)
    while other not in called:
        try:
            called[other] = service().message
        except rospy.ServiceException:
            time.sleep(0.3)


def connections():
    """The computers to which this node's subscriptions are connected: their nodes' own URIs name them."""
    _status, _text, entries = xmlrpc.client.ServerProxy(rospy.get_node_uri()).getBusInfo(rospy.get_name())
    # An entry: number, URI of the other node, direction, transport, topic, whether it is connected.
    return {
        (entry[4], entry[1].partition("//")[2].partition(":")[0]) for entry in entries if entry[2] == "i" and entry[5]
    }


rospy.init_node("everybody_" + own.replace("-", "_"))
publisher = rospy.Publisher(name(own), String, queue_size=1, latch=True)
publisher.publish(socket.gethostname())
rospy.Service(name(own) + "/where", Trigger, lambda request: TriggerResponse(True, socket.gethostname()))
for other in others:
    rospy.Subscriber(name(other), String, lambda message, other=other: heard.update({other: message.data}))
    threading.Thread(target=call, args=(other,), daemon=True).start()


def list_reached():
    """Return the robots that this node has heard and called by now, and the missing ones of each other node."""
    connected = connections()
    lacks = {
        other: "not connected" if other in heard else "not heard"
        for other in others
        if heard.get(other) != other or (name(other), other) not in connected
    }
    return {
        "topic": [other for other in others if other not in lacks],
        "service": [other for other in others if called.get(other) == other],
        "lacks": lacks,
    }


deadline = time.monotonic() + PATIENCE
found = list_reached()
while time.monotonic() < deadline and not len(found["topic"]) == len(found["service"]) == len(others):
    time.sleep(0.2)
    found = list_reached()
print(json.dumps(found), flush=True)
rospy.spin()  # the others may not be through
