# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults of our own services: roscore, discovery, sync, relay, their exchange. Ids RF-4xx."""

from __future__ import annotations

from collections.abc import Mapping

from .fault import ALWAYS, READ, ROBOTS, Advice, Fault, Key, change, hand, on, reinstall, site, site_of_all

DISCOVERY = on("systemctl status multimaster-discovery; journalctl -b -n 50 -u multimaster-discovery")
SYNC = on("systemctl status multimaster-sync; journalctl -b -n 50 -u multimaster-sync")
ROSCORE = on(
    "systemctl status multimaster-roscore; journalctl -b -n 50 -u multimaster-roscore",
    "or the unit of your own roscore",
)
LOG = on("journalctl -b -n 50 -u {what}")
# The nodes are registered at the roscore, and end with it.
RESTART = on(
    "systemctl restart multimaster-roscore multimaster-discovery multimaster-sync",
    "with multimaster_roscore: existing, first start your own roscore again, and leave multimaster-roscore out",
)
RESTART_DISCOVERY = on("systemctl restart multimaster-discovery")
RESTART_SYNC = on("systemctl restart multimaster-sync")
RESTART_UNIT = on("systemctl restart {what}")
UNIT = "multimaster-*"
ENDS = "programs end, and computers are started in another order"

ROSCORES: Mapping[Key, Fault] = {
    ("roscore", "dead"): Fault(
        "RF-401", "no roscore answers on {place}", do=(RESTART,), look=(ROSCORE,), cost=1.5, why=ENDS
    ),
    ("roscore", "sealed"): Fault(
        "RF-402",
        "the roscore on the sealed computer {place} {what}",
        do=(
            hand("switch {place} on, and see that its system starts the roscore"),
            change("set multimaster_sealed to the address of {place} and all its names"),
            site_of_all(),
        ),
        look=(Advice("its companion", "ping -c 2 {place}; ROS_MASTER_URI=http://{place}:11311 rosnode list"),),
        cost=1.5,
        why=ENDS,
        what="does not answer",
    ),
    ("roscore", "hung"): Fault(
        "RF-403",
        "the roscore on {place} runs and does not answer",
        do=(RESTART,),
        look=(ROSCORE,),
        cost=2.4,
        why="a program hangs more seldom than it ends",
    ),
    ("roscore", "name"): Fault(
        "RF-404",
        "the roscore on {place} calls itself {what}",
        do=(
            site("gives it the planned variables"),
            hand(
                "a roscore of your own: set the variables of /etc/rosfleet-multimaster/environment in its unit, and restart it"
            ),
        ),
        look=(on("rosparam get /rosdistro; env | grep ^ROS"),),
        cost=2.0,
        why="a roscore that was started in a shell has the variables of that shell",
        what="otherwise than planned",
        read=READ,
    ),
}

DISCOVERIES: Mapping[Key, Fault] = {
    ("discovery", "dead"): Fault(
        "RF-411",
        "the discovery node of {place} does not run",
        do=(RESTART_DISCOVERY,),
        look=(DISCOVERY,),
        cost=1.5,
        why=ENDS,
    ),
    ("discovery", "hung"): Fault(
        "RF-412",
        "the discovery node of {place} runs and does not answer",
        do=(RESTART_DISCOVERY,),
        look=(DISCOVERY,),
        why="a program hangs more seldom than it ends",
    ),
    ("discovery", "group"): Fault(
        "RF-413",
        "the discovery node of {place} uses another group or port than the others",
        do=(site_of_all("gives all one group and port"),),
        look=(on("ss -lunp | grep python; rosparam get /master_discovery"), DISCOVERY),
        cost=2.8,
        why="the plan gives it to all alike",
    ),
    ("discovery", "port"): Fault(
        "RF-414",
        "the discovery node of {place} does not listen on TCP port {what}",
        do=(site("gives it the planned port"),),
        look=(on("ss -ltnp | grep {what}"), DISCOVERY),
        cost=2.5,
        why="another program that holds the port is rare",
        what="11611",
    ),
    ("discovery", "configuration"): Fault(
        "RF-415",
        "the discovery node of {place} does not serve the planned robot",
        do=(site("writes its parameters, and restarts it"),),
        look=(on("rosparam get /master_discovery"), DISCOVERY),
        cost=3.4,
        why="the plan writes it",
    ),
    ("discovery", "stale"): Fault(
        "RF-416",
        "the discovery node of {place} has not followed its roscore: {what} is registered there, and not in its state",
        do=(RESTART_DISCOVERY,),
        look=(DISCOVERY,),
        what="a topic",
        read=ALWAYS,
        why="its state was compared with the roscore",
    ),
}

