# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The filter multicast_router: the file and the unit of smcroute on a gateway, for the role multicast_routing."""

from __future__ import annotations

DOCUMENTATION = r"""
name: multicast_router
short_description: The file and the unit of the multicast router of a gateway
version_added: "1.0.0"
description:
  - Renders the configuration by which smcroute passes one multicast group on, both ways between two interfaces.
  - Without a group there is nothing to pass on, so both lists are empty.
author:
  - rosfleet contributors (@rosfleet)
positional: _input
options:
  _input:
    description: The multicast group, for example V(239.255.11.11), or empty.
    type: str
    required: true
  robot:
    description: The name of the robot, for example V(tibi).
    type: str
    required: true
  interfaces:
    description: The two interfaces, for example V([eth1, eth0]).
    type: list
    elements: str
    required: true
  command:
    description: The path of smcrouted on the machine, for example V(/usr/sbin/smcrouted). Needed if there is a group.
    type: str
    default: ""
  digest:
    description: The digest of the file; a change of it restarts the service.
    type: str
    default: ""
"""

EXAMPLES = r"""
- name: Own the routes of the group
  rosfleet.multimaster.managed_files:
    bundle: multicast_routing
    files: "{{ made.files }}"
  vars:
    made: >-
      {{ '239.255.11.11' | rosfleet.multimaster.multicast_router(
           robot='tibi', interfaces=['eth1', 'eth0'], command='/usr/sbin/smcrouted') }}
"""

RETURN = r"""
_value:
  description: The options of the modules.
  type: dict
  contains:
    files:
      description: The option O(rosfleet.multimaster.managed_files#module:files), one file or none.
      type: list
      elements: dict
    units:
      description: The option O(rosfleet.multimaster.managed_services#module:units), one unit or none.
      type: list
      elements: dict
"""

from collections.abc import Sequence
from typing import Any

from ansible.errors import AnsibleFilterError

from ..plugin_utils._features.multicast_routing import files
from ..plugin_utils._plan import quotes


def multicast_router(
    group: str, *, robot: str, interfaces: Sequence[str], command: str = "", digest: str = ""
) -> dict[str, list[dict[str, str]]]:
    """Return the file and the unit, or neither; see DOCUMENTATION."""
    if not group:
        return {"files": [], "units": []}
    try:
        unit = files.render_router(robot, group, interfaces, command, digest)
    except quotes.Unquotable as problem:
        raise AnsibleFilterError(str(problem)) from problem
    return {
        "files": [{"path": files.ROUTER_FILE, "content": files.render_routes(robot, group, interfaces)}],
        "units": [unit],
    }


class FilterModule:
    """Ansible's way to find the filter."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"multicast_router": multicast_router}
