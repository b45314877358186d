# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The filter throughput_streams: which computer sends a stream to which, for the role verify."""

from __future__ import annotations

DOCUMENTATION = r"""
name: throughput_streams
short_description: The streams that measure the throughput between computers
version_added: "1.0.0"
description:
  - Each computer sends to those that it tries; see P(rosfleet.multimaster.computers_tried#filter). One stream is sent at a time. All
    together take 300 seconds at most. If that is not enough, each computer sends only to some of those that it tries.
author:
  - rosfleet contributors (@rosfleet)
positional: _input, seconds, pairs, least, hosts
options:
  _input:
    description: The return of M(rosfleet.multimaster.fleet_plan).
    type: dict
    required: true
  seconds:
    description: How many seconds a stream takes, from 0.1 to 2, for example V(0.5); V(0) for no streams.
    type: float
    required: true
  pairs:
    description: Which pairs are tried, V(auto) or V(all); see P(rosfleet.multimaster.computers_tried#filter).
    type: str
    choices: [auto, all]
    default: auto
  least:
    description: How many Mbit/s are expected, from 0 to 1000000, for example V(20). Another value is refused; the streams do not depend on it.
    type: float
    default: 0
  hosts:
    description: The computers of the run, as for P(rosfleet.multimaster.computers_tried#filter). By default all of the plan.
    type: list
    elements: str
    version_added: "1.1.0"
"""

EXAMPLES = r"""
- name: Say to whom this computer sends
  ansible.builtin.debug:
    msg: "{{ (multimaster_fleet | rosfleet.multimaster.throughput_streams(0.5)).to[inventory_hostname] }}"
"""

RETURN = r"""
_value:
  description: The names of the computers to which each one sends, empty for no streams, and how many seconds all streams take at most.
  type: dict
  sample: {to: {kobuki1computer: [kobuki2computer], kobuki2computer: [kobuki1computer]}, seconds: 7}
"""

import math
from collections.abc import Collection, Mapping
from typing import Any

from ansible.errors import AnsibleFilterError

from ..plugin_utils._verify.context import pairs as tried

MOST = 1_000_000  # Mbit/s


def throughput_streams(
    fleet: Mapping[str, Any],
    seconds: Any,
    pairs: str = tried.AUTO,
    least: Any = 0,
    hosts: Collection[str] | None = None,
) -> dict[str, Any]:
    """Return which computer sends to which; see DOCUMENTATION. Raises AnsibleFilterError."""
    length = _read_number(
        "verify_throughput", seconds, tried.SHORTEST, tried.LONGEST, "0, or the seconds of a stream, from 0.1 to 2"
    )
    _read_number("verify_throughput_least", least, 0, MOST, f"a number of Mbit/s from 0 to {MOST}")
    if not length:
        return {"to": {}, "seconds": 0}
    networks = {member["name"]: str(member["network"]) for member in fleet["members"]}
    open_ones = [name for name in networks if not fleet["computers"][name].get("sealed")]
    run = set(open_ones if hosts is None else hosts)
    senders = [name for name in open_ones if name in run]
    to = tried.streams(tried.choose_pairs(networks, senders, pairs), open_ones, length)
    return {"to": to, "seconds": math.ceil(tried.number(to) * length + len(to) * tried.START)}


def _read_number(variable: str, value: Any, least: float, most: float, expected: str) -> float:
    """Read a number; 0 and false are always good. Raises AnsibleFilterError."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = -1.0 if str(value).lower() not in ("false", "no") else 0.0
    if number and not least <= number <= most:
        raise AnsibleFilterError(f"{variable} is {value!r}, expected {expected}.")
    return number


class FilterModule:
    """Ansible's way to find the filter."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"throughput_streams": throughput_streams}
