# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults of people's nodes, shells and topics, of registrations, of strangers. Ids RF-5xx."""

from __future__ import annotations

from collections.abc import Mapping

from .fault import ALWAYS, READ, ROBOTS, Advice, Advices, Fault, Key, change, hand, on, site, site_of_all, verify_again
from .filters import MAKERS, RULES

START_AGAIN = hand(
    "end the node; then in the shell, launch file, unit or container on {place} that has started it: unset ROS_IP ROS_HOSTNAME; "
    ". /etc/profile.d/rosfleet-multimaster.sh; start it again"
)
NAMESPACE = hand(
    "end one of the two nodes, and start it again in a namespace of its robot: __ns:=/ROBOT behind its command, ns=ROBOT of its <node> or <group> in the "
    "launch file, or export ROS_NAMESPACE=/ROBOT in its shell; a topic whose name begins with / in its code stays, so remap that one"
)
NODE_HOSTS = on("env | grep ^ROS; rosnode list | xargs -n 1 rosnode info 2>/dev/null | grep -E '^Node|contacting'")
MASTERS = "the masters of {place}"
HUNG_DO = on("kill -CONT <pid>", "lets a stopped process go on: its state in the look has a T; end one that hangs")
HUNG_LOOK = on("ps -eo pid,stat,args | grep -vE ' (S|I)[<sl+]* '")


def _node(number: int, sentence: str, what: str, *do: Advice, look: Advices = (NODE_HOSTS,)) -> Fault:
    return Fault(
        f"RF-51{number}",
        sentence,
        do=do or (START_AGAIN,),
        look=look,
        what=what,
        read=ALWAYS,
        why="the host that the node announces was read",
    )


MASTER_LOOK = (on("echo $ROS_MASTER_URI; cat /etc/rosfleet-multimaster/environment"),)
NODES: Mapping[Key, Fault] = {
    ("environment", "shell"): Fault(
        "RF-501",
        "nodes started on {place} have another environment than planned: {what}",
        do=(
            site("writes the profile of shells"),
            on(
                "sed -i.$(date +%s) --follow-symlinks -E 's/^[[:space:]]*(export )?ROS_(HOSTNAME|IP|MASTER_URI)=/: # &/' ~/.bashrc ~/.profile",
                "as the user who starts nodes, in a new login then; the former files stay beside them, with a number at the end",
            ),
        ),
        look=(on("bash -lic env 2>/dev/null | grep ^ROS; grep -n ROS_ ~/.bashrc ~/.profile /etc/profile.d/*"),),
        cost=2.0,
        what="ROS_HOSTNAME or ROS_IP",
        read=READ,
        why="tutorials advise people to write them into ~/.bashrc",
    ),
    ("node", "unregistered"): Fault(
        "RF-502",
        "nodes on {place} are registered at no roscore, so no other node knows them: {what}; mostly they ran before the roscore of now was started",
        do=(
            hand(
                "end them on {place}, and start them again in a new login, in their unit, launch file or container: a node registers only "
                "when it starts"
            ),
        ),
        look=(on("rosnode list; ss -ltnp", "the first does not list them, the second has their ports"),),
        what="see rosnode list",
        read=ALWAYS,
        why="the node answers, and the roscore has no registration of its ports",
    ),
    ("node", "loopback"): _node(
        1, "on {place} {what}, an address at which no other computer reaches it", "a node announces 127.0.0.1"
    ),
    ("node", "address"): _node(
        2,
        "on {place} {what}, which is no address of its robot: an old one, or that of another computer; so other robots do not take it",
        "a node announces another address",
        START_AGAIN,
        change("or add the address to multimaster_allow, if it is that of a laptop"),
        site_of_all(),
    ),
    ("node", "interface"): _node(
        3,
        "on {place} {what}, an address at which other robots do not reach it, so they do not take it",
        "a node announces the address of another interface",
    ),
    ("node", "name"): _node(
        4,
        "on {place} {what}, which is no planned name of its robot, so other robots do not take it",
        "a node announces another name",
    ),
    ("node", "services"): _node(
        5, "on {place} {what}, so its services are looked for on another computer", "a node announces two computers"
    ),
    ("node", "robot"): _node(
        6,
        "on {place} {what}, so the nodes of its own robot do not know it",
        "a node uses the roscore of another robot",
        look=MASTER_LOOK,
    ),
    ("node", "master"): _node(
        7,
        "on {place} {what}, which is not the roscore of its robot, so its robot does not know it",
        "a node uses another roscore",
        look=MASTER_LOOK,
    ),
    ("node", "network"): _node(
        0,
        "on {place} {what}, and is in a network of its own, as a container is without --network host: no connection to {place} reaches it",
        "a node announces its computer",
        hand(
            "end it, and start it again in the network of {place}: a container with --network host (compose: network_mode: host), a unit without "
            "PrivateNetwork"
        ),
        look=(on("ss -ltnp; lsns -t net", "the first lists no port of the node"),),
    ),
    ("node", "fenced"): _node(
        9,
        "{what} on {place} takes no connections of other computers: a packet filter drops those to its ports",
        "a node",
        hand("let all TCP ports above 1024 of {place} pass, since ROS takes any of them for a node"),
        look=(RULES, on("ss -ltnp")),
    ),
    ("node", "hung"): _node(
        8,
        "on {place} {what} takes connections and does not answer: it hangs, or a signal or a debugger has stopped it",
        "a node",
        HUNG_DO,
        look=(HUNG_LOOK,),
    ),
}

