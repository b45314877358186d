# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The text of every unit of systemd that the collection installs, and of the file of the multicast router.

Pure: names, ports and paths in, text out. A unit of a node has two parts that differ by provider: the table PROGRAMS.
Each value passes a function of `quotes`, which raises Unquotable.
"""

from __future__ import annotations

import hashlib
import ipaddress
from collections.abc import Iterable, Mapping, Sequence

from .._base.features import load_hooks
from . import quotes
from .hooks import UnitHooks
from .model import UnitLines

# The folders in which the roles install.
LIBRARY = "/usr/local/lib/rosfleet-multimaster"
CONFIGURATION = "/etc/rosfleet-multimaster"
# The nodes of upstream run under the Python of their ROS. Our helper runs under the system's, which Ansible needs too.
SYSTEM_PYTHON = "/usr/bin/python3"
WAIT = f"{SYSTEM_PYTHON} -m rosfleet_multimaster.wait_for_master"
RUN_PLAIN = f"{SYSTEM_PYTHON} -m rosfleet_multimaster.run_plain"


# A unit as the module managed_services takes it: its name and its content.
Unit = dict[str, str]


def _digest(*parts: str) -> str:
    return hashlib.sha256("".join(parts).encode()).hexdigest()


_INSTALL = """

[Install]
WantedBy=multi-user.target
"""

# The sandbox of every unit. docs/operate/security.md has the ratings, and tests/evidence/security.md the reasons for missing directives.
_SANDBOX = """\
# It gains no rights, sees no foreign processes, and sets nothing of the kernel's. The system is read-only for it.
NoNewPrivileges=yes
ProtectSystem=strict
PrivateTmp=yes
PrivateDevices=yes
PrivateMounts=yes
ProtectProc=invisible
ProtectKernelTunables=yes
ProtectKernelModules=yes
ProtectKernelLogs=yes
ProtectControlGroups=yes
ProtectClock=yes
ProtectHostname=yes
RestrictNamespaces=yes
RestrictRealtime=yes
RestrictSUIDSGID=yes
LockPersonality=yes
KeyringMode=private
SystemCallArchitectures=native
SystemCallFilter=@system-service
SystemCallFilter=~@privileged @resources
# A call that is not allowed fails. It does not end the process: libraries try what they can do without.
SystemCallErrorNumber=EPERM
UMask=0077"""

# How long a start may take: a machine that is merely busy needs many times as long as usual.
START = 300  # seconds
# The signs of life of our own programs.
_NOTIFY = f"""\
Type=notify
NotifyAccess=main
# Its loop gives signs of life. multimaster-watchdog.service ends it if it hangs, and not if it waits for a processor. systemd
# cannot distinguish the two: this limit is for a hang that no other program sees.
WatchdogSec=30min
# The processor may be busy.
TimeoutStartSec={START}"""

# The own address

# The mark of our route. It is found again by it, also with an old address (rtnetlink(7), rtm_protocol).
ROUTE_PROTOCOL = 84
_ADDRESS = """\
# Managed by rosfleet.multimaster: the own address of this computer of the robot {robot}, also without a network
[Unit]
Description=Own address {address} of this computer of {robot}, also without a network
Documentation=https://github.com/rosfleet/multimaster
# No interface gets an address from it: a local route is what the kernel makes for every address of an interface. So the
# own name leads to this computer before the network is there, in other networks, and after it is lost.
Before=multimaster-roscore.service multimaster-discovery.service multimaster-sync.service

