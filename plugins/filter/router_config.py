# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The filter router_config: configuration of routers and gateways of other makes."""

from __future__ import annotations

DOCUMENTATION = r"""
name: router_config
short_description: The way to the networks of the robots, for routers and gateways of other makes
version_added: "1.0.0"
description:
  - Renders the static routes of the fleet's plan as configuration to paste, for the router of the common network and for
    every gateway of a robot that is no computer of the inventory (section 4.2 of the report).
  - If the language of the device has a place for it, the files also keep addresses between robots from being
    translated, and the router from sending ICMP redirects.
  - Each file begins with a comment that says its purpose and its use, and comes with a file that takes it
    back.
author:
  - rosfleet contributors (@rosfleet)
positional: _input, dialects, interfaces
options:
  _input:
    description: The return of M(rosfleet.multimaster.fleet_plan).
    type: dict
    required: true
  dialects:
    description:
      - The languages to write, for example V([openwrt]). All of them, if it is not set.
      - The table in C(docs/start/router.md) lists them.
    type: list
    elements: str
  interfaces:
    description:
      - >-
        The interface of the common network if it is not the maker's usual one, by device and dialect, for example
        V({router: {ios: GigabitEthernet0/1}, gateway-tibi: {openwrt: lan}}).
    type: dict
    default: {}
"""

EXAMPLES = r"""
- name: Compute the plan of the fleet
  rosfleet.multimaster.fleet_plan:
  register: fleet

- name: Show the commands to paste into a router under OpenWrt
  ansible.builtin.debug:
    msg: "{{ (fleet | rosfleet.multimaster.router_config(dialects=['openwrt']) | first).content }}"
"""

RETURN = r"""
_value:
  description:
    - The files, each with C(path), relative, and C(content).
    - The folder of the path is the device, C(router) or C(gateway-) and the robot. Empty if no robot has a network of
      its own.
  type: list
  elements: dict
  contains:
    path:
      description: The path of the file below a folder of the caller's choice.
      type: str
      sample: router/openwrt.sh
    content:
      description: Its text.
      type: str
"""

from collections.abc import Mapping, Sequence
from typing import Any

from ansible.errors import AnsibleFilterError

from ..plugin_utils._base.plain import Mismatch, from_plain
from ..plugin_utils._plan import router_config as router_config_module
from ..plugin_utils._plan.dialects import DIALECTS
from ..plugin_utils._plan.model import FleetPlan


def router_config(plan: Any, dialects: Sequence[str] | None = None, interfaces: Any = None) -> list[dict[str, str]]:
    """Return the files for all devices; see DOCUMENTATION."""
    dialects = tuple(DIALECTS) if dialects is None else dialects
    if not isinstance(plan, Mapping) or "networks" not in plan:
        raise AnsibleFilterError(
            f"The plan to render is {plan!r}; expected the return of rosfleet.multimaster.fleet_plan: register it first."
        )
    if isinstance(dialects, str) or not isinstance(dialects, Sequence):
        raise AnsibleFilterError(
            f"router_config_dialects is {dialects!r}; expected a list such as [openwrt]: correct it."
        )
    if interfaces is not None and not isinstance(interfaces, Mapping):
        raise AnsibleFilterError(
            f"router_config_interfaces is {interfaces!r}; expected a mapping such as {{router: {{ios: Vlan1}}}}: correct it."
        )
    try:
        return router_config_module.render_config(from_plain(FleetPlan, plan), dialects, interfaces)
    except (Mismatch, router_config_module.RouterConfigProblem) as problem:
        raise AnsibleFilterError(str(problem)) from problem


class FilterModule:
    """Ansible's way to find the filter."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"router_config": router_config}
