# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The filter clock_files: what chrony reads on a computer whose clock follows another, for the role clock."""

from __future__ import annotations

DOCUMENTATION = r"""
name: clock_files
short_description: The files of chrony on a computer of the fleet
version_added: "1.1.0"
description:
  - Renders the configuration of chrony, and the drop-in of its unit that leads to it.
  - Without a plan there is nothing to render, so the list is empty.
author:
  - rosfleet contributors (@rosfleet)
positional: _input
options:
  _input:
    description: >-
      The key C(clock) of the plan of a computer, for example V({source: tibi-nav, server: 192.168.1.201}), or empty.
    type: dict
    required: true
"""

EXAMPLES = r"""
- name: Own the files of chrony
  rosfleet.multimaster.managed_files:
    bundle: clock
    files: "{{ {'source': 'tibi-nav', 'server': '192.168.1.201', 'networks': []} | rosfleet.multimaster.clock_files }}"
"""

RETURN = r"""
_value:
  description: The option O(rosfleet.multimaster.managed_files#module:files), two files or none.
  type: list
  elements: dict
"""

from collections.abc import Mapping
from typing import Any

from ansible.errors import AnsibleFilterError

from ..plugin_utils._base.plain import from_plain
from ..plugin_utils._features.clock.model import Clock
from ..plugin_utils._features.clock.plan import render_clock


def clock_files(plan: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return the files; see DOCUMENTATION."""
    try:
        return render_clock(from_plain(Clock, plan) if plan else None)
    except (TypeError, ValueError) as problem:
        raise AnsibleFilterError(f"The plan of the clock is wrong: {problem}.") from problem


class FilterModule:
    """Ansible's way to find the filter."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"clock_files": clock_files}
