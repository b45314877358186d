# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The filter computers_tried: the computers that each computer tries in a verification, for the role verify."""

from __future__ import annotations

DOCUMENTATION = r"""
name: computers_tried
short_description: The computers that a computer looks at in a verification
version_added: "1.0.0"
description:
  - Up to 30 computers look at all others. In a larger fleet most pairs say nothing new, so a computer tries the next two
    of its own network, and one computer of each other network, another one than its neighbours try.
  - If there are more than 30 other networks, each computer of a network tries only a part of them, and together they try all.
  - So every way between two networks is tried, and every computer is looked at, and looks at others, at least twice.
author:
  - rosfleet contributors (@rosfleet)
positional: _input, observer, pairs, hosts
options:
  _input:
    description: The return of M(rosfleet.multimaster.fleet_plan).
    type: dict
    required: true
  observer:
    description:
      - The computer that looks, usually C(inventory_hostname).
      - Without it, the return has all computers that look. The pairs are chosen for the whole fleet, so one call for all costs
        as much as a call for one.
    type: str
  pairs:
    description:
      - V(all) for all others in a fleet of any size, for example for 400 computers 399.
      - V(auto) for those that are needed, if there are more than 30 computers.
    type: str
    choices: [auto, all]
    default: auto
  hosts:
    description: The computers of the run, usually C(ansible_play_hosts_all), because others try nothing. By default all of the plan.
    type: list
    elements: str
    version_added: "1.1.0"
"""

EXAMPLES = r"""
- name: Say whom this computer looks at
  ansible.builtin.debug:
    msg: "{{ multimaster_fleet | rosfleet.multimaster.computers_tried(inventory_hostname, 'auto') }}"

- name: Choose once whom each computer looks at
  ansible.builtin.set_fact:
    tried: "{{ multimaster_fleet | rosfleet.multimaster.computers_tried(pairs='auto', hosts=ansible_play_hosts_all) }}"
  run_once: true
"""

RETURN = r"""
_value:
  description:
    - The names of these computers in the order of the plan.
    - Without O(observer), a dictionary with these names for each computer that looks.
  type: raw
  sample: [kobuki2computer, kobuki3computer]
"""

from collections.abc import Collection, Mapping
from typing import Any

from ansible.errors import AnsibleFilterError

from ..plugin_utils._verify.context.pairs import ALL, AUTO, choose_pairs


def computers_tried(
    fleet: Mapping[str, Any], observer: str | None = None, pairs: str = AUTO, hosts: Collection[str] | None = None
) -> list[str] | dict[str, list[str]]:
    """Return the names of the computers to look at, of one observer or by observer; see DOCUMENTATION. Raises AnsibleFilterError."""
    if pairs not in (AUTO, ALL):
        raise AnsibleFilterError(f"verify_pairs is {pairs!r}, expected {AUTO} or {ALL}.")
    networks = {member["name"]: str(member["network"]) for member in fleet["members"]}
    observers = [name for name, plan in fleet["computers"].items() if not plan.get("sealed")]
    if hosts is not None:
        run = set(hosts)
        observers = [name for name in observers if name in run]
    chosen = choose_pairs(networks, observers, pairs)
    wanted = observers if observer is None else [observer]
    tried = {name: [target for target in networks if target in chosen[name]] for name in wanted}
    return tried if observer is None else tried[observer]


class FilterModule:
    """Ansible's way to find the filter."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"computers_tried": computers_tried}
