# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The talker of this computer: a small node (node.py) in a unit that ends by itself. Also the names that it uses.

It calls itself what a node calls itself in the environment of the services, and needs no rospy: what a workspace says is
not run, and it is there after a tenth of a second of a processor.
"""

import base64
import re
import typing

from ..._base import foreign
from ..._base.commands import read_source, run
from ..._base.plain_text import plain
from ..._machine import systemd
from ..ros_client import header, node
from ..ros_client.ros import Ros

TALKER = "multimaster-verify-talker.service"
PYTHON = "/usr/bin/python3"
VARIABLES = ("ROS_MASTER_URI", "ROS_HOSTNAME", "ROS_IP")  # by which a node calls itself
# The sandbox of the services (plugin_utils/_plan/units.py), as far as systemd 237 knows it: systemd-run refuses what it does not
# know.
SANDBOX = (
    *foreign.SANDBOX,
    "NoNewPrivileges=yes",
    "ProtectSystem=strict",
    "ProtectKernelModules=yes",
    "RestrictNamespaces=yes",
    "RestrictRealtime=yes",
    "LockPersonality=yes",
    "KeyringMode=private",
    "SystemCallArchitectures=native",
    "SystemCallFilter=@system-service",
    "SystemCallFilter=~@privileged @resources",
    "SystemCallErrorNumber=EPERM",
    "UMask=0077",
)
_BOUNDS = ("MemoryMax=512M", "TasksMax=256", "LimitCORE=0")


def topic_of(computer: str) -> str:
    """Return the topic of a computer's talker: its name in the letters of a ROS graph name."""
    return "/multimaster_verify/" + re.sub(r"\W", "_", computer)


def node_of(run: str, computer: str) -> str:
    """Return the node name of a computer's talker; no other node of the fleet has it, also if many start together."""
    return "/" + re.sub(r"\W", "_", f"multimaster_verify_talker_{computer}_{run}")


def sentence_of(run: str, computer: str) -> str:
    """Return the text that a talker publishes: the label of the run, which an older talker leaves out, and its computer."""
    return f"{run} {computer}"


def read_program() -> str:
    """Return the text of the talker's program: node.py, with header.py in the place of its import."""
    return re.sub(
        r"^from \.header import .*$",
        lambda _line: read_source(header),
        read_source(node),
        flags=re.MULTILINE,
    )


def start(ros: Ros, label: str, computer: str, lifetime: int) -> str:
    """Start the talker as a unit that ends by itself; an older one of ours ends first. Returns an error or ''."""
    stop()
    options = {
        "RuntimeMaxSec": str(lifetime),
        "KillSignal": "SIGINT",  # so that its node unregisters
        "TimeoutStopSec": "10",  # on a busy computer Python takes its time
        "SyslogLevelPrefix": "no",  # no line of it begins with a priority
        "StandardInput": "data",
        "StandardInputData": base64.b64encode(read_program().encode()).decode(),
    }
    argv = ["systemd-run", "--quiet", "--collect", "--unit=" + TALKER]
    argv += ["--description=Talker of the verification of rosfleet.multimaster"]
    argv += [f"--property={line}" for line in SANDBOX + _BOUNDS]
    argv += [f"--property={name}={value}" for name, value in sorted(options.items())]
    argv += [f"--setenv={name}={ros.variables[name]}" for name in VARIABLES if name in ros.variables]
    argv += ["--", PYTHON, "-I", "-"]
    argv += [node_of(label, computer), topic_of(computer), sentence_of(label, computer)]
    answer = run(argv, limit=30)
    return "" if answer.status == 0 else answer.error or f"systemd-run ended with status {answer.status}"


def stop() -> None:
    """End the talker, if there is one."""
    run(["systemctl", "stop", TALKER], limit=30)


def state() -> typing.Dict[str, typing.Any]:
    """Return True if the talker runs, and the last line that it wrote if it does not."""
    state = systemd.states([TALKER], ["ActiveState"])[0].get("ActiveState", "")
    if state == "active":
        return {"running": True, "error": ""}
    answer = run(["journalctl", "--quiet", "--no-pager", "--output=cat", "--lines=5", "--unit=" + TALKER])
    lines = answer.text.strip().splitlines()
    return {"running": False, "error": plain(lines[-1]) if lines else "it did not run"}