SYNCS: Mapping[Key, Fault] = {
    ("sync", "dead"): Fault(
        "RF-421", "the sync node of {place} does not run", do=(RESTART_SYNC,), look=(SYNC,), cost=1.5, why=ENDS
    ),
    ("sync", "hung"): Fault(
        "RF-422",
        "the sync node of {place} runs and registers nothing of the others",
        do=(RESTART_SYNC,),
        look=(SYNC, on("rosservice call /master_sync/get_sync_info")),
        cost=2.6,
        why="a program hangs more seldom than it ends",
    ),
    ("sync", "configuration"): Fault(
        "RF-423",
        "the sync node of {place} takes other topics and services than planned: {what}",
        do=(site("writes its parameters, and restarts it"),),
        look=(
            on("rosparam get /master_sync; rosservice call /master_sync/get_sync_info"),
            hand("docs/operate/providers.md has the limits of upstream's nodes"),
        ),
        cost=3.2,
        why="the plan writes it",
        what="other parameters",
    ),
    ("sync", "limit"): Fault(
        "RF-424",
        "{what} offers more than the 5000 registrations that the sync node of {place} takes of one master",
        do=(
            change("leave out the topics that nobody needs, by multimaster_exports or multimaster_filters"),
            site_of_all(),
        ),
        look=(SYNC,),
        what="a master",
        why="few robots have so many topics",
    ),
    ("sync", "untold"): Fault(
        "RF-425",
        "the sync node of {place} does not report its registrations",
        do=(RESTART_SYNC,),
        look=(on("rosservice call /master_sync/get_sync_info"), SYNC),
        why="its service answers as long as it runs",
    ),
    ("sync", "stale"): Fault(
        "RF-426",
        "the sync node of {place} has not followed the changes of {what}, which are given to it and are not registered",
        do=(RESTART_SYNC,),
        look=(
            SYNC,
            on("nft list ruleset | grep -nE 'skuid|skgid|cgroup'", "a packet filter may have rules for its user alone"),
        ),
        cost=2.5,
        what="another master",
        read=ALWAYS,
        why="its registrations were compared with those that the other gives",
    ),
    ("sync", "refuses"): Fault(
        "RF-427",
        "the sync node of {place} refuses {what}, since the name is taken, or the type or the place is another one",
        do=(
            hand(
                "its log says which of these it is: rename one of the two, or start the node on a computer of its robot"
            ),
        ),
        look=(SYNC,),
        what="a registration",
        read=ALWAYS,
        why="it says so",
    ),
    ("sync", "objects"): Fault(
        "RF-428",
        "the sync node of {place} refuses {what}",
        do=(
            hand(
                "change the nodes that it names: give one of the two another name, install the same version of the message package on both, or start the node "
                "on a computer of its robot (a laptop belongs into multimaster_allow)"
            ),
        ),
        look=(SYNC,),
        what="a registration",
        read=ALWAYS,
        why="it says so",
    ),
}

UNITS: Mapping[Key, Fault] = {
    ("service", "down"): Fault(
        "RF-431", "{what} does not run on {place}", do=(RESTART_UNIT,), look=(LOG,), cost=2.0, what=UNIT, why=ENDS
    ),
    ("service", "stopped"): Fault(
        "RF-432",
        "the process of {what} on {place} is stopped, by a signal or a debugger, so it runs and does nothing",
        do=(on("systemctl kill --signal=CONT {what}"),),
        look=(on("systemctl status {what}; ps -eo pid,stat,args | awk '$2 ~ /T/'"),),
        cost=2.0,
        what=UNIT,
        read=ALWAYS,
        why="the state of the process was read",
    ),
    ("service", "full"): Fault(
        "RF-433",
        "{what} on {place} has as many files open as it may, so it takes no new connection",
        do=(RESTART_UNIT,),
        look=(
            on(
                "systemctl show --property MainPID,LimitNOFILESoft {what}; ss -tnp | grep -c $(systemctl show --value --property MainPID {what})"
            ),
        ),
        cost=2.0,
        what=UNIT,
        read=ALWAYS,
        why="its open files were counted",
    ),
    ("service", "restarting"): Fault(
        "RF-434",
        "on {place} {what} ended and was started again",
        do=(hand("nothing, if it was you, or if it runs now; else the log of {what} says why it ended"),),
        look=(LOG,),
        hard=False,
        what=UNIT,
        why="systemd says so",
    ),
    ("service", "looping"): Fault(
        "RF-435",
        "on {place} systemd starts {what} again and again, and in vain",
        do=(site("writes the unit anew, with its needs"),),
        look=(LOG, on("systemctl cat {what}")),
        cost=2.0,
        what=UNIT,
        read=READ,
        why="systemd says so",
    ),
    ("service", "missing"): Fault(
        "RF-436",
        "{what} was not set up on {place}",
        do=(site("sets it up"),),
        look=(on("systemctl cat {what}"),),
        cost=1.0,
        what=UNIT,
        read=READ,
        why="systemd does not know it",
    ),
    ("environment", "service"): Fault(
        "RF-437",
        "services of {place} run with another environment than planned: {what}",
        do=(site("restarts them with the planned one"),),
        look=(
            on(
                "systemctl show --property Environment,EnvironmentFiles,DropInPaths multimaster-roscore multimaster-discovery"
            ),
        ),
        cost=2.0,
        what="the variables of ROS",
        read=READ,
        why="a drop-in, or a restart that is due",
    ),
}

