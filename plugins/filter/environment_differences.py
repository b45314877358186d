# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The door from Ansible to the pure comparison of the environment as planned and as it arrives."""

from __future__ import annotations

DOCUMENTATION = r"""
name: environment_differences
short_description: What of the planned environment of ROS does not arrive in shells
version_added: "0.1.0"
description:
  - Compares the variables of the plan with what M(rosfleet.multimaster.multimaster_info) read back from a machine.
author:
  - rosfleet contributors (@rosfleet)
positional: _input, seen, files, exports
options:
  _input:
    description: The variables of the plan, for example C(ROS_MASTER_URI) V(http://kobuki1computer:11311).
    type: dict
    required: true
  seen:
    description: The value RV(rosfleet.multimaster.multimaster_info#module:environment).
    type: dict
    required: true
  files:
    description: The files of P(rosfleet.multimaster.environment_files#filter). What has no file is not compared.
    type: list
    elements: dict
    required: true
  exports:
    description:
      - The value RV(rosfleet.multimaster.multimaster_info#module:exports). A variable that an older file sets in login
        shells is not compared there, since that file is named already.
    type: list
    elements: dict
    default: []
"""

EXAMPLES = r"""
- name: Refuse an environment that does not arrive
  ansible.builtin.assert:
    that: differences == []
    fail_msg: "{{ differences | join(' ') }}"
  vars:
    ours: "{{ multimaster_plan.environment }}"
    differences: "{{ ours | rosfleet.multimaster.environment_differences(seen.environment, rendered.files) }}"
"""

RETURN = r"""
_value:
  description: One sentence for each variable that differs, naming what was found, what was expected, and where.
  type: list
  elements: str
"""

from collections.abc import Mapping, Sequence
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import environment


def environment_differences(
    ours: Mapping[str, str],
    seen: Mapping[str, Mapping[str, str] | None],
    files: Sequence[Mapping[str, str]],
    exports: Sequence[Mapping[str, Any]] = (),
) -> list[str]:
    """Return a sentence for each variable that does not arrive; see DOCUMENTATION."""
    return environment.differences(
        ours, seen, [file["path"] for file in files], [export["variable"] for export in exports]
    )


class FilterModule:
    """Ansible's way to find the filter."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"environment_differences": environment_differences}
