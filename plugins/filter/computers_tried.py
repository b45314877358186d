# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The filter computers_tried: the computers that one computer tries in a verification, for the role verify."""

from __future__ import annotations

DOCUMENTATION = r"""
name: computers_tried
short_description: The computers that a computer looks at in a verification
version_added: "1.0.0"
description:
  - Up to 30 computers look at all others. In a larger fleet most pairs say nothing new, so a computer tries the next two
    of its own network, and one computer of each other network, another one than its neighbours try.
  - So every way between two networks is tried, and every computer is looked at, and looks at others, at least twice.
author:
  - rosfleet contributors (@rosfleet)
positional: _input, observer, pairs
options:
  _input:
    description: The return of M(rosfleet.multimaster.fleet_plan).
    type: dict
    required: true
  observer:
    description: The computer that looks, usually C(inventory_hostname).
    type: str
    required: true
  pairs:
    description:
      - V(all) for all others in a fleet of any size, for example for 400 computers 399.
      - V(auto) for those that are needed, if there are more than 30 computers.
    type: str
    choices: [auto, all]
    default: auto
"""

EXAMPLES = r"""
- name: Say whom this computer looks at
  ansible.builtin.debug:
    msg: "{{ multimaster_fleet | rosfleet.multimaster.computers_tried(inventory_hostname, 'auto') }}"
"""

RETURN = r"""
_value:
  description: The names of these computers in the order of the plan.
  type: list
  elements: str
  sample: [kobuki2computer, kobuki3computer]
"""

from collections.abc import Mapping
from typing import Any

from ansible.errors import AnsibleFilterError

from ..plugin_utils._verify.context.pairs import ALL, AUTO, choose_pairs


def computers_tried(fleet: Mapping[str, Any], observer: str, pairs: str = AUTO) -> list[str]:
    """Return the names of the computers to look at; see DOCUMENTATION. Raises AnsibleFilterError."""
    if pairs not in (AUTO, ALL):
        raise AnsibleFilterError(f"verify_pairs is {pairs!r}, expected {AUTO} or {ALL}.")
    networks = {member["name"]: str(member["network"]) for member in fleet["members"]}
    observers = [name for name, plan in fleet["computers"].items() if not plan.get("sealed")]
    targets = choose_pairs(networks, observers, pairs)[observer]
    return [name for name in networks if name in targets]


class FilterModule:
    """Ansible's way to find the filter."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"computers_tried": computers_tried}