EXCHANGE: Mapping[Key, Fault] = {
    ("parameter", "copy"): Fault(
        "RF-441",
        "parameters that cross are not the same on {place}: {what}",
        do=(
            Advice(
                "the master of the robot that gets it",
                "for name in {parameter}; do rosparam delete $name; done",
                "if it has a value of its own; sync brings the other one",
            ),
            change("or take the name out of multimaster_exports"),
            site_of_all(),
        ),
        look=(Advice("the master of the robot that gets it", "journalctl -b -n 50 -u multimaster-sync"),),
        what="see multimaster_exports",
        read=ALWAYS,
        why="both values were compared",
        at=ROBOTS,
    ),
    ("relay", "lacking"): Fault(
        "RF-442",
        "the relay does not take across between {place}: {what}",
        do=(Advice("both masters", "systemctl restart multimaster-relay"),),
        look=(Advice("both masters", "journalctl -b -n 50 -u multimaster-relay; rosnode info /master_relay"),),
        what="see multimaster_exports",
        read=ALWAYS,
        why="both roscores were compared",
        at=ROBOTS,
    ),
    ("relay", "configuration"): Fault(
        "RF-446",
        "the relay of {place} takes other topics or services across than the inventory says: {what}",
        do=(site("writes its parameters: a run with another --limit has left it out"),),
        look=(on("cat /etc/rosfleet-multimaster/master_relay.json"),),
        what="see its parameters",
        read=ALWAYS,
        why="its parameters were compared",
    ),
    ("relay", "mute"): Fault(
        "RF-447",
        "no data comes through the relay of {place}, though all is registered: {what}",
        do=(on("systemctl restart multimaster-relay"),),
        look=(
            on("journalctl -b -n 50 -u multimaster-relay; ss -tnp | grep -c python"),
            hand("rostopic hz of that topic on the robot itself: its node may say nothing there, too"),
        ),
        cost=2.5,
        what="see multimaster_exports",
        why="a topic was heard through both relays, as a node hears it",
    ),
    ("declaration", "narrow"): Fault(
        "RF-443",
        "{place} leaves out topics that the others need: {what}",
        do=(change("add it to multimaster_exports of {place}, or take it out of multimaster_filters"), site()),
        look=(Advice("the master of {place}", "rosparam get /master_discovery; rosparam get /master_sync"),),
        what="see multimaster_exports",
        read=READ,
        why="the inventory was compared with the needed one",
        at=ROBOTS[:1],
    ),
    ("messages", "differ"): Fault(
        "RF-444",
        "message definitions differ on {place}: {what}",
        do=(hand("install the same version of the message package on both, or give one of the topics another name"),),
        look=(Advice("the masters of {place}", "rostopic type {topic}; rosmsg md5 {type}"),),
        what="see rosmsg md5",
        why="both sums were compared",
        at=ROBOTS,
    ),
    ("messages", "unknown"): Fault(
        "RF-445",
        "the Python of ROS on {place} does not list the classes of its message types: {what}",
        do=(reinstall("*-std-msgs", "or the package that the look misses"),),
        look=(on("rosmsg md5 std_msgs/String; python3 -c 'import std_msgs.msg'"),),
        what="rospy fails there",
        why="a question to it fails",
    ),
}

SERVICES: Mapping[Key, Fault] = {**ROSCORES, **DISCOVERIES, **SYNCS, **UNITS, **EXCHANGE}
