# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The filter talkers_heard: the talkers that each robot is to hear, for the role verify."""

from __future__ import annotations

DOCUMENTATION = r"""
name: talkers_heard
short_description: The talkers of the verification that are to be heard on each robot
version_added: "1.0.0"
description:
  - The verification runs a talker on every computer with ROS. A robot hears the talkers of every robot that gives it
    something, and its own ones.
  - A robot that declares its exports (C(multimaster_exports)) and gives another one nothing is not heard there.
author:
  - rosfleet contributors (@rosfleet)
positional: _input
options:
  _input:
    description: The return of M(rosfleet.multimaster.fleet_plan).
    type: dict
    required: true
  hostvars:
    description: The variable C(hostvars), which has what each computer registered.
    type: dict
    required: true
  hosts:
    description: The computers of the play, usually C(ansible_play_hosts).
    type: list
    elements: str
    required: true
  registered:
    description: The name of the variable that every computer registered from M(rosfleet.multimaster.multimaster_verify).
    type: str
    required: true
"""

EXAMPLES = r"""
- name: Note whose topics are to be heard
  ansible.builtin.set_fact:
    talkers: >-
      {{ multimaster_fleet | rosfleet.multimaster.talkers_heard(
           hostvars=hostvars, hosts=ansible_play_hosts, registered='started') }}
  run_once: true
"""

RETURN = r"""
_value:
  description:
    - The names of the computers whose talkers run and are to be heard, by the name of the robot.
    - The empty name means the router of the common network, which is of no robot.
  type: dict
  sample: {kobuki1: [kobuki1computer, kobuki2computer], kobuki2: [kobuki1computer, kobuki2computer], "": []}
"""

from collections.abc import Mapping, Sequence
from typing import Any

from ..plugin_utils._base.plain import from_plain
from ..plugin_utils._plan.model import FleetPlan


def talkers_heard(
    fleet: Mapping[str, Any], *, hostvars: Mapping[str, Any], hosts: Sequence[str], registered: str
) -> dict[str, list[str]]:
    """Return the computers to hear, by robot; see DOCUMENTATION."""
    return from_plain(FleetPlan, fleet).talkers_by_robot(
        [host for host in hosts if _has_talker(hostvars[host], registered)]
    )


def _has_talker(variables: Mapping[str, Any], registered: str) -> bool:
    result = variables[registered] if registered in variables else {}
    return bool((result.get("talker") or {}).get("running"))


class FilterModule:
    """Ansible's way to find the filter."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"talkers_heard": talkers_heard}
