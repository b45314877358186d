# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The filter node_parameters: the parameters of a node with the robots of the fleet."""

from __future__ import annotations

DOCUMENTATION = r"""
name: node_parameters
short_description: The parameters of a node with the robots of the fleet
version_added: "1.0.0"
description:
  - Adds the robots of the fleet to the parameters of a bundled node. The nodes of multimaster_fkie know no members, so their
    parameters stay as they are.
author:
  - rosfleet contributors (@rosfleet)
positional: _input, members
options:
  _input:
    description:
      - The parameters in the plan of the computer, for example V({"name":"kobuki1computer"}).
    type: dict
    required: true
  members:
    description: The robots of the fleet, C(belonging.robots) of M(rosfleet.multimaster.fleet_plan).
    type: list
    elements: dict
    required: true
"""

EXAMPLES = r"""
- name: Own the parameters of master_sync
  rosfleet.multimaster.managed_files:
    bundle: parameters
    files:
      - path: /etc/rosfleet-multimaster/master_sync.json
        content: "{{ multimaster_plan.sync | rosfleet.multimaster.node_parameters(multimaster_fleet.belonging.robots) | to_nice_json }}"
"""

RETURN = r"""
_value:
  description: The parameters, which the node reads as JSON, for example V({"name":"kobuki1computer","members":[]}).
  type: dict
"""

from collections.abc import Mapping
from typing import Any

from ansible.errors import AnsibleFilterError

from ..plugin_utils._plan import parameters as parameters_module


def node_parameters(parameters: Any, members: Any) -> dict[str, Any]:
    """Return the parameters; see DOCUMENTATION."""
    if not isinstance(parameters, Mapping) or not isinstance(members, (list, tuple)):
        raise AnsibleFilterError(
            f"The parameters of a node are {parameters!r}, of the members {members!r}; expected a mapping and a list: let the role "
            "preflight make the plan first."
        )
    return dict(parameters_module.add_members(parameters, members))


class FilterModule:
    """Filters of this file."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"node_parameters": node_parameters}
