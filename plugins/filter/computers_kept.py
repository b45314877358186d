# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The filter computers_kept: the computers for which a gateway or the router goes on forwarding, for the teardown."""

from __future__ import annotations

DOCUMENTATION = r"""
name: computers_kept
short_description: The computers behind a gateway or the router that have kept their routes
version_added: "1.1.0"
description:
  - A computer that could not give its routes back is reached through its gateway and the router. So these two stay as they are.
    Gateways of other robots do not wait for it.
author:
  - rosfleet contributors (@rosfleet)
positional: _input
options:
  _input:
    description: The computers of the play, usually C(ansible_play_hosts_all).
    type: list
    elements: str
    required: true
  hostvars:
    description: The variable C(hostvars), which has what each computer registered.
    type: dict
    required: true
  registered:
    description: The name of the variable in which every computer registered how it gave its routes back.
    type: str
    required: true
  gateway:
    description: The gateway; empty for the router, through which all of them are reached.
    type: str
    default: ""
"""

EXAMPLES = r"""
- name: Say for whom a gateway stays as it is
  ansible.builtin.debug:
    msg: "{{ ansible_play_hosts_all | rosfleet.multimaster.computers_kept(hostvars, 'closed', gateway=inventory_hostname) }}"
"""

RETURN = r"""
_value:
  description: The names of the computers.
  type: list
  elements: str
  sample: [kobuki1-arm]
"""

from collections.abc import Mapping, Sequence
from typing import Any


def computers_kept(
    computers: Sequence[str], hostvars: Mapping[str, Any], registered: str, gateway: str = ""
) -> list[str]:
    """Return the computers that have kept their routes; see DOCUMENTATION."""
    return [
        name
        for name in computers
        if _has_failed(hostvars[name], registered) and gateway in ("", _find(hostvars[name], "multimaster_gateway"))
    ]


def _find(variables: Mapping[str, Any], name: str) -> Any:
    return variables[name] if name in variables else None


def _has_failed(variables: Mapping[str, Any], registered: str) -> bool:
    result = _find(variables, registered) or {}
    return bool(result.get("failed") or result.get("unreachable"))


class FilterModule:
    """Ansible's way to find the filter."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"computers_kept": computers_kept}