[Service]
Type=oneshot
RemainAfterExit=yes
ExecStart=/sbin/ip -4 -batch -
StandardInput=data
StandardInputText=route flush table local proto {protocol}
# The kernel's own route has the metric 0: as soon as an interface has the address, that one counts.
StandardInputText=route replace local {address}/32 dev lo table local proto {protocol} metric {protocol}
ExecStop=-/sbin/ip -4 route flush table local proto {protocol}
# An unprivileged user that may change routes.
DynamicUser=yes
AmbientCapabilities=CAP_NET_ADMIN
CapabilityBoundingSet=CAP_NET_ADMIN
ProtectHome=yes
RestrictAddressFamilies=AF_NETLINK
MemoryDenyWriteExecute=yes
{sandbox}"""

# The units of ROS

# A service of ROS: a folder of its own, restarts, an unprivileged user.
_SERVICE = """\
[Service]
EnvironmentFile={configuration}/environment
Environment=ROSFLEET_INPUTS={inputs}
Environment=ROS_HOME=%t/%N ROS_LOG_DIR=%t/%N
Environment=PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1
RuntimeDirectory=%N
Restart=always
RestartSec=200ms
TimeoutStopSec=15
# The user exists while the service runs.
DynamicUser=yes
CapabilityBoundingSet=
# Workspaces of users are read there.
ProtectHome=read-only
# Netlink lists the addresses of this computer.
RestrictAddressFamilies=AF_INET AF_INET6 AF_UNIX AF_NETLINK
{sandbox}"""
_ROSCORE = """\
# Managed by rosfleet.multimaster: the ROS master of the robot {robot}
[Unit]
Description=ROS master of {robot} (roscore)
Documentation=https://github.com/rosfleet/multimaster
# It waits for no network, since a robot works without one. It is started again as often as it ends.
StartLimitIntervalSec=0

{service}
{program}
KillSignal=SIGINT
# Its folder is in memory, so a log of rosout would count.
Environment=ROSOUT_DISABLE_FILE_LOGGING=1
# 130 MB with 10,000 registrations. A thread for each connection: there are at most as many as open files, 1024.
MemoryMax=1G
TasksMax=2048"""
# The roscore of ROS itself.
_PLAIN_ROSCORE = """\
# More workers than three, and a timeout: unreachable subscribers of other robots must not block the robot's own nodes.
# The output of rosmaster and rosout may be a stranger's text: each line of it is plain, and begins with a word of ours.
ExecStart={run_plain} {command} -p {port} -w 16 -t 3
# Started means that it answers, so units that are ordered after it find it. A busy processor costs no roscore.
ExecStartPost={wait} --timeout {start}
TimeoutStartSec=infinity"""
_NODE = """\
# Managed by rosfleet.multimaster: {task}, for the robot {robot}
[Unit]
Description=ROS {node} of {robot}: {task}
Documentation=https://github.com/rosfleet/multimaster
After=multimaster-roscore.service
# A node ends when it sees another roscore, and is started again, as often as that happens.
StartLimitIntervalSec=0
{program.unit}

