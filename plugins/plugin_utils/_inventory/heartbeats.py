# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks whether discovery can work: heartbeats come often enough, and reach each master."""

from __future__ import annotations

import math
from dataclasses import replace
from ipaddress import IPv4Network

from .model import Fleet

# Routers pass none of these groups on (RFC 5771).
LOCAL_GROUPS = IPv4Network("224.0.0.0/24")


def _tenths(rate: float) -> int:
    """Return a rate in tenths of a heartbeat per second. A heartbeat carries its rate in whole tenths."""
    return int(rate * 10)


def default_offline_after(rate: float) -> float:
    """Return the seconds from the loss of a robot until it is withdrawn: the time of two heartbeats, at least 5.

    A robot without promised heartbeats is asked, and withdrawn after 65 s (the nodes' discovery/core/peers.py).
    """
    return max(5.0, math.ceil(200 / _tenths(rate)) / 10) if _tenths(rate) else 65.0


def fill_offline_after(fleet: Fleet) -> Fleet:
    """Return the fleet with the default seconds of silence, unless the inventory sets some."""
    after = fleet.variables.offline_after or default_offline_after(fleet.variables.heartbeat_hz)
    return replace(fleet, variables=replace(fleet.variables, offline_after=after))


def find_slow_heartbeats(rate: float | None, after: float | None) -> list[str]:
    """Return a sentence if `after` seconds have less than two heartbeats: a slow rate would look like silence."""
    if rate is None or after is None:
        return []
    tenths = _tenths(rate)
    if tenths * after >= 20:
        return []
    longer = f" or multimaster_offline_after to {default_offline_after(rate):g}" if tenths else ""
    return [
        f"multimaster_heartbeat_hz is {rate:g} and multimaster_offline_after is {after:g}, so a robot promises {tenths * after / 10:.2g} "
        f"heartbeats in that time; expected at least 2: raise multimaster_heartbeat_hz to {math.ceil(20 / after) / 10:g}{longer} "
        "in group_vars/robots.yml."
    ]


def find_unreachable_masters(fleet: Fleet) -> list[str]:
    """Return a sentence for each master that gets no heartbeat, since multicast does not cross a gateway by itself."""
    group, routing = fleet.variables.multicast_group, fleet.multicast_routing
    if fleet.variables.transport != "multicast" or len(fleet.robots) < 2:
        return []
    return [
        f"{robot.companion.name}: is the {'companion of the ' if robot.master.sealed else ''}master of the robot {robot.name} behind "
        f"the gateway {robot.gateway.title}, and "
        f"multimaster_transport is 'multicast'; expected a way to it, since nobody passes {group} on there: set multimaster_transport to "
        "'both'"
        + (" or multimaster_multicast_routing to 'smcroute'" if robot.gateway.name else "")
        + f", or choose the gateway as multimaster_{'companion' if robot.master.sealed else 'master'}."
        for robot in fleet.robots
        if robot.gateway and not robot.companion.common_address and (routing == "none" or not robot.gateway.name)
    ]
