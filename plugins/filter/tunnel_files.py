# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The filter tunnel_files: what wg-quick reads on a computer of the tunnel, for the role tunnel."""

from __future__ import annotations

DOCUMENTATION = r"""
name: tunnel_files
short_description: The files of the tunnel on a computer
version_added: "1.1.0"
description:
  - Renders the configuration of WireGuard without a private key. The rules against packets that come from outside of the tunnel are those of
    the packet filter.
  - Without a plan there is nothing to render, so the list is empty.
author:
  - rosfleet contributors (@rosfleet)
positional: _input
options:
  _input:
    description: The key C(tunnel) of the plan of a computer, or empty.
    type: dict
    required: true
  keys:
    description: The public keys by computer, as M(rosfleet.multimaster.fleet_keys) returns them.
    type: dict
    default: {}
"""

EXAMPLES = r"""
- name: Own the files of the tunnel
  rosfleet.multimaster.managed_files:
    bundle: tunnel
    files: "{{ multimaster_plan.tunnel | rosfleet.multimaster.tunnel_files(gathered.keys_by_computer) }}"
"""

RETURN = r"""
_value:
  description: The option O(rosfleet.multimaster.managed_files#module:files), three files or none.
  type: list
  elements: dict
"""

from collections.abc import Mapping
from typing import Any

from ansible.errors import AnsibleFilterError

from ..plugin_utils._base.plain import Mismatch, from_plain
from ..plugin_utils._features.tunnel.files import render_tunnel
from ..plugin_utils._features.tunnel.model import Tunnel


def tunnel_files(plan: Mapping[str, Any], keys: Mapping[str, str] | None = None) -> list[dict[str, str]]:
    """Return the files; see DOCUMENTATION."""
    try:
        return render_tunnel(from_plain(Tunnel, plan) if plan else None, keys or {})
    except Mismatch as problem:
        raise AnsibleFilterError(f"The plan of the tunnel is wrong: {problem}") from problem


class FilterModule:
    """Ansible's way to find the filter."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"tunnel_files": tunnel_files}
