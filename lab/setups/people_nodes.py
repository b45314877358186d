# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Nodes that a person starts wrongly: commands for root of a computer of the lab. Pure.

A node is a publisher of rospy. Its number is in /run/<name>.pid, and each command waits until it is as it should be, for some seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

STARTERS = ("shell", "unit", "launch", "container")
BOX = "bash /usr/local/share/lab/node-box"
PATIENCE = 40  # seconds until a node has registered
_TALK = "rostopic pub -r 2 /{name} std_msgs/Int32 1"
# rostopic ends without a roscore; a node of rospy waits for it.
_WAIT = 'python3 -c "import os, rospy; rospy.init_node(os.uname().sysname); rospy.spin()"'


@dataclass(frozen=True)
class Wrong:
    """A fault of a node: the variables with which it starts, the commands before it starts, and the faults that it meets then."""

    title: str
    variables: Mapping[str, str] = field(default_factory=dict)
    before: str = ""
    after: str = ""  # `$pid` is the node
    back: str = ""
    registers: bool = True
    bridge: bool = False  # of a container: it has a network of its own behind docker0, instead of that of its computer

    @property
    def master(self) -> str:
        """The roscore that it is set to use; empty for that of its shell."""
        return self.variables.get("ROS_MASTER_URI", "")


def announce(host: str, title: str, variable: str = "ROS_HOSTNAME") -> Wrong:
    """Make a node announce a host."""
    return Wrong(title, {variable: host})


def _bridge(address: str) -> Wrong:
    made = f"ip link add docker0 type bridge; ip address add {address}/16 dev docker0; ip link set docker0 up"
    return Wrong("announces the address of docker0", {"ROS_HOSTNAME": address}, made, back="ip link del docker0")


DOCKER = _bridge("172.17.0.1")
#: containers in a network of their own: nothing outside leads to what they announce
BRIDGED = Wrong("announces the name of its container in a network of its own", bridge=True)
BRIDGED_ADDRESS = Wrong(
    "announces the address of its container in a network of its own", {"ROS_IP": "172.17.0.2"}, bridge=True
)
BRIDGED_AS_COMPUTER = Wrong(
    "announces the name of its computer in a network of its own", {"ROS_HOSTNAME": "$(hostname)"}, bridge=True
)
HUNG = Wrong("is stopped", after="kill -STOP $pid")
GONE = Wrong("was killed", after="kill -KILL $pid")
FILTERED = Wrong(
    "is behind a packet filter",
    after=(
        'ports=$(ss -Hltnp | grep pid=$pid, | awk "{print \\$4}" | sed s/.*:// | paste -sd,); '
        'nft "table inet fault { chain one { type filter hook input priority 0; iif != lo tcp dport { $ports } drop; }; }"'
    ),
    back="nft delete table inet fault",
)


def _forget() -> Wrong:
    """Take all registrations of a node out of its roscore, as after another one was started in its place."""
    call = (
        'import os, xmlrpc.client as x; m = x.ServerProxy(os.environ[\\"ROS_MASTER_URI\\"]); n = \\"/$name\\"; u = m.lookupNode(n, n)[2]; '
        "p, s, v = [[t for t, users in table if n in users] for table in m.getSystemState(n)[2]]; "
        "[m.unregisterPublisher(n, t, u) for t in p]; [m.unregisterSubscriber(n, t, u) for t in s]; "
        "[m.unregisterService(n, t, m.lookupService(n, t)[2]) for t in v]"
    )
    return Wrong("is registered at no roscore", after=f"bash -lc \"python3 -c '{call}'\"")


FORGOTTEN = _forget()


def use_roscore(uri: str, title: str, *, registers: bool = True) -> Wrong:
    """Make a node use a roscore."""
    return Wrong(title, {"ROS_MASTER_URI": uri}, registers=registers)


def list_services_elsewhere(host: str) -> Wrong:
    """Make the services of a node lead to another host than the node."""
    call = (
        'import os, xmlrpc.client as x; m = x.ServerProxy(os.environ[\\"ROS_MASTER_URI\\"]); n = \\"/$name\\"; '
        f'm.registerService(n, n + \\"/set\\", \\"rosrpc://{host}:41999\\", m.lookupNode(n, n)[2])'
    )
    return Wrong("has its services at another place", after=f"bash -lc \"python3 -c '{call}'\"")


def start(name: str, starter: str, wrong: Wrong) -> str:
    """Return the command that starts a node, wrongly."""
    steps = [wrong.before, _START[starter](name, wrong)]
    if wrong.registers:
        uri = f"ROS_MASTER_URI={wrong.master} " if wrong.master else ""
        steps.append(_wait(f"{uri}timeout 5 rosnode list 2>/dev/null | grep -qx /{name}"))
    else:
        steps.append("sleep 4")
    if wrong.after:
        steps.append(f"name={name}; pid=$(cat /run/{name}.pid); {wrong.after}")
    return "; ".join(filter(None, steps))


