# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The findings of multimaster_info on ROS: installations, and roscores that run."""

import typing

from .fields import Struct, field


class RosNode(Struct):
    """An executable of ROS that was looked for."""

    package: str = field("The ROS package.", "fkie_master_discovery")
    executable: str = field("The executable.", "master_discovery")
    path: str = field(
        "Its path, empty if it was not found.", "/opt/ros/noetic/lib/fkie_master_discovery/master_discovery"
    )
    problem: str = field("Why an unprivileged user could not run it, or empty.", "")
    lacks: typing.Tuple[str, ...] = field("Those of its programs that are not in the PATH of ROS.", ["screen"])


class RosInstallation(Struct):
    """An installation of ROS."""

    kind: str = field(
        "V(prefix) below C(/opt/ros), V(workspace) for another set-up file, V(debian) for Debian's packages.", "prefix"
    )
    setup: str = field("The set-up file, empty for Debian's packages, which need none.", "/opt/ros/noetic/setup.bash")
    distro: str = field("The distribution of ROS, V(debian) for Debian's packages.", "noetic")
    version: str = field("V(1) or V(2). A ROS 2 is never chosen.", "1")
    python: str = field(
        "The interpreter that ROS is used with, that of the prefix if the prefix has one of its own, as those of conda have.",
        "/usr/bin/python3",
    )
    python_version: str = field("The version of that interpreter, empty if it was not asked.", "3.8.10")
    environment: typing.Dict[str, typing.Any] = field(
        "The variables that the set-up file makes; of C(PATH) only the entries that it adds.",
        {"ROS_DISTRO": "noetic", "PATH": "/opt/ros/noetic/bin"},
    )
    for_root: typing.Dict[str, typing.Any] = field(
        "The variables that root may have. If not only root may change the set-up file and the folders of its lists, they are those of the "
        "set-up file below C(/opt/ros) on which the workspace is built, and none if it is built on none, or if others than root may change "
        "that one, too.",
        {"ROS_DISTRO": "noetic", "PATH": "/opt/ros/noetic/bin"},
    )
    below: str = field(
        "The set-up file of RV(ros.found[].for_root) if it differs from RV(ros.found[].setup), or empty.", ""
    )
    person: str = field(
        "The user who gets all of RV(ros.found[].environment), V(*) for every user but root, empty for no user. Services get them in "
        "any case.",
        "*",
    )
    doubt: str = field("Why root may not have them, in a few words, or empty.", "/home/robot belongs to robot")
    left_out: typing.Tuple[str, ...] = field(
        "Variables that no process gets, and entries of lists that are not absolute, or have C(;), C($), a quote or a backslash.",
        ["LD_PRELOAD", "PATH (./bin)"],
    )
    rospy: bool = field("Whether an unprivileged user can import rospy.", True)
    missing: typing.Tuple[str, ...] = field("The needed Python modules that cannot be imported.", [])
    commands: typing.Dict[str, typing.Any] = field(
        "The paths of the commands C(roscore), C(rostopic) and C(rosservice), each empty if it is not there.",
        {"roscore": "/opt/ros/noetic/bin/roscore", "rostopic": "/opt/ros/noetic/bin/rostopic", "rosservice": ""},
    )
    hooks: str = field(
        "The folder of shell files that the set-up file sources at its end, if only root can change it, or empty.",
        "/opt/ros/noetic/etc/catkin/profile.d",
    )
    hooks_doubt: str = field(
        "Which such folder was passed over and why, in a few words, or empty.",
        "below /home/robot/ws/devel, since /home/robot belongs to robot",
    )
    nodes: typing.Tuple[RosNode, ...] = field(
        "The executables of O(nodes), looked for in the chosen installation only."
    )
    problem: str = field("One sentence about the fault of this installation, or empty.", "")


class RosFacts(Struct):
    """ROS 1 on a machine."""

    problem: str = field(
        "One sentence: no installation can be used, or the chosen one lacks something. Empty if all is well.",
        "",
        default="ROS could not be looked for.",
    )
    chosen: typing.Optional[RosInstallation] = field("The installation to use, one of RV(ros.found), or null.")
    found: typing.Tuple[RosInstallation, ...] = field(
        "The installations that O(ros_setup) may mean, the preferred one first."
    )


