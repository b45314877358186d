# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The observations of a verification on its own computer: services, the next boot, changes, and limits."""

import typing

from .fields import Struct, field


class RefusedName(Struct):
    """A name of another robot that a sync node refuses, and why."""

    name: str = field("The name of the node, service, topic or parameter.", "/odom_pub", needed=True)
    kind: str = field(
        "Why, V(node) or V(service) if the name is taken here, V(type) if the topic has another type here, V(place) if no node of that "
        "robot can be there, V(parameter) if it is not copied.",
        "place",
    )
    there: str = field(
        "The URI of the node or service there, or the type of the topic there; empty for a parameter.",
        "http://127.0.0.1:41233/",
    )
    master: str = field("The name of its master.", "kobuki2computer")
    here: str = field("The same here, or why it is refused.", "it is on this computer itself")


class ServiceState(Struct):
    """A systemd service of the collection; `differing` is None if its process cannot be looked at."""

    name: str = field("The service.", "discovery", needed=True)
    unit: str = field("Its unit.", "multimaster-discovery.service", needed=True)
    load_state: str = field("C(LoadState) of systemd.", "loaded")
    active_state: str = field("C(ActiveState) of systemd.", "active")
    sub_state: str = field("C(SubState) of systemd.", "running")
    restarts: int = field("How often systemd had to start it again by itself.", 0)
    differing: typing.Optional[typing.Tuple[str, ...]] = field(
        "The variables of O(environment_file) and of O(variables) that its running process has with another value, or not at all. Null "
        "if the process cannot be looked at.",
        [],
        default=(),
    )
    drop_ins: typing.Tuple[str, ...] = field(
        "The drop-in files of its unit that set, or take away, a variable that differs.",
        [],
    )
    command_drop_ins: typing.Tuple[str, ...] = field(
        "The drop-in files of its unit with another command. One that only runs the same command by another program, such as nice(1), "
        "is left out.",
        [],
        added="1.1.0",
    )
    since: str = field(
        "C(StateChangeTimestamp) of systemd, the time of its last change of state, empty if it never ran.",
        "Sun 2026-11-22 09:12:44 UTC",
    )
    stopped: bool = field(
        "Whether its process is stopped by a signal or a debugger, so that it runs and does nothing.", False
    )
    refused: typing.Tuple[str, ...] = field(
        "The names of other robots that this service refuses, as master_sync reports them to systemd.", []
    )
    refusals: typing.Tuple[RefusedName, ...] = field(
        "The same names with the reasons, 50 at most; a master_sync of an older release reports none.",
        added="1.1.0",
    )
    age_s: typing.Optional[float] = field(
        "The seconds since its last start, by a clock of this computer that nobody steps, or null.", 86400.5
    )
    open_files: typing.Optional[int] = field(
        "How many files its process with the fewest left has open, or null if it cannot be looked at.", 18
    )
    most_files: typing.Optional[int] = field(
        "How many files this process may have open (C(RLIMIT_NOFILE)), or null.", 1024
    )
    result: str = field(
        "How it ended last, if systemd has started it again, or it has failed. C(Result) of systemd, such as V(oom-kill), V(signal) "
        "or V(exit-code), or V(watchdog) if multimaster-watchdog.service has ended it. Empty if nothing is known.",
        "",
        added="1.1.0",
    )
    status: typing.Optional[int] = field(
        "The exit status of its process then, or the number of the signal that ended it, or null.",
        added="1.1.0",
    )


class BootDeviation(Struct):
    """Something that will not be as planned after the next boot."""

    kind: str = field(
        "V(unit) for a service, V(sysctl) for a kernel setting, V(route), or V(names) for C(/etc/hosts).",
        "sysctl",
        needed=True,
    )
    name: str = field("The unit, the setting, the route or the file.", "net.ipv4.ip_forward", needed=True)
    expected: str = field("The planned value.", "1")
    found: str = field("The value by the files of this computer.", "/etc/sysctl.d/99-local.conf line 3 sets 0")
    file: str = field("The file that decides; empty if none does.", "/etc/sysctl.d/99-local.conf line 3")
    when: str = field(
        "The time of the last change of this file, or an empty text without a file.", "2026-11-22 09:12:44 UTC"
    )


class RecentChange(Struct):
    """A file that was changed, or a service that was started, and when."""

    about: str = field(
        "The subject of its decision, V(names), the V(order) of name services, the rules of V(ufw), V(firewalld), V(docker), V(libvirtd) or "
        "V(fail2ban), or those of a table of nftables, such as V(table inet filter).",
        "names",
        needed=True,
    )
    what: str = field("The file or the service.", "/etc/hosts", needed=True)
    how: str = field("V(was changed) or V(was started).", "was changed", default="was changed")
    when: str = field("The time, of a service as systemd writes it.", "2026-11-22 09:12:44 UTC")