{service}
# Each stays below 128 MB, also under hostile answers. rospy has a thread for each connection.
MemoryMax=512M
TasksMax=1024
{program.service}"""


#: node, without `master_` -> its task in words, and the ROS service that shows that it works
NODES = {
    "discovery": ("discovery of other ROS masters", "list_masters"),
    "sync": ("exchange of topics and services with other ROS masters", "get_sync_info"),
    "relay": ("topics by other names, and at a rate, to other robots", ""),
}

#: the services of optional features: the text of each
OF_FEATURES = {name: text for hooks in load_hooks("units", UnitHooks).values() for name, text in hooks.services.items()}

#: the services that are not nodes
OTHERS = (*OF_FEATURES, "address", "watchdog", "roscore", "connections", "metrics")


_CODE = f"{LIBRARY}/python/rosfleet_multimaster"
_MESSAGES = (f"{LIBRARY}/python/fkie_multimaster_msgs", f"{LIBRARY}/share")

#: service -> the files and folders of the nodes that it reads, besides those that no service here names: all read these
READS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(OF_FEATURES, ()),
    "address": (),
    "watchdog": (f"{_CODE}/end_hangs.py",),
    "roscore": (f"{_CODE}/roscore",),
    "connections": (f"{_CODE}/end_connections.py", f"{_CODE}/sync", f"{CONFIGURATION}/master_sync.json"),
    "metrics": (f"{_CODE}/publish_metrics.py",),
    "discovery": (
        *(f"{_CODE}/master_discovery.py", f"{_CODE}/discovery"),
        *_MESSAGES,
        f"{CONFIGURATION}/master_discovery.json",
    ),
    "sync": (f"{_CODE}/master_sync.py", f"{_CODE}/sync", *_MESSAGES, f"{CONFIGURATION}/master_sync.json"),
    "relay": (
        *(f"{_CODE}/master_relay.py", f"{_CODE}/relay", f"{_CODE}/discovery", f"{_CODE}/sync"),
        f"{CONFIGURATION}/master_relay.json",
    ),
}


def is_in(path: str, places: Iterable[str]) -> bool:
    """Return True for one of some files, or a file in one of some folders."""
    return any(path == place or path.startswith(f"{place}/") for place in places)


def reads(service: str, path: str) -> bool:
    """Return True if a service reads a file of the nodes."""
    return is_in(path, READS[service]) or not any(is_in(path, places) for places in READS.values())


def render_services(
    names: Sequence[str],
    *,
    robot: str,
    address: str,
    roscore_command: str,
    roscore_port: int,
    programs: Mapping[str, UnitLines],
    environment_digest: str,
    files: Mapping[str, str],
    metrics_folder: str = "",
    digests: Mapping[str, str] | None = None,
) -> list[Unit]:
    """The units of a computer's services (OTHERS and the keys of NODES), in the order of `names`.

    `files`: those of the nodes, code and parameters, path -> digest. A service restarts if one of its inputs changes: the
    environment, if it has one, and the files that it reads. The bundled roscore remembers, so a restart costs nothing. If
    the roscore of ROS restarts, every node loses its registration, so that one depends only on the environment.
    `digests`: those of further inputs, as of optional features, by the service that depends on them.
    """
    units = []
    for name in names:
        environment = environment_digest if name in ("roscore", *NODES) else ""
        read = [f"{path} {digest}\n" for path, digest in sorted(files.items()) if reads(name, path)]
        other = (digests or {}).get(name, "")
        shared = {"robot": quotes.escape_text(robot), "inputs": _digest(environment, *read, *filter(None, [other]))}
        if name in OF_FEATURES:
            values = {**shared, "inputs": quotes.escape_text(other)}
            text = complete(OF_FEATURES[name], **values)
        elif name == "address":
            text = complete(_ADDRESS, **shared, address=ipaddress.IPv4Address(address), protocol=ROUTE_PROTOCOL)
        elif name == "watchdog":
            judged = " ".join(f"multimaster-{other}.service" for other in names if other in _JUDGED)
            text = complete(_WATCHDOG, **shared, end=_isolate("end_hangs"), judged=judged)
        elif name == "connections":
            text = complete(_CONNECTIONS, **shared, end=_isolate("end_connections"))
        elif name == "metrics":
            folder = quotes.check_program(metrics_folder)
            text = complete(_METRICS, **shared, publish=_isolate("publish_metrics"), folder=folder)
        elif name == "roscore":
            inputs = shared["inputs"] if "roscore" in programs else quotes.escape_text(environment_digest)
            values = {**shared, "inputs": inputs}
            text = complete(_ROSCORE, **values, program=_roscore_lines(roscore_command, roscore_port, programs))
        else:
            text = complete(_NODE, **shared, node=f"master_{name}", task=NODES[name][0], program=programs[name])
        units.append({"name": f"multimaster-{name}.service", "content": text})
    return units


def complete(template: str, inputs: str, **values: object) -> str:
    """The text of a unit: its title, the part of a service of ROS, the sandbox, and its start at boot."""
    shared = {"inputs": inputs, "configuration": CONFIGURATION, "sandbox": _SANDBOX, "notify": _NOTIFY}
    return (template + _INSTALL).format(**shared, **values, service=_SERVICE.format(**shared))


def _roscore_lines(command: str, port: int, programs: Mapping[str, UnitLines]) -> str:
    """The lines of the roscore of the provider, or of ROS."""
    if "roscore" in programs:
        return programs["roscore"].service
    return _PLAIN_ROSCORE.format(
        command=quotes.check_program(command), port=port, wait=WAIT, run_plain=RUN_PLAIN, start=START
    )


# The end of connections with lost robots


def _isolate(program: str) -> str:
    """The command of a program on the system's Python, without the user's environment (-I), with only root's files."""
    return (
        f'{SYSTEM_PYTHON} -I -B -c \'import sys; sys.path.insert(0, "{LIBRARY}/python"); '
        f"from rosfleet_multimaster.{program} import main; main(*sys.argv[1:])'"
    )