class RoscoreProcess(Struct):
    """The process of a roscore."""

    pid: int = field("Its number, 0 if it cannot be seen.", 512)
    command: str = field("Its command line.", "/usr/bin/python3 /usr/bin/rosmaster --core -p 11311")
    user: str = field("The user who owns the socket.", "robot")
    unit: str = field("Its systemd unit, empty if it has none.", "roscore.service")
    container: bool = field("Whether it runs in a container.", False)


class DiscoveredMaster(Struct):
    """A master that a discovery node lists."""

    name: str = field("The name of the master.", "kobuki2computer")
    uri: str = field("The URI of its roscore.", "http://kobuki2computer:11311/")
    online: bool = field("Whether it is heard.", True)
    discoverer_name: str = field("The name of its discovery node.", "/master_discovery")
    monitoruri: str = field("The URI at which its discovery node answers.", "http://192.168.1.239:11611")


class RegisteredDiscovery(Struct):
    """A discovery node that is registered with a roscore."""

    node: str = field("The name of the node.", "/master_discovery")
    service: str = field("The name of its service.", "/master_discovery/list_masters")
    implementation: str = field(
        "V(bundled), V(upstream) for multimaster_fkie, or V(fkie_mas) for its successor, by the type of its service. Empty "
        "if it does not answer at RV(masters[].discovery[].uri).",
        "upstream",
    )
    uri: str = field(
        "The URI at which it answers other robots, empty if it does not list its own master.",
        "http://192.168.1.229:11611",
    )
    group: str = field(
        "Its multicast group, as its parameter at the roscore says; empty if that is not set.", "226.0.0.0"
    )
    group_port: int = field(
        "The UDP port of the heartbeats, as its parameter at the roscore says; 0 if that is not set.", 11511
    )
    masters: typing.Tuple[DiscoveredMaster, ...] = field("The masters that it lists, its own among them.")
    error: str = field("Why it did not list its masters, or empty.", "")


class SyncImport(Struct):
    """The registrations that a sync node has made for another master."""

    master: str = field("The URI of that master's roscore.", "http://kobuki2computer:11311/")
    nodes: int = field("How many of its nodes.", 3)
    topics: int = field("How many of its topics.", 5)
    services: int = field("How many of its services.", 8)


class RegisteredSync(Struct):
    """A sync node that is registered with a roscore."""

    node: str = field("The name of the node.", "/master_sync")
    service: str = field("The name of its service.", "/master_sync/get_sync_info")
    implementation: str = field(
        "V(bundled), V(upstream) or V(fkie_mas). The bundled one writes the parameter C(/rosfleet_multimaster/imports).",
        "upstream",
    )
    imports: typing.Tuple[SyncImport, ...] = field("Its registrations for each other master.")
    error: str = field("Why it did not list them, or empty.", "")


class RunningMaster(Struct):
    """A roscore that listens on a machine."""

    port: int = field("The TCP port on which it listens.", 11311)
    process: RoscoreProcess = field("The process that has the port open, as far as this user may see it.")
    uri: str = field("The URI by which the roscore calls itself.", "http://kobuki1computer:11311/")
    pid: int = field("The process number that the roscore reports.", 512)
    run_id: str = field(
        "The parameter C(/run_id), another one for each start of a roscore; empty if it is not set.",
        "2bb5b2a4-e5e1-11f1-8d6a-0242c0a801e5",
    )
    rosdistro: str = field("The parameter C(/rosdistro), empty if it is not set.", "noetic")
    rosversion: str = field("The parameter C(/rosversion), empty if it is not set.", "1.15.15")
    nodes: int = field("How many nodes are registered with a topic or a service, those of other robots included.", 7)
    topics: int = field("How many topics have a publisher or a subscriber.", 12)
    services: int = field("How many services are registered.", 30)
    discovery: typing.Tuple[RegisteredDiscovery, ...] = field(
        "The robot's own discovery nodes, known by a service C(list_masters) in any namespace; eight at most."
    )
    sync: typing.Tuple[RegisteredSync, ...] = field(
        "The robot's own sync nodes, known by a service C(get_sync_info) in any namespace; eight at most."
    )
    error: str = field(
        "Why the roscore gave no answer, or empty. If something else than a roscore answers on a port, there is no entry.",
        "",
    )
