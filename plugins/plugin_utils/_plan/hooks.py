# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The part of an optional feature in the plan of a computer, and in its comparison with the machine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from .._inventory.model import Computer, Fleet, Robot
from .model import ComputerPlan, PlanPart

Info = Mapping[str, Any]  # the result of multimaster_info


@dataclass(frozen=True)
class PlanHooks:
    """The functions of a feature for one computer, in the order in which they are called."""

    #: its part of the plan; None if the computer needs none
    make_part: Callable[[Fleet, Robot, Computer], PlanPart | None]
    #: the parts of multimaster_info that it needs of the machine of each computer with ROS
    list_facts: Callable[[Fleet], Iterable[str]] = lambda fleet: ()
    #: a sentence for each reason against it on this machine
    find_problems: Callable[[ComputerPlan, Info], Iterable[str]] = lambda plan, info: ()
    #: a sentence for each thing that is left as it is
    list_warnings: Callable[[ComputerPlan, Info], Iterable[str]] = lambda plan, info: ()
    #: its part of the plan with the values that only the machine knows
    fill: Callable[[ComputerPlan, Any, Info], PlanPart] = lambda plan, part, info: part
    #: the Debian packages that it needs; the plan is filled in
    list_packages: Callable[[ComputerPlan, Info], Iterable[str]] = lambda plan, info: ()


@dataclass(frozen=True)
class UnitHooks:
    """The units of a feature: service -> its text, as units.py completes it. It depends on its own inputs, and on no file of the nodes."""

    services: Mapping[str, str]