REGISTRATIONS: Mapping[Key, Fault] = {
    ("registration", "ghost"): Fault(
        "RF-521",
        "the roscore of {place} holds nodes that do not answer: {what}; they ended without saying so, as by kill -9",
        do=(on("yes | rosnode cleanup", "takes out those that do not answer; end a node that hangs first"),),
        look=(on("rosnode ping --all"),),
        what="see rosnode ping --all",
        why="other failures look so, too",
    ),
    ("registration", "twin"): Fault(
        "RF-522",
        "one name is used twice on {place}: {what}; a roscore holds only one of a name, so that of the other robot does not cross, and its topics do not",
        do=(
            NAMESPACE,
            hand(
                "or start it with another name: __name:=... (of topics that both publish, RF-531, a namespace alone makes two)"
            ),
            change("or leave it out by multimaster_exports or multimaster_filters"),
            site_of_all(),
        ),
        look=(Advice(MASTERS, "rosnode list"),),
        what="see rosnode list",
        why="both roscores were compared",
        at=ROBOTS,
    ),
    ("registration", "talker"): Fault(
        "RF-523",
        "the talker of the verification on {place} does not run, or has not registered: {what}",
        do=(verify_again("starts a talker that lives longer, as many computers need it", "-e verify_lifetime=600"),),
        look=(on("journalctl -n 50 -u multimaster-verify-talker"),),
        cost=3.5,
        why="it is started only for this run",
        what="rostopic pub fails there",
    ),
    ("registration", "listener"): Fault(
        "RF-524",
        "the subscriber of the verification on {place} gave no result: {what}",
        do=(verify_again("waits longer, as many computers need it", "-e verify_patience=60"),),
        look=(on("timeout 5 rostopic echo -n 1 /rosout"),),
        cost=3.5,
        why="it is started only for this run",
        what="rospy fails there",
    ),
    ("registration", "untold"): Fault(
        "RF-525",
        "nodes on {place} do not hear of new publishers: its roscore has them, and does not reach the nodes there",
        do=(
            site_of_all("writes the name {place} on the computer of the roscore"),
            hand("let the computer of the roscore reach TCP ports from 1024 up on {place}"),
        ),
        look=(Advice("the computer of its roscore", "getent ahostsv4 {place}; ping -c 1 {place}"), RULES),
        read=ALWAYS,
        why="the roscore was asked, and then the nodes",
    ),
    ("registration", "closed"): Fault(
        "RF-526",
        "a node on {place} announces a port for its topic, and no connection to that port opens",
        do=(
            hand(
                f"accept TCP ports 1024 to 65535 from the robots' networks on {{place}}, {MAKERS}: nodes have any of them"
            ),
        ),
        look=(RULES,),
        read=ALWAYS,
        why="the connection was tried",
    ),
    ("registration", "mute"): Fault(
        "RF-527",
        "a node on {place} takes connections and says nothing: {what}; it hangs, or a signal or a debugger has stopped it",
        do=(verify_again("starts another talker"),),
        look=(HUNG_LOOK,),
        what="a node",
        read=ALWAYS,
        why="the connection was tried",
    ),
    ("registration", "link"): Fault(
        "RF-528",
        "nodes on {place} are connected though nothing is exchanged between them: {what}",
        do=(hand("end these nodes, and start them again"),),
        look=(Advice(MASTERS, "rosnode info {nodes}"),),
        what="see rosnode info",
        why="the kernel's connections were compared with the plan",
        at=ROBOTS,
    ),
    ("topic", "shared"): Fault(
        "RF-531",
        "nodes of {place} publish the same topics, and a subscriber of the one hears the other, too: {what}",
        do=(
            NAMESPACE,
            change(
                "or leave the topic out by multimaster_exports or multimaster_filters; if it is meant, write its whole name into those "
                "of both"
            ),
            site_of_all(),
        ),
        look=(Advice(MASTERS, "rostopic info {topic}"),),
        what="see rostopic info",
        why="both roscores were compared",
        at=ROBOTS,
    ),
    ("topic", "circle"): Fault(
        "RF-532",
        "ros1_bridge runs on {place}, and messages go round in a circle by both bridges: {what}",
        do=(
            hand("run one bridge for both robots, or give the bridged topics a namespace of each robot"),
            change("or leave them out by multimaster_exports or multimaster_filters"),
            site_of_all(),
        ),
        look=(Advice(MASTERS, "rosnode info {nodes}"),),
        what="see rosnode info",
        why="both bridges were seen",
        at=ROBOTS,
    ),
    ("time", "simulated"): Fault(
        "RF-551",
        "the nodes of {place} have simulated time, and those of other robots do not: {what}; so each takes the messages and tf of the other for "
        "very old or from the future",
        do=(
            Advice(
                "the masters of all robots",
                "rosparam set /use_sim_time false",
                "or true on all of them, before their nodes start",
            ),
            change(
                "or leave /clock and the topics of the simulation out by multimaster_exports or multimaster_filters"
            ),
            site_of_all(),
        ),
        look=(on("rosparam get /use_sim_time; rostopic info /clock"),),
        what="see /use_sim_time",
        read=ALWAYS,
        why="the parameters of all roscores were compared",
    ),
    ("time", "stopped"): Fault(
        "RF-552",
        "the nodes of {place} wait for a simulated time that does not come: /use_sim_time is true, and nobody publishes /clock",
        do=(
            hand("start the simulation, or rosbag play --clock"),
            on("rosparam set /use_sim_time false", "without a simulation; then end the nodes, and start them again"),
        ),
        look=(on("rosparam get /use_sim_time; rostopic info /clock"),),
        read=ALWAYS,
        why="the parameter and the publishers were read",
    ),
    ("stranger", "present"): Fault(
        "RF-541",
        "{what} at {place} is no computer of the inventory, and uses the group and port of this fleet",
        do=(
            change("add {place} to multimaster_allow, or its computer to the inventory, if it is one of yours"),
            change("or set another multimaster_multicast_group or multimaster_multicast_port for this fleet"),
            site_of_all(),
        ),
        look=(Advice("a computer of the fleet", "ip neighbour show {place}"),),
        what="a program",
        why="its datagrams were heard",
        at=("ADDRESS",),
    ),
}
