# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The filter environment_files: the files that carry the environment of ROS."""

from __future__ import annotations

DOCUMENTATION = r"""
name: environment_files
short_description: The files that carry one environment of ROS to everything that reads one
version_added: "1.0.0"
description:
  - Merges the variables of an installation of ROS with those of the plan, and renders the result for systemd's units,
    login shells, desktops, commands by ssh, and shells that source the set-up file of ROS.
author:
  - rosfleet contributors (@rosfleet)
positional: _input, machine
options:
  _input:
    description:
      - The variables of the plan, for example C(ROS_MASTER_URI) V(http://kobuki1computer:11311) and C(ROS_HOSTNAME)
        V(kobuki1computer).
      - Without any, as those of a router, there are no files.
    type: dict
    required: true
  machine:
    description: The return of M(rosfleet.multimaster.multimaster_info) for the machine.
    type: dict
    required: true
  ros:
    description: The variables that the installation of ROS needs, for example C(ROS_DISTRO) V(noetic) and C(PATH)
      V(/opt/ros/noetic/bin).
    type: dict
    default: {}
  for_root:
    description:
      - Those of them that root and every user but O(person) get, as C(for_root) of RV(rosfleet.multimaster.multimaster_info#module:ros.found).
      - Services get all of O(ros), since they have no rights.
    type: dict
    default: {}
  person:
    description: The user who gets all of O(ros), V(*) for every user but root, or empty for no user.
    type: str
    default: ""
  reach:
    version_added: "1.1.0"
    description: The variables that shells, desktops and commands by ssh get. Services get all of it in any case.
    type: str
    choices:
      all: The variables of the plan and those of O(ros), with its folders.
      names: C(ROS_MASTER_URI), and C(ROS_HOSTNAME) or C(ROS_IP), and nothing else.
      none: Nothing.
    default: all
"""

EXAMPLES = r"""
- name: Own the files of the environment
  rosfleet.multimaster.managed_files:
    bundle: environment
    files: "{{ rendered.files }}"
  vars:
    ros: "{{ multimaster_info.ros.chosen }}"
    rendered: >-
      {{ multimaster_plan.environment | rosfleet.multimaster.environment_files(
           multimaster_info, ros=ros.environment, for_root=ros.for_root, person=ros.person) }}
"""

RETURN = r"""
_value:
  description: The files, and a sentence for each way that this machine does not let the environment take.
  type: dict
  contains:
    files:
      description: The files to own, each with C(path), C(content), C(mode) and, if the program that reads it can check it, C(validate).
      type: list
      elements: dict
    notes:
      description: The sentences.
      type: list
      elements: str
    digest:
      description: A SHA-256 over the files that systemd's units read, to restart them exactly when that changes.
      type: str
"""

import re
from collections.abc import Mapping
from typing import Any

from ansible.errors import AnsibleFilterError

from ..plugin_utils._plan import environment as environment_module

REACHES = ("all", "names", "none")


def environment_files(
    ours: Any, machine: Any, ros: Any = None, for_root: Any = None, person: str = "", reach: str = "all"
) -> dict[str, Any]:
    """Return files and notes for one machine; see DOCUMENTATION."""
    if ours == {}:
        return {"files": [], "notes": [], "digest": ""}
    if not isinstance(ours, Mapping) or not ours.get("ROS_MASTER_URI"):
        raise AnsibleFilterError(
            f"The environment to render is {ours!r}; expected a mapping with ROS_MASTER_URI: "
            "set environment_variables, or let the role preflight make the plan first."
        )
    if not isinstance(machine, Mapping) or "sshd" not in machine:
        raise AnsibleFilterError(
            f"The machine is described by {machine!r}; expected the return of "
            "rosfleet.multimaster.multimaster_info: set environment_machine, or let the role preflight look first."
        )
    if not re.fullmatch(r"\*|([A-Za-z_][A-Za-z0-9_.-]*)?", person):
        raise AnsibleFilterError(
            f"The user who gets the environment is {person!r}; expected the name of an account, '*', or nothing: correct environment_person."
        )
    if reach not in REACHES:
        raise AnsibleFilterError(
            f"The reach of shells is {reach!r}; expected one of {', '.join(REACHES)}: correct environment_reach or multimaster_shells."
        )
    environment = environment_module.merge_for_users(ros or {}, for_root or {}, person, ours)
    return {
        "files": environment_module.render_files(environment, machine, reach),
        "notes": environment_module.find_gaps(machine, environment_module.narrow(environment, reach)),
        "digest": environment_module.compute_digest(environment),
    }


class FilterModule:
    """Ansible's way to find the filter."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"environment_files": environment_files}