_CONNECTIONS = """\
# Managed by rosfleet.multimaster: the end of TCP connections with lost robots, for the robot {robot}
[Unit]
Description=End of TCP connections of {robot} with lost robots
Documentation=https://github.com/rosfleet/multimaster
StartLimitIntervalSec=0

[Service]
Environment=ROSFLEET_INPUTS={inputs}
{notify}
ExecStart={end} {configuration}/master_sync.json %t/%N/socket
Restart=always
RestartSec=1
# The group of this user is that of multimaster-sync.service too: nobody else comes into the folder of the socket.
DynamicUser=yes
RuntimeDirectory=%N
RuntimeDirectoryMode=0750
# It is the only part of the nodes with a capability. It ends what core/permission.py allows, and does nothing else.
AmbientCapabilities=CAP_NET_ADMIN
CapabilityBoundingSet=CAP_NET_ADMIN
ProtectHome=yes
# It opens no connection but one with itself, to see whether it can end it.
RestrictAddressFamilies=AF_INET AF_UNIX AF_NETLINK
IPAddressDeny=any
IPAddressAllow=localhost
MemoryDenyWriteExecute=yes
MemoryMax=128M
TasksMax=16
{sandbox}"""

# The metrics, in the folder that node_exporter reads

_METRICS = """\
# Managed by rosfleet.multimaster: the metrics of the nodes for node_exporter, of the robot {robot}
[Unit]
Description=Metrics of {robot} for node_exporter
Documentation=https://github.com/rosfleet/multimaster
After=multimaster-discovery.service multimaster-sync.service
RequiresMountsFor={folder}
StartLimitIntervalSec=0

[Service]
Environment=ROSFLEET_INPUTS={inputs}
{notify}
ExecStart={publish} {folder}
Restart=always
RestartSec=10
# Root, since the folder is root's or node_exporter's, and nodes that talk with strangers must not write there. But of root
# it has only the right to write to files of other owners, and that one folder.
CapabilityBoundingSet=CAP_DAC_OVERRIDE
ReadWritePaths={folder}
ProtectHome=yes
PrivateNetwork=yes
RestrictAddressFamilies=AF_UNIX
MemoryDenyWriteExecute=yes
MemoryMax=64M
TasksMax=4
{sandbox}"""

# The end of services that hang

_JUDGED = ("roscore", "connections", "metrics", *NODES)
_WATCHDOG = """\
# Managed by rosfleet.multimaster: the end of services that hang, for the robot {robot}
[Unit]
Description=End of services of {robot} that hang
Documentation=https://github.com/rosfleet/multimaster
StartLimitIntervalSec=0

[Service]
Environment=ROSFLEET_INPUTS={inputs}
{notify}
ExecStart={end} {judged}
Restart=always
RestartSec=1
# Root, since systemd answers it without D-Bus then. Of root it has only the right to end processes.
CapabilityBoundingSet=CAP_KILL
ProtectHome=yes
PrivateNetwork=yes
RestrictAddressFamilies=AF_UNIX
MemoryDenyWriteExecute=yes
MemoryMax=64M
TasksMax=8
{sandbox}
# It reads how long the threads of services have waited for a processor.
ProtectProc=default"""

