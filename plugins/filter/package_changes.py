# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The filter package_changes: which Debian packages to install, to remove and to record, for the role nodes."""

from __future__ import annotations

DOCUMENTATION = r"""
name: package_changes
short_description: The Debian packages to install, to remove and to record
version_added: "0.1.0"
description:
  - Compares the packages that are wanted with those that are installed, and with those that the collection has installed.
  - A package that was there before the collection is never removed, and never recorded.
author:
  - rosfleet contributors (@rosfleet)
positional: _input, found
options:
  _input:
    description: The packages that are wanted, for example V([ros-noetic-fkie-master-sync]).
    type: list
    elements: str
    required: true
  found:
    description: The value RV(rosfleet.multimaster.multimaster_info#module:packages).
    type: list
    elements: dict
    required: true
"""

EXAMPLES = r"""
- name: Install what is missing
  ansible.builtin.apt:
    name: "{{ (multimaster_plan.packages | rosfleet.multimaster.package_changes(multimaster_info.packages)).new }}"
"""

RETURN = r"""
_value:
  description: The names of the packages.
  type: dict
  contains:
    new:
      description: The wanted packages that are not installed.
      type: list
      elements: str
    leftover:
      description: The packages that the collection has installed for an earlier plan, and that are wanted no more.
      type: list
      elements: str
    files:
      description: The record of the packages of the collection, one file as M(rosfleet.multimaster.managed_files) takes it, or none.
      type: list
      elements: dict
"""

from collections.abc import Mapping, Sequence
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import packages


def package_changes(wanted: Sequence[str], found: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what to install, to remove and to record; see DOCUMENTATION."""
    installed = [package["name"] for package in found if package["installed"]]
    ours = [package["name"] for package in found if package["ours"]]
    changes = packages.changes(wanted, installed, ours)
    return {
        "new": list(changes.new),
        "leftover": list(changes.leftover),
        "files": [{"path": packages.RECORD, "content": changes.record}] if changes.record else [],
    }


class FilterModule:
    """Ansible's way to find the filter."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"package_changes": package_changes}
