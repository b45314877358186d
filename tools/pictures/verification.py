# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The life of a verification: what happens on your computer, and what on all others, in the order of the role's tasks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import yaml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS

from .sheet import EDGE, LINE, WIDTH, Sheet
from .shipped import ROOT

ROLE = ROOT / "roles/verify"
GAP = 26  # between two steps, for an arrow


class Step(NamedTuple):
    """A box: the tasks that it shows, its place, and its lines."""

    tasks: tuple[str, ...]
    there: bool  # on the computers of the fleet
    lines: tuple[str, ...]


def list_steps(defaults: dict[str, Any]) -> Iterator[Step]:
    """Yield the steps in their order."""
    yield Step(("Make the plan", "Choose a label for this run"), False, ("plan", "from the inventory,", "with a label"))
    yield Step(
        (
            "Look at the machine, listen on the multicast group, and publish a topic",
            "Compare the plan with the machine",
        ),
        True,
        ("start", "look at the machine,", "hear the group,", "publish a topic"),
    )
    yield Step(
        ("Measure how every computer sees the others",),
        True,
        ("measure", "all at the same time:", "names, ping, ports,", "datagrams, topics"),
    )
    yield Step(
        ("Choose the packets to trace", "Trace packets"),
        True,
        ("trace packets", "only where packets", "were lost"),
    )
    seconds = defaults["verify_lifetime"]
    yield Step(("Stop publishing",), True, ("stop", "always, at the latest", f"after {seconds} s"))
    yield Step(
        ("Judge the measurements",),
        False,
        ("judge", f"{len(CHECKS)} kinds of checks,", "then their causes:", "findings"),
    )
    yield Step(
        ("Report the result",),
        False,
        ("report", "terminal, page, data;", "a failed check", "fails the run"),
    )
    yield Step(("Watch for a while",), True, ("watch", "if you ask for it,", "if nothing failed"))


def _list_names(tasks: Iterable[dict[str, Any]]) -> Iterator[str]:
    for task in tasks:
        yield task["name"]
        for part in ("block", "rescue", "always"):
            yield from _list_names(task.get(part, ()))


def check_order(steps: Iterable[Step]) -> None:
    """Raise ValueError unless the role has the tasks of these steps in their order."""
    names = list(_list_names(yaml.safe_load((ROLE / "tasks/main.yml").read_text(encoding="utf-8"))))
    shown = [task for step in steps for task in step.tasks]
    lost = [task for task in shown if task not in names]
    if lost or shown != sorted(shown, key=names.index):
        raise ValueError(
            f"the picture of the verification has other tasks than the role, or another order: {lost or shown}"
        )


def draw_verification() -> str:
    """Draw the steps of a verification in two columns."""
    steps = list(list_steps(yaml.safe_load((ROLE / "defaults/main.yml").read_text(encoding="utf-8"))))
    check_order(steps)
    sheet = Sheet()
    wide = (WIDTH - 5 * EDGE) / 2
    columns = (EDGE, WIDTH - EDGE - wide)
    y, last = 46.0, None
    for step in steps:
        x = columns[step.there] + 8
        high = LINE * len(step.lines) + 10
        if last is not None:
            before, end = last
            if before == x:
                sheet.arrow(complex(x + 40, end), complex(x + 40, y))
            else:
                _turn(sheet, before, end, x, y + 20, wide - 16)
        sheet.box(x, y, wide - 16, step.lines)
        last = (x, y + high)
        y += high + GAP
    height = y - GAP + 12
    for x, title in zip(columns, ("your computer", "all computers")):
        sheet.frame(x, EDGE, wide, height - EDGE)
        sheet.text(x + wide / 2, 32, title, "strong middle")
    return sheet.finish(
        int(height + EDGE),
        "The life of a verification",
        " ".join(
            f"{'On all computers' if step.there else 'On your computer'}, {' '.join(step.lines)}." for step in steps
        ),
    )


def _turn(sheet: Sheet, before: float, end: float, x: float, y: float, wide: float) -> None:
    """Draw an arrow from below a box to the side of a box in the other column."""
    corner = complex(before + wide / 2, y)
    sheet.line(complex(before + wide / 2, end), corner)
    sheet.arrow(corner, complex(x if x > before else x + wide, y))
