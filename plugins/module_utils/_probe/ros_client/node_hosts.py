# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The hosts that people's nodes announce: in their URIs at the roscore, and by the environment of their processes here."""

import os
import socket
import typing

from ..._base import processes
from ..._base.commands import text
from ..._base.plain_text import LINE, plain
from ..._machine import ports
from .node_services import read_host

MOST = 100  # nodes and processes that are reported
#: what decides the host that a node announces, the first before the others (rosgraph.network, ros::network::init)
_ARGUMENTS = ("__hostname", "__ip")
_VARIABLES = ("ROS_HOSTNAME", "ROS_IP")

Row = typing.Dict[str, typing.Any]
Members = typing.Iterable[typing.Dict[str, typing.Any]]


def list_hosts(members: Members, keep: typing.Callable[[typing.Dict[str, typing.Any]], bool]) -> typing.Set[str]:
    """List the planned names and addresses of the members that are kept, in small letters."""
    return {
        text.lower()
        for member in members
        if keep(member)
        for text in (member["name"], member["address"], member["discovery_address"])
        if text
    }


def announced(
    nodes: typing.Dict[str, str], members: typing.Sequence[typing.Dict[str, typing.Any]], own: str
) -> typing.List[Row]:
    """List the nodes ({node: URI}) that announce a host which is not a planned one of the own computer's robot: node, host, port."""
    robots = {member["robot"] for member in members if member["name"] == own}
    planned = list_hosts(members, lambda member: member["robot"] in robots)
    found = []
    for node, uri in sorted(nodes.items()):
        host = read_host(uri)
        if host and host not in planned:
            found.append({"node": node, "host": host, "port": _read_port(uri)})
    return found[:MOST]


def _read_port(uri: str) -> int:
    digits = uri.rstrip("/").rpartition(":")[2]
    return int(digits) if digits.isdigit() and len(digits) <= 5 else 0


def node_hosts(members: Members, own: str, proc: str = "/proc") -> typing.List[Row]:
    """List processes of ROS on this computer that announce a host which is not a planned name or address of this computer.

    A process of ROS has ROS_MASTER_URI, or the name of a node among its words, and listens, as each node does. Of its
    environment only the host is returned.
    """
    planned = list_hosts(members, lambda member: member["name"] == own)
    sockets = {entry.inode: entry.port for entry in ports.read_sockets("tcp", proc) if entry.state == ports.LISTEN}
    found = []
    for pid in sorted(int(name) for name in os.listdir(proc) if name.isdigit()):
        try:
            row = _look(pid, planned, sockets, proc)
        except OSError:  # it has ended, or root in a container may not look at it
            continue
        if row is not None:
            found.append(row)
        if len(found) == MOST:
            break
    return found


def _look(pid: int, planned: typing.Set[str], sockets: typing.Dict[str, int], proc: str) -> typing.Optional[Row]:
    words = text(os.path.join(proc, str(pid), "cmdline"), 65536).split("\0")
    arguments = dict(word.partition(":=")[::2] for word in words if word.startswith("__"))
    variables = processes.environment(pid, proc)
    if "__name" not in arguments and "ROS_MASTER_URI" not in variables:
        return None
    host, source = _find_host(arguments, variables, pid, proc)
    if not host or host.lower() in planned:
        return None
    own_ports = sorted({sockets[inode] for inode in ports.list_inodes(pid, proc) if inode in sockets})
    if not own_ports:
        return None
    unit = ports.unit(text(os.path.join(proc, str(pid), "cgroup")))
    return {"host": plain(host.lower(), LINE), "source": source, "unit": unit, "ports": own_ports[:MOST]}


def _find_host(
    arguments: typing.Dict[str, str], variables: typing.Dict[str, str], pid: int, proc: str
) -> typing.Tuple[str, str]:
    """The host that a node announces, and what has decided it; empty for a container with a name of its own."""
    given = [(arguments.get(name), name) for name in _ARGUMENTS] + [(variables.get(name), name) for name in _VARIABLES]
    for host, source in given:
        if host:
            return host, source
    contained = ports.is_contained(text(os.path.join(proc, str(pid), "status")))
    return ("", "") if contained else (socket.gethostname(), "hostname")