def stop(name: str, wrong: Wrong) -> str:
    """Return the command that ends a node, and takes back the changes for it."""
    uri = f"ROS_MASTER_URI={wrong.master} " if wrong.master and wrong.registers else ""
    steps = [
        wrong.back,
        f"pid=$(cat /run/{name}.pid); kill -CONT $pid; kill $pid; for n in $(seq 20); do kill -0 $pid || break; sleep 0.3; done; kill -KILL $pid",
        f"systemctl stop {_unit(name)} || true",
        f"{BOX} end {name}",
        f"yes | {uri}timeout 60 rosnode cleanup >/dev/null 2>&1 || true",
        f"rm -rf /run/{name} /run/{name}.pid /run/{name}.launch",
    ]
    return "; ".join(filter(None, steps))


def _unit(name: str) -> str:
    return name.replace("_", "-")


def _wait(condition: str) -> str:
    return f"for n in $(seq {PATIENCE}); do {condition} && break; sleep 0.5; done"


def _env(variables: Mapping[str, str]) -> str:
    """The words of env(1) that set variables. The given ones decide the host."""
    unset = ["-u ROS_HOSTNAME", "-u ROS_IP"] if {"ROS_HOSTNAME", "ROS_IP"} & variables.keys() else []
    return " ".join([*unset, *(f"{name}={value}" for name, value in sorted(variables.items()))])


def _say(name: str, wrong: Wrong) -> str:
    words = _TALK.format(name=name) if wrong.registers else _WAIT
    return f"exec env {_env(wrong.variables)} {words} __name:={name}"


def _start_in_shell(name: str, wrong: Wrong) -> str:
    return f"setsid bash -lc 'echo $$ >/run/{name}.pid; {_say(name, wrong)}' >/dev/null 2>&1 </dev/null & sleep 1"


def _start_unit(name: str, wrong: Wrong) -> str:
    # systemd would take a $ for one of its variables
    unit = _unit(name)
    note = f"systemctl show --property MainPID --value {unit} >/run/{name}.pid"
    return f"systemd-run --quiet --collect --unit {unit} bash -lc '{_say(name, wrong)}'; {note}"


def _start_by_launch_file(name: str, wrong: Wrong) -> str:
    package = (
        f'<package><name>{name}</name><version>0.0.0</version><description>d</description><maintainer email="a@example.com">a</maintainer>'
        "<license>l</license></package>"
    )
    # The shell has ROS_HOSTNAME, which counts before ROS_IP, and a launch file takes nothing away.
    variables = {given.replace("ROS_IP", "ROS_HOSTNAME"): value for given, value in wrong.variables.items()}
    variables_given = "".join(
        f'<env name="{variable}" value="{value}"/>' for variable, value in sorted(variables.items())
    )
    launch = f'<launch><node pkg="{name}" type="talk" name="{name}" output="log">{variables_given}</node></launch>'
    talk = _TALK.format(name=name) if wrong.registers else _WAIT
    script = f'#!/bin/sh\\necho $$ >/run/{name}.pid\\nexec {talk} "$@"\\n'
    steps: Sequence[str] = (
        f"mkdir -p /run/{name}/{name}",
        f"printf '{package}' >/run/{name}/{name}/package.xml",
        f"printf '{script}' >/run/{name}/{name}/talk",
        f"chmod +x /run/{name}/{name}/talk",
        f"printf '{launch}' >/run/{name}.launch",
        f"setsid bash -lc 'export ROS_PACKAGE_PATH=/run/{name}:$ROS_PACKAGE_PATH; exec roslaunch /run/{name}.launch' >/dev/null 2>&1 </dev/null "
        "& sleep 1",
    )
    return "; ".join(steps)


def _start_container(name: str, wrong: Wrong) -> str:
    # As by `--env ROS_MASTER_URI --env ROS_HOSTNAME --env ROS_IP`, of which a person gives what counts.
    hosts = {"ROS_HOSTNAME", "ROS_IP"}
    taken = (
        {"ROS_MASTER_URI", *hosts}
        - wrong.variables.keys()
        - (hosts if wrong.bridge or hosts & wrong.variables.keys() else set())
    )
    given = [f"${{{variable}:+{variable}=${variable}}}" for variable in sorted(taken)]
    given += [f"{variable}={value}" for variable, value in sorted(wrong.variables.items())]
    words = _TALK.format(name=name) if wrong.registers else _WAIT
    return f"{BOX} run {name} {'bridge' if wrong.bridge else 'host'} {' '.join(given)} -- {words} __name:={name}"


_START: Mapping[str, Callable[[str, Wrong], str]] = {
    "shell": _start_in_shell,
    "unit": _start_unit,
    "launch": _start_by_launch_file,
    "container": _start_container,
}
