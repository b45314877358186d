# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The meaning for a fleet of a broken component of each kind: a sentence or two for each kind."""

from __future__ import annotations

from collections.abc import Mapping

from .foreseen import PREDICTED, WATCHED
from .table import HOOKS

KINDS: Mapping[str, str] = {
    "computer": "Nothing of this computer works as planned, or nothing is known of it. Other computers are judged all the same.",
    "limit": "A node of roscpp prepares a table with an entry for each file that it may open. With a limit of millions it begins late, or not at all.",
    "program": "A program that has all of its files open takes no connection, and opens none: whoever calls it waits.",
    "container": "A container gets its /etc/hosts when it starts. Nodes in it cannot connect to robots whose names came later.",
    "ros": "Nodes that run go on. No node starts any more, also after the next boot.",
    "set_up": "The checks of values that site.yml sets say little there. The checks of the fleet's traffic count all the same.",
    "setting": "A value of the kernel differs from the one that the fleet needs.",
    "boot": "All is well now. After the next boot it is not.",
    "names": "ROS sends the name of the publisher's computer to every subscriber. A computer for which this name means another address hears nothing.",
    "interface": "Packets for the computer go to a place where it does not get them, or large ones are lost.",
    "neighbour": "On one network, a computer finds the hardware address of another one by ARP. Without it no packet is sent.",
    "link": "All that goes over this link is lost, late or slow.",
    "way": "A packet trace shows that packets end here. No value that was read explains it.",
    "network": "All computers on this network are concerned, and each of them is well.",
    "route": "Packets for other networks leave by the route that fits best. Without the planned one they go to a wrong place, or nowhere.",
    "forwarding": "Computers behind this gateway reach nobody, and nobody reaches them.",
    "reverse_path": "Answers come back by another way than the questions went. The kernel drops them without a word.",
    "redirects": "The router advises computers to send packets directly, on a way that does not exist. Connections break after a while.",
    "translation": "Other robots see the address of the gateway in the place of the computer's. Discovery ignores such heartbeats, and nodes cannot call back.",
    "filter": "A packet filter drops packets of the fleet. Packets that it lets pass work, so the robots see each other in part.",
    "clock": "tf and message filters compare times of several computers. Messages from the future or the past are dropped.",
    "environment": "Nodes announce the host of ROS_HOSTNAME or ROS_IP, and register at ROS_MASTER_URI. With others they are not found, or not heard.",
    "roscore": "No node of the robot can register or look up a topic. Nodes that are connected go on.",
    "discovery": "The other robots do not find this robot, or see an old state of it.",
    "sync": "Topics and services of the other robots are not registered at this roscore, or old ones stay.",
    "service": "A unit of the collection does not do its work.",
    "parameter": "Two robots work with different values of one parameter.",
    "relay": "A topic or service with another name does not cross between two robots.",
    "declaration": "The declaration of a robot in the inventory decides which topics cross. Others do not see a topic that it leaves out.",
    "messages": "A subscriber refuses a publisher with another definition of the message.",
    "node": "A node of yours announces a place, or uses a roscore, that the other robots cannot use. Its topics do not cross.",
    "registration": "A roscore and the nodes do not agree on the nodes that are there.",
    "topic": "A message of one robot acts on another one, or comes back again and again.",
    "time": "tf and message filters drop messages that are very old, or from the future. Nodes with simulated time wait for /clock.",
    "stranger": "A computer outside the inventory takes part in discovery. It gets nothing if multimaster_strangers is ignore.",
    PREDICTED: "Nothing is broken yet: after site.yml, packets would end there, by the plan and by the values that were read.",
    WATCHED: "During a watch, a value that was good was lost. The first loss is nearest to the reason.",
    **{kind: text for hooks in HOOKS for kind, text in hooks.kinds.items()},
}
