# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The controller's side of a kept run: an earlier run of a module has left its process behind, which does the next one."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from typing import Any

from ansible.module_utils.common import json as ansible_json
from ansible.plugins.action import ActionBase
from ansible.vars.clean import remove_internal_keys
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.kept import KIND, REQUEST
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.left_behind import path_of

PYTHON = "/usr/bin/python3"
NOBODY = (3, 126, 127)  # the exit status of a visitor who found no door, and of a shell without Python
# A visitor at the door of the kept process. It knows nothing else, so it starts at once.
VISIT = """
import socket, sys
door = socket.socket(socket.AF_UNIX)
try:
    door.connect(sys.argv[1])
except OSError:
    sys.exit(3)
door.sendall(sys.stdin.buffer.read() + b"\\n")
while True:
    said = door.recv(65536)
    if not said:
        break
    sys.stdout.buffer.write(said)
"""

Result = dict[str, Any]
# From ansible-core 2.19 on, warnings travel as objects.
DECODER = (
    ansible_json.get_module_decoder("legacy", ansible_json.Direction.MODULE_TO_CONTROLLER)
    if hasattr(ansible_json, "get_module_decoder")
    else None
)


def can_visit(action: ActionBase) -> bool:
    """Say if what is written to the input of a command arrives there; else there is no use in a kept process."""
    return bool(action._is_pipelining_enabled("new"))


def visit(action: ActionBase, options: Mapping[str, Any], label: str) -> Result | None:
    """Let the kept process with this label run its module with these options; None where there is none to be asked.

    The result is empty where the process was asked, and nothing came back. Raises AnsibleConnectionFailure.
    """
    if not can_visit(action):
        return None
    modes: Result = {"_ansible_check_mode": action._task.check_mode}
    if action._task.no_log:  # else what Ansible told the first run counts
        modes["_ansible_no_log"] = True
    try:
        request = json.dumps({REQUEST: {**options, **modes}})
    except TypeError:
        return None  # the usual way knows more types
    command = shlex.join([PYTHON, "-I", "-S", "-c", VISIT, path_of(KIND, label)])
    said = action._low_level_execute_command(command, in_data=request.encode())
    if said["rc"] in NOBODY:
        return None
    found = answered(said["stdout"])
    return {**found, "kept": True} if found else {}


def answered(output: str) -> Result:
    """Return the last line of an output as the result of a module; empty where it is none.

    As with every result of a module, the keys by which Ansible itself is told what to do are taken out: with them a robot
    could set variables of other hosts (`add_host`).
    """
    lines = output.strip().splitlines()
    try:
        found = json.loads(lines[-1], cls=DECODER) if lines else None
    except (RecursionError, ValueError):
        return {}
    if not isinstance(found, dict):
        return {}
    remove_internal_keys(found)
    return found
