# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: multimaster_logs_info
short_description: Read the last lines that the services of the collection have logged
version_added: "1.0.0"
description:
  - Reads the journal of this machine for the services of the collection, for M(rosfleet.multimaster.fleet_bundle).
  - A service without lines, or a journal that cannot be read, is no failure; RV(problems) says why.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.info
options:
  services:
    description: The services as the plan names them, for example V([roscore, discovery, sync]); each is a unit C(multimaster-NAME.service).
    type: list
    elements: str
    required: true
  lines:
    description: How many lines of each service are read, from 1 to 1000, for example V(200). A line has at most 2000 letters.
    type: int
    default: 200
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.fleet_bundle
"""

EXAMPLES = r"""
- name: Read the last lines of the services
  rosfleet.multimaster.multimaster_logs_info:
    services: [roscore, discovery, sync]
    lines: 50
  register: verify_logs
"""

RETURN = r"""
logs:
  description: The lines of each service, the oldest first, as plain text with their times.
  returned: success
  type: dict
  sample: {discovery: ["2026-11-22T14:02:12+0000 master_discovery[812]: kobuki2computer is online"]}
problems:
  description: A sentence for each service whose lines could not be read.
  returned: success
  type: list
  elements: str
  sample: []
"""

import re

from ..module_utils._base import ends
from ..module_utils._base.module import Module
from ..module_utils._probe.measure.logs import MOST, last_lines

ARGUMENTS = {
    "services": {"type": "list", "elements": "str", "required": True},
    "lines": {"type": "int", "default": 200},
}


def find_wrong_value(services, lines):
    """Return a sentence about wrong options, or an empty text."""
    odd = [name for name in services if not re.match(r"[a-z][a-z-]{0,40}\Z", name)]
    if odd:
        return f"services has {odd[0]!r}; expected names as the plan has them, such as roscore: correct it."
    if not 1 <= lines <= MOST:
        return f"lines is {lines}; expected a number from 1 to {MOST}: choose one of them."
    return ""


def main() -> None:
    module = Module(argument_spec=ARGUMENTS, supports_check_mode=True)
    services, lines = module.params["services"], module.params["lines"]
    error = find_wrong_value(services, lines)
    if error:
        ends.fail(module, msg=error)
    logs = {name: last_lines(name, lines) for name in services}
    ends.leave(
        module,
        changed=False,
        logs={name: lines for name, (lines, _problem) in logs.items()},
        problems=[f"{name}: {problem}" for name, (_found, problem) in logs.items() if problem],
    )


if __name__ == "__main__":
    main()
