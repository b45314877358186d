# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A robot that boots without a network, gets one, loses it, and has it again: what runs in each of these times."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import ComputerPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.units import (
    OF_FEATURES,
    SYSTEM_PYTHON,
    Unit,
    render_programs,
    render_services,
)

from .sheet import EDGE, WIDTH, Sheet
from .shipped import find_master, read_plan

LEFT = 118  # of the times
ROW = 30
TIMES = ("no network", "network", "lost", "back")
SHARES = (0.0, 0.3, 0.56, 0.8, 1.0)  # where each begins, and the end

_ORDER = re.compile(r"^(After|Requires|Wants|BindsTo)=(.+)$", re.MULTILINE)


def check_units(units: Iterable[Unit]) -> None:
    """Raise ValueError if a unit waits for a network: then the picture is wrong."""
    for unit in units:
        waits = [found[2] for found in _ORDER.finditer(unit["content"]) if "network" in found[2]]
        if waits:
            raise ValueError(f"{unit['name']} waits for {waits}, and the picture of a boot says that no unit does")


def draw_alone() -> str:
    """Draw the services of a robot over four times of its network."""
    fleet = read_plan("single_computer")
    plan = find_master(fleet, next(iter(fleet.master_of)))
    names = [name for name in plan.services if name not in OF_FEATURES]
    check_units(_render_units(plan, names))
    sheet = Sheet()
    wide = WIDTH - EDGE - LEFT
    starts = [LEFT + share * wide for share in SHARES]
    y = 60.0
    for words, begin, end in zip(TIMES, starts, starts[1:]):
        there = words in ("network", "back")
        sheet.text((begin + end) / 2, 28, words, "middle strong" if there else "middle")
        sheet.stripe(begin + 2, 36, end - begin - 4, 10, "bar" if there else "off")
    patience = plan.discovery["offline_after"]
    y = _draw_rows(sheet, names, starts, y)
    sheet.text(EDGE, y + 10, "the exchange", "strong")
    sheet.text(EDGE, y + 27, "with others", "strong")
    late = 22
    for begin, end in ((starts[1] + 6, starts[2] + late), (starts[3] + 6, starts[4])):
        sheet.stripe(begin, y + 8, end - begin, 12)
    sheet.line(complex(starts[2], 48), complex(starts[2], y + 40), "life")
    sheet.line(complex(starts[2] + late, y + 20), complex(starts[2] + late, y + 40), "life")
    sheet.text(starts[2] + 4, y + 56, f"{patience:g} s later", "soft")
    for start in (starts[1], starts[3]):
        sheet.line(complex(start, 48), complex(start, y + 40), "life")
    sheet.text(starts[0], y + 56, "no service waits", "soft")
    return sheet.finish(
        int(y + 70),
        "A robot that boots without a network",
        f"The services {', '.join(names)} and your own nodes start at boot and go on, whether there is a network or not. The exchange "
        f"with other robots begins when the network comes, ends {patience:g} s after it is lost, and begins again when it is back.",
    )


def _render_units(plan: ComputerPlan, names: Sequence[str]) -> list[Unit]:
    """Return the units of these services as they are on the computer of a master."""
    return render_services(
        names,
        robot=plan.robot,
        address=str(plan.address),
        roscore_command="/usr/bin/roscore",
        roscore_port=plan.roscore_port,
        programs=render_programs(plan.provider, SYSTEM_PYTHON, {}, plan.roscore_port),
        environment_digest="",
        files={},
    )


def _draw_rows(sheet: Sheet, names: list[str], starts: list[float], y: float) -> float:
    """Draw a bar from the boot to the end for each service, in the order of their starts; return the next height."""
    for number, name in enumerate([*names, "your nodes"]):
        begin = starts[0] + 4 + 6 * number
        sheet.text(EDGE, y + 12, name)
        sheet.stripe(begin, y + 3, starts[-1] - begin, 10)
        y += ROW
    return y
