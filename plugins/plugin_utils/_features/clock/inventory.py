# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The source of the fleet's time: the computer that the variable names."""

from __future__ import annotations

from ..._base.sentences import nearest
from ..._inventory.hooks import InventoryHooks
from ..._inventory.model import Computer, Fleet
from .variables import ClockVariables


def find_source(fleet: Fleet) -> Computer | None:
    """Return the source of the fleet's time. None without one, and for a name that no computer or robot has."""
    return fleet.named.get(ClockVariables.read(fleet.variables).clock or "")


def find_wrong_source(fleet: Fleet) -> list[str]:
    """Return a sentence if the source of the fleet's time is no computer of the fleet, or a computer without a login."""
    wanted, source = ClockVariables.read(fleet.variables).clock, find_source(fleet)
    if source is not None and source.sealed:
        found = f"{source.name} is sealed, so nobody logs in there to see to its clock"
    elif wanted and source is None:
        known = [*(robot.name for robot in fleet.robots), *(computer.name for computer in fleet.computers)]
        found = f"there is no such computer and no such robot{nearest(wanted, known)}"
    else:
        return []
    return [
        f"multimaster_clock is '{wanted}', but {found}; expected a computer of a robot, or a robot: correct it in group_vars/robots.yml."
    ]


HOOKS = InventoryHooks(find_contradictions=find_wrong_source)
