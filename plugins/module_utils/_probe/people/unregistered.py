# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The nodes on this computer that are registered at no roscore: they run, answer, and no other node knows them.

A roscore that is started anew knows no node of before, and rospy and roscpp register only once. So such a node is silent until a
person starts it again. Nothing is asked where each process of ROS that listens has a registered port, which is the usual case.
A program without a sign of a node is never asked: one that takes a single connection, such as gdbserver, would lose it.
"""

import os
import time
import typing

from ..._base import processes
from ..._base.commands import text
from ..._base.deadlines import call_all
from ..._base.plain_text import LONGEST, plain
from ..measure.exchange import node_uris
from ..ros_client.documents import NODE
from ..ros_client.hosts import place_of
from ..ros_client.node_hosts import Members, Row
from ..ros_client.ros import CALLER, Ros
from ..ros_client.xml_rpc import server
from .node_processes import Planned, Process, Sockets, Units, describe, list_processes

LEAST_AGE = 30.0  # seconds; a younger process may be about to register
MOST_ASKED = 48  # processes that are asked; of more, one of every so many
MOST_PORTS = 4  # of a process: a node has two
ANSWERS = 0.5  # seconds for the answer of one port on this computer
LONGEST_ROUND = 5.0  # seconds for all of them
SETTLES = 2.0  # seconds in which a node that found its roscore just now has registered
MOST_TOPICS = 4
ROSOUT = "/rosout"  # each node publishes it
ROSCPP = "libroscpp"  # the library of a node in C++
LOGS = "/.ros/log/"  # the folder where a node in Python keeps a file open (rosgraph.roslogging)
_MOST_MAPS = 4 << 20  # bytes of /proc/PID/maps
_MOST_FILES = 4096  # of a process, that are looked at

Listening = typing.List[typing.Tuple[Process, typing.List[int]]]  # processes with their ports


def find_unregistered(ros: Ros, members: Members, own: str, master: str, proc: str = "/proc") -> Row:
    """Find the nodes with the planned roscore that are registered nowhere in it; none without an answer of the roscore.

    A port that is registered for any host counts as registered: a node may announce a wrong host, which has a finding of its own.
    """
    planned = Planned(list(members), own, master)
    found: Row = {"nodes": [], "unknown": 0, "asked": 0}
    listening = list(_list_listening(planned, proc)) if master and planned.is_master(ros.uri) else []
    unknown = _leave_out_registered(listening, ros)
    if not unknown:
        return found
    asked = unknown[:: -(-len(unknown) // MOST_ASKED)]
    found.update(unknown=len(unknown), asked=len(asked))
    answers = call_all(_ask, [ports for _process, ports in asked], LONGEST_ROUND, lambda ports: None)
    nodes = {tuple(ports): (process, topics) for (process, ports), topics in zip(asked, answers) if topics is not None}
    if nodes:
        time.sleep(SETTLES)
        still = {process.pid for process, _ports in _leave_out_registered(list(_list_listening(planned, proc)), ros)}
        units = Units()
        found["nodes"] = [
            dict(describe(process, planned, list(ports), units, proc), topics=topics)
            for ports, (process, topics) in nodes.items()
            if process.pid in still
        ]
    return found


def _list_listening(planned: Planned, proc: str) -> typing.Iterator[typing.Tuple[Process, typing.List[int]]]:
    """List the processes that are set to use the planned roscore, listen in this network, and are no longer about to register."""
    sockets, latest = Sockets(proc), time.time() - LEAST_AGE
    for process in list_processes(proc):
        try:
            if not process.is_read or not planned.is_master(process.master) or sockets.is_apart(process.pid):
                continue
            ports = sockets.list_ports(process.pid) if _has_sign_of_node(process, proc) else []
            start = processes.start_time(process.pid, proc) if ports else None
        except OSError:  # it has ended
            continue
        if start is not None and start <= latest and not processes.is_stopped(process.pid, proc):
            yield process, ports


def _has_sign_of_node(process: Process, proc: str) -> bool:
    """Return True for a node by its words, its libraries, or its log. Raises OSError if the process has ended."""
    folder = os.path.join(proc, str(process.pid))
    if "__name" in process.arguments or ROSCPP in text(os.path.join(folder, "maps"), _MOST_MAPS):
        return True
    own = (process.variables.get("ROS_LOG_DIR"), process.variables.get("ROS_HOME"))
    logs = tuple(os.path.join(os.path.realpath(one), "") for one in own if one)
    files = os.listdir(os.path.join(folder, "fd"))[:_MOST_FILES]
    return any(path.endswith(".log") and (LOGS in path or path.startswith(logs)) for path in _read_links(folder, files))


def _read_links(folder: str, files: typing.Iterable[str]) -> typing.Iterator[str]:
    for name in files:
        try:
            yield os.readlink(os.path.join(folder, "fd", name))
        except OSError:  # the file was closed meanwhile
            continue


def _leave_out_registered(listening: Listening, ros: Ros) -> Listening:
    """Leave out the processes of which a port is registered; all of them if the roscore does not answer."""
    if not listening:
        return []
    try:
        uris = node_uris(ros, *ros.read_state())
    except OSError:
        return []
    registered = {place_of(uri)[1] for uri in uris.values()}
    return [(process, ports) for process, ports in listening if registered.isdisjoint(ports)]


def _ask(ports: typing.List[int]) -> typing.Optional[typing.List[str]]:
    """Ask for the topics that a node publishes (ROS Slave API); None if no node answers. Neither rosmaster nor roslaunch has this method."""
    for port in ports[:MOST_PORTS]:
        try:
            code, _message, rows = server(f"http://127.0.0.1:{port}/", NODE, ANSWERS).getPublications(CALLER)
            names = [name for name, _type in rows if isinstance(name, str) and name != ROSOUT]
        except Exception:  # any kind, raised by the answer of a strange program
            continue
        if code == 1 and isinstance(rows, list):
            return [plain(name, LONGEST) for name in sorted(names)[:MOST_TOPICS]]
    return None
