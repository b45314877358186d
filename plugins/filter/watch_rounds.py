# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The filter watch_rounds: a duration and its rounds, for the role verify."""

from __future__ import annotations

DOCUMENTATION = r"""
name: watch_rounds
short_description: The rounds of a watch over the fleet
version_added: "1.0.0"
description:
  - Reads how long to watch, and says when progress is reported. A round takes 15 seconds, and more in a watch of more than a quarter of an
    hour, 300 seconds at most.
author:
  - rosfleet contributors (@rosfleet)
positional: _input
options:
  _input:
    description: The duration in seconds, or with a unit, for example V(90), V(90s), V(15m), V(2h) or V(1d).
    type: str
    required: true
"""

EXAMPLES = r"""
- name: Say when progress is reported
  ansible.builtin.debug:
    msg: "{{ ('15m' | rosfleet.multimaster.watch_rounds).ends }}"
"""

RETURN = r"""
_value:
  description: The duration in seconds, and the ends of the rounds in seconds after the start.
  type: dict
  sample: {seconds: 40, ends: [15, 30, 40]}
"""

from typing import Any

from ansible.errors import AnsibleFilterError

from ..plugin_utils._verify.watch.progress import UnreadableDuration, plan_rounds


def watch_rounds(duration: Any) -> dict[str, Any]:
    """Return the duration and the ends of the rounds; see DOCUMENTATION. Raises AnsibleFilterError."""
    try:
        ends = plan_rounds(str(duration))
    except UnreadableDuration as problem:
        raise AnsibleFilterError(str(problem)) from problem
    return {"seconds": ends[-1], "ends": ends}


class FilterModule:
    """Ansible's way to find the filter."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"watch_rounds": watch_rounds}
