# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The controller's side of a kept run: an earlier run of a module has left its process behind, which does the next one."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from typing import Any

from ansible.plugins.action import ActionBase
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.kept import KIND, REQUEST
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.left_behind import path_of

PYTHON = "/usr/bin/python3"
# A visitor at the door of the kept process. It knows nothing else, so it starts at once.
VISIT = """
import socket, sys
door = socket.socket(socket.AF_UNIX)
door.connect(sys.argv[1])
door.sendall(sys.stdin.buffer.read() + b"\\n")
while True:
    said = door.recv(65536)
    if not said:
        break
    sys.stdout.buffer.write(said)
"""

Result = dict[str, Any]


def visit(action: ActionBase, options: Mapping[str, Any], label: str) -> Result | None:
    """Let the kept process with this label run its module with these options; None where there is none to be asked.

    The result is empty where the process was asked, and nothing came back. Raises AnsibleConnectionFailure.
    """
    if not action._is_pipelining_enabled("new"):
        return None  # what is written to the input of a command does not arrive there
    modes = {"_ansible_check_mode": action._task.check_mode, "_ansible_no_log": action._task.no_log}
    try:
        request = json.dumps({REQUEST: {**options, **modes}})
    except TypeError:
        return None  # the usual way knows more types
    command = shlex.join([PYTHON, "-I", "-S", "-c", VISIT, path_of(KIND, label)])
    said = action._low_level_execute_command(command, in_data=request.encode())
    if said["rc"] != 0:
        return None
    found = answered(said["stdout"])
    return {**found, "kept": True} if found else {}


def answered(output: str) -> Result:
    """Return the last line of an output as the result of a module; empty where it is none."""
    lines = output.strip().splitlines()
    try:
        found = json.loads(lines[-1]) if lines else None
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