# Differences by provider

_PART_OF = (
    "# Its nodes do not register again with a roscore that was started again.\nPartOf=multimaster-roscore.service"
)
_ENDER = """\
# It ends the TCP connections with a robot that was lost, for this node.
Wants=multimaster-connections.service
After=multimaster-connections.service"""
_GROUP = """\
# Who has this group may ask multimaster-connections.service.
Group=multimaster-connections
"""
_NOTIFYING = """\
{notify}
ExecStart={python} -m rosfleet_multimaster.{node} --parameters {configuration}/{node}.json"""
_REMEMBERING = """\
# rosmaster with a memory: docs/understand/roscore.md. Started means that it answers, with its former state.
{notify}
# It counts callers by robot, and reads the robots of the fleet again if the file changes. %E is /etc: the collection restarts a
# unit if a file changes that the unit names by /etc.
ExecStart={python} -m rosfleet_multimaster.roscore --port {port} --members %E/rosfleet-multimaster/master_discovery.json
StateDirectory=%N
# systemd holds its socket while it is started again, so calls wait and do not fail.
FileDescriptorStoreMax=1
# It ends rosout itself. If it was killed, rosout is too: it would wait for the answer to its farewell.
KillMode=mixed"""
_WATCHED = """\
{environment}Environment=ROS_PYTHON_LOG_CONFIG_FILE={library}/python/rosfleet_multimaster/logging.conf
ExecStartPre={wait} --set /{node} {configuration}/{node}.json
ExecStart={python} {path} __name:={node}
# Started means that it answers. A busy processor costs no node.
ExecStartPost={wait} --timeout {start} --service /{node}/{service}
TimeoutStartSec=infinity
RestartSec=1"""
# 1000 incoming connections, 320 for XML-RPC, two for each of 200 calls, and 300 to each of the other relays.
_RELAY = UnitLines("", f"LimitNOFILE=16384\n{_NOTIFYING}")
_UPSTREAM = {"discovery": UnitLines(_PART_OF, _WATCHED), "sync": UnitLines(_PART_OF, _WATCHED), "relay": _RELAY}

#: provider -> node or roscore -> the lines of its unit; without a roscore here that of ROS runs
PROGRAMS: dict[str, dict[str, UnitLines]] = {
    "bundled": {
        "roscore": UnitLines("", _REMEMBERING),
        "discovery": UnitLines("", _NOTIFYING),
        "sync": UnitLines(_ENDER, _GROUP + _NOTIFYING),
        "relay": _RELAY,
    },
    "fkie_apt": _UPSTREAM,
    "fkie_existing": _UPSTREAM,
}
# For a computer without nodes.
NO_PROGRAMS = dict.fromkeys(("discovery", "sync"), UnitLines())


def render_programs(
    provider: str,
    python: str,
    paths: Mapping[str, str],
    port: int,
    environment: Mapping[str, str] | None = None,
) -> dict[str, UnitLines]:
    """The lines that differ, by node. `paths` are upstream's executables, by node. `port` is that of the roscore.

    `environment` is the variables that upstream's nodes need if the file with the environment has no other value (systemd.exec(5)).
    """
    lines = {}
    variables = " ".join(f"{name}={value}" for name, value in (environment or {}).items())
    for name, program in PROGRAMS[provider].items():
        _task, ros_service = NODES.get(name, ("", ""))
        service = program.service.format(
            python=quotes.check_program(python),
            wait=WAIT,
            port=port,
            node=f"master_{name}",
            path=quotes.check_program(paths[name]) if name in paths else "",
            service=ros_service,
            configuration=CONFIGURATION,
            library=LIBRARY,
            notify=_NOTIFY,
            start=START,
            environment=f"Environment={variables}\n" if variables else "",
        )
        lines[name] = UnitLines(program.unit, service)
    return lines
