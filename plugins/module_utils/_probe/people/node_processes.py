# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The processes of people's nodes on this computer: the host that they announce, the roscore that they use, and their starters.

Of an environment only ROS_HOSTNAME, ROS_IP and the host and port of ROS_MASTER_URI are reported, and of a command line the node's
name and the name of a launch file: anything else may be a secret.
"""

import os
import re
import socket
import time
import typing
from urllib.parse import urlsplit

from ..._base import processes
from ..._base.commands import run, text
from ..._base.deadlines import stretch
from ..._base.plain_text import LONGEST, is_plain, plain
from ..._machine import ports
from ..ros_client.node_hosts import MOST, Members, Row, list_hosts

LOOPBACK = ("localhost", "localhost.localdomain", "ip6-localhost", "ip6-loopback", "127.0.0.1", "127.0.1.1", "::1")
ROSCORE_PORT = 11311  # of a URI without a port (rosgraph.rosenv)
_MOST_WORDS = 65536  # bytes of a command line
_MOST_PARENTS = 8
UNITS = 20.0  # seconds for all units that systemd is asked for
#: the variables that decide the host that a node announces, the first before the others (rosgraph.network, ros::network::init)
_ARGUMENTS = ("__hostname", "__ip")
_VARIABLES = ("ROS_HOSTNAME", "ROS_IP")
_STARTERS = re.compile(r"(?:user@\d+|sshd?(?:@.*)?|getty@.*|cron)\.service\Z")  # who starts shells
#: units of containers, of which some share the numbers of processes with the computer
_CONTAINERS = re.compile(r"(?:docker|libpod|cri-containerd|crio|nerdctl|lxc|machine)-.*\.scope\Z")
_FILES = re.compile(r"EnvironmentFiles=(/.*) \(ignore_errors=(?:yes|no)\)\Z")  # as systemctl shows one
#: units of the collection: checks of their own look at these
_OURS = re.compile(r"(?:multimaster-[a-z-]+|rosfleet-foreign-[0-9a-f]+)\.service\Z")
_PYTHON = re.compile(r"python[\d.]*\Z")
_FLAGS = ("-u", "-B", "-O", "-s", "-E", "-I")  # of Python, without a value behind them


def node_hosts(members: Members, own: str, master: str = "", proc: str = "/proc") -> typing.List[Row]:
    """List processes of ROS on this computer that are not as planned: the host that they announce, their roscore, or their network; or stopped.

    A process of ROS has ROS_MASTER_URI, or the name of a node among its words, and listens, as each node does. A node whose
    environment cannot be read, as root in a container may not, is listed with the words of its command line.
    """
    members = list(members)
    planned = Planned(members, own, master)
    sockets, units = Sockets(proc), Units()
    found = []
    for process in list_processes(proc):
        try:
            row = _look(process, planned, sockets, units, proc)
        except OSError:  # it has ended
            continue
        if row is not None:
            found.append(row)
        if len(found) == MOST:
            break
    return found


class Process(typing.NamedTuple):
    """A process of ROS that a person has started."""

    pid: int
    words: typing.List[str]  # of its command line
    variables: typing.Dict[str, str]
    is_read: bool  # whether its variables may be read here
    unit: str
    person: str  # whose own manager has this unit; empty for a unit of the computer
    contained: bool

    @property
    def arguments(self) -> typing.Dict[str, str]:
        """The special arguments of a node (__name:=talker), by their names."""
        return dict(word.partition(":=")[::2] for word in self.words if word.startswith("__"))

    @property
    def master(self) -> str:
        """The URI of the roscore that it uses; empty if none is set."""
        return _find_master(self.arguments, self.variables)[0]


def list_processes(proc: str = "/proc") -> typing.Iterator[Process]:
    """List the processes of ROS that are none of the collection: they have ROS_MASTER_URI, or the name of a node among their words."""
    for pid in sorted(int(name) for name in os.listdir(proc) if name.isdigit()):
        try:
            process = _read_process(pid, proc)
        except OSError:  # it has ended
            continue
        if process is not None:
            yield process


def _read_process(pid: int, proc: str) -> typing.Optional[Process]:
    words = _read_words(pid, proc)
    variables, is_read = _read_environment(pid, proc)
    if "ROS_MASTER_URI" not in variables and not any(word.startswith("__name:=") for word in words):
        return None
    groups = text(os.path.join(proc, str(pid), "cgroup"))
    if _OURS.match(ports.unit(groups)):
        return None
    contained = _is_contained(pid, proc)
    return Process(pid, words, variables, is_read, ports.unit(groups), plain(ports.person(groups), LONGEST), contained)


class Planned:
    """The hosts that nodes of this computer may announce, and the roscore that they are to use."""

    def __init__(self, members: typing.Sequence[Row], own: str, master: str) -> None:
        self.hosts = list_hosts(members, lambda member: member["name"] == own)
        self._place, self._port = _read_place(master)
        same = [one for one in members if self._place in list_hosts([one], lambda _member: True)]
        self._masters = {self._place, *list_hosts(same, lambda _member: True)}
        if any(
            member["name"] == own for member in same
        ):  # nodes on the computer of the roscore may call it as they like
            self._masters.update((*LOOPBACK, socket.gethostname().lower()))

    def is_master(self, uri: str) -> bool:
        """Return True if a URI leads to the planned roscore; True also if no roscore is planned, or if the URI cannot be read."""
        host, port = _read_place(uri)
        return not self._place or not host or (host in self._masters and port == self._port)

    def list_wrong(self, host: str, source: str, master: str, master_source: str) -> typing.List[str]:
        """List the variables or arguments that decide a host or a roscore which is not planned; a name of the computer is no variable."""
        wrong = [source] if host and host.lower() not in self.hosts and source != "hostname" else []
        return wrong if self.is_master(master) else [*wrong, master_source]

    def is_usual(self, host: str, master: str) -> bool:
        """Return True if a node with this announced host (empty: it announces no host) and this roscore is as planned."""
        return (not host or host.lower() in self.hosts) and self.is_master(master)


def _read_place(uri: str) -> typing.Tuple[str, int]:
    """Return host and port of the URI of a roscore as rosgraph reads it in the environment of a person; an empty host if the URI cannot be read."""
    try:
        parts = urlsplit(uri)
        return (parts.hostname or "").lower() if is_plain(uri) else "", parts.port or ROSCORE_PORT
    except ValueError:
        return "", 0


class Sockets:
    """The TCP sockets that listen on this computer, and in each network of a container that is asked for: their ports by inode."""

    def __init__(self, proc: str) -> None:
        self._proc, self._own = proc, _find_network(proc, "self")
        self._ports = {self._own: self._read(proc)}

    @staticmethod
    def _read(folder: str) -> typing.Dict[str, int]:
        return {one.inode: one.port for one in ports.read_sockets("tcp", folder) if one.state == ports.LISTEN}

    def list_ports(self, pid: int) -> typing.List[int]:
        """List the ports on which a process listens; empty if this user may not look. Raises OSError if it has ended."""
        try:
            inodes = ports.list_inodes(pid, self._proc)
        except PermissionError:
            return []
        network = _find_network(self._proc, str(pid)) or self._own
        if network not in self._ports:
            self._ports[network] = self._read(os.path.join(self._proc, str(pid)))
        return sorted({self._ports[network][inode] for inode in inodes if inode in self._ports[network]})

    def is_apart(self, pid: int) -> bool:
        """Return True if a process is in another network than this one, as in a container of a bridge; False also if this user may not look."""
        return _find_network(self._proc, str(pid)) not in ("", self._own)


def _find_network(proc: str, pid: str) -> str:
    """Return the name of the network namespace of a process (namespaces(7)); empty if it cannot be read."""
    try:
        return os.readlink(os.path.join(proc, pid, "ns/net"))
    except OSError:
        return ""


def _look(process: Process, planned: Planned, sockets: Sockets, units: "Units", proc: str) -> typing.Optional[Row]:
    pid, is_read = process.pid, process.is_read
    is_stopped, is_apart = processes.is_stopped(pid, proc), sockets.is_apart(pid)
    if is_read and not is_stopped and not is_apart and planned.is_usual(_find_host(process, proc)[0], process.master):
        return None
    own_ports = sockets.list_ports(pid) if is_read else []
    if is_read and not own_ports:
        return None
    return dict(describe(process, planned, own_ports, units, proc), stopped=is_stopped, apart=is_apart)


def describe(process: Process, planned: Planned, own_ports: typing.List[int], units: "Units", proc: str) -> Row:
    """Describe a process, its starter, and what of it is not as planned."""
    arguments, unit = process.arguments, process.unit
    host, source = _find_host(process, proc) if process.is_read else ("", "")
    master, master_source = _find_master(arguments, process.variables)
    starter, launch = _find_starter(process.pid, unit, process.contained, proc)
    values = {source: host, master_source: master}
    wrong = {name: values[name] for name in planned.list_wrong(host, source, master, master_source)}
    return {
        "pid": process.pid,
        "node": plain(arguments.get("__name") or os.path.basename(_find_program(process.words)), LONGEST),
        "host": plain(host.lower(), LONGEST),
        "source": source,
        "master": "" if planned.is_master(master) else plain("http://{}:{}/".format(*_read_place(master)), LONGEST),
        "master_source": "" if planned.is_master(master) else master_source,
        "unit": unit,
        "person": process.person,
        "starter": starter,
        "launch": launch,
        "of_unit": not (process.person and wrong) and _is_of_unit(starter, unit, wrong, units),
        "ports": own_ports[:MOST],
        "readable": process.is_read,
    }


def _read_environment(pid: int, proc: str) -> typing.Tuple[typing.Dict[str, str], bool]:
    """Return the variables of a process, and whether they may be read here."""
    try:
        return processes.environment(pid, proc), True
    except PermissionError:
        return {}, False


def _read_words(pid: int, proc: str) -> typing.List[str]:
    return text(os.path.join(proc, str(pid), "cmdline"), _MOST_WORDS).split("\0")


def _find_program(words: typing.Sequence[str]) -> str:
    """Return the program among the words of a process: it may be a script of an interpreter."""
    if _PYTHON.match(os.path.basename(words[0])):
        script = next((word for word in words[1:] if word not in _FLAGS), "")
        return script if script and not script.startswith("-") else words[0]
    return next((word for word in words[1:2] if word.startswith("/")), words[0])


def _is_contained(pid: int, proc: str) -> bool:
    return ports.is_contained(text(os.path.join(proc, str(pid), "status")))


def _find_host(process: Process, proc: str) -> typing.Tuple[str, str]:
    """The host that a node announces, and the variable that has decided it; empty for a container that does not show its name."""
    arguments, variables = process.arguments, process.variables
    given = [(arguments.get(name), name) for name in _ARGUMENTS] + [(variables.get(name), name) for name in _VARIABLES]
    for host, source in given:
        if host:
            return host, source
    path = os.path.join(proc, str(process.pid), "root/etc/hostname")
    name = text(path, 256).strip() if process.contained else socket.gethostname()
    return (name, "hostname") if name else ("", "")


def _find_master(arguments: typing.Dict[str, str], variables: typing.Dict[str, str]) -> typing.Tuple[str, str]:
    """The URI of the roscore that a node uses, and the argument or variable that has decided it."""
    given = arguments.get("__master")
    return (given, "__master") if given else (variables.get("ROS_MASTER_URI", ""), "ROS_MASTER_URI")


def _find_starter(pid: int, unit: str, contained: bool, proc: str) -> typing.Tuple[str, str]:
    """Return the starter of a process: container, launch, unit or shell; and the name of the launch file."""
    if contained or _CONTAINERS.match(unit):
        return "container", ""
    launch = _find_launch_file(pid, proc)
    if launch is not None:
        return "launch", launch
    return ("unit" if unit.endswith(".service") and not _STARTERS.match(unit) else "shell"), ""


def _find_launch_file(pid: int, proc: str) -> typing.Optional[str]:
    """Return the name of the launch file of the roslaunch above a process; None if no roslaunch is above it."""
    for _generation in range(_MOST_PARENTS):
        pid = processes.find_parent(pid, proc)
        if pid <= 1:
            return None
        words = _read_words(pid, proc)
        if any(os.path.basename(word) == "roslaunch" for word in words[:2]):
            files = (os.path.basename(word) for word in words[2:] if word.endswith((".launch", ".xml")))
            return plain(next(files, ""), LONGEST)
    return None


class Units:
    """The variables that units of the system give to their processes. Each is asked once, and all have one limit."""

    def __init__(self) -> None:
        self._given: typing.Dict[str, str] = {}
        self._deadline = time.monotonic() + stretch(UNITS)

    def read(self, unit: str) -> str:
        """Read the variables of a unit, and those of its files; empty without an answer."""
        if unit not in self._given:
            self._given[unit] = self._ask(unit, self._deadline - time.monotonic())
        return self._given[unit]

    @staticmethod
    def _ask(unit: str, limit: float) -> str:
        if limit <= 0:
            return ""
        words = ["systemctl", "show", "--property=Environment", "--property=EnvironmentFiles", "--", unit]
        shown = run(words, limit=limit).text
        files = [found.group(1) for found in map(_FILES.match, shown.splitlines()) if found]
        return "\n".join([shown, *(text(path, _MOST_WORDS) for path in files[:MOST])])


def _is_of_unit(starter: str, unit: str, wrong: typing.Mapping[str, str], units: Units) -> bool:
    """Return True if a unit of the system gives all these variables with these values, and no script that it starts; True for none."""
    if starter != "unit" or not wrong:
        return starter == "unit"
    given = units.read(unit)
    return all(
        re.search(rf"(?:^|[\s=\"']){name}=[\"']?{re.escape(value)}(?=[\"'\s]|$)", given, re.MULTILINE)
        for name, value in wrong.items()
    )