class Disk(Struct):
    """The room for an ordinary user on the disks of services; None if the file system does not count it."""

    path: str = field("The first of the folders on it.", "/var/lib", needed=True)
    free_bytes: typing.Optional[int] = field("Bytes.", 5368709120)
    free_files: typing.Optional[int] = field("Files, or null if the file system does not count them.", 300000)


class FileLimit(Struct):
    """A process of ROS that may have very many files open."""

    node: str = field("The name of the node, or of its program.", "amcl", needed=True)
    limit: int = field("The files that it may open (the soft limit).", 1073741816, needed=True)
    unit: str = field(
        "The systemd service that has started it, or empty, as for a node that was started in a shell or a container.",
        "robot.service",
    )
    person: str = field(
        "The user whose own manager has this unit (C(systemctl --user)); empty for a unit of the computer.",
        "",
        added="1.1.0",
    )


class FullProcess(Struct):
    """A process that has as many files open as it may, or one fewer: it takes no connection more."""

    name: str = field("The name of the node in its command line, or its program.", "rosbridge_websocket", needed=True)
    pid: int = field("The number of the process.", 4711, needed=True)
    unit: str = field("The unit of systemd in which it runs, or empty.", "robot.service")
    open_files: int = field("How many files it has open.", 1024)
    most_files: int = field("How many it may have open (C(RLIMIT_NOFILE)).", 1024)
    person: str = field(
        "The user whose own manager has this unit (C(systemctl --user)); empty for a unit of the computer.",
        "",
        added="1.1.0",
    )


class NodeHost(Struct):
    """A process of ROS that announces a host which the plan does not have for its computer, uses another roscore, is stopped, or is apart."""

    host: str = field("The host, or empty if it is not known.", "127.0.0.1", needed=True)
    source: str = field(
        "The variable or argument that has decided it (C(ROS_HOSTNAME), C(ROS_IP), C(__hostname), C(__ip)), or C(hostname).",
        "ROS_IP",
    )
    unit: str = field("The unit of systemd in which the process runs, or empty.", "session-4.scope")
    ports: typing.Tuple[int, ...] = field("The TCP ports on which the process listens.", [41233, 46011])
    node: str = field("The name of the node in its command line, or its program.", "odom_pub")
    master: str = field("The URI of the roscore that it uses, if that is not the planned one; else empty.", "")
    starter: str = field("Its starter, V(shell), V(unit), V(launch) for roslaunch, or V(container).", "shell")
    launch: str = field("The name of the launch file, or empty.", "")
    of_unit: bool = field(
        "Whether its unit gives the variables that are not as planned; False if a script or a command line of the unit does.",
        False,
    )
    stopped: bool = field("Whether it is stopped by a signal or a debugger.", False)
    readable: bool = field("Whether its environment can be read; in some containers root may not.", True, default=True)
    apart: bool = field(
        "Whether it is in a network of its own, as a container of a bridge is: its ports are not there on the computer.",
        False,
    )
    master_source: str = field(
        "The variable or argument that has decided this roscore, C(ROS_MASTER_URI) or C(__master); empty if the roscore is the planned one.",
        "",
        added="1.1.0",
    )
    person: str = field(
        "The user whose own manager has this unit (C(systemctl --user)); empty for a unit of the computer.",
        "",
        added="1.1.0",
    )
    pid: int = field("The number of the process.", 2314)
    topics: typing.Tuple[str, ...] = field(
        "Some topics that it publishes, of a node without a registration alone, 4 at most.", ["/battery"]
    )


class UnregisteredNodes(Struct):
    """The nodes on a computer that are registered at no roscore, though they use the planned one."""

    nodes: typing.Tuple[NodeHost, ...] = field("The processes that answer as nodes do, as RV(node_hosts).")
    unknown: int = field(
        "How many processes of ROS listen, and have no port that is registered. Some programs are no nodes.", 1
    )
    asked: int = field(
        "How many of them were asked whether they are nodes. Of more than 48, one of every so many is.", 1
    )


class ContainerNames(Struct):
    """A container whose /etc/hosts is older than the names of the fleet."""

    node: str = field("A process there, by the name of its node or of its program.", "rosmaster", needed=True)
    unit: str = field("The unit of systemd that has the container, or empty.", "docker-0badcafe.scope")
    missing: typing.Tuple[str, ...] = field("The names.", ["kobuki2computer"])
