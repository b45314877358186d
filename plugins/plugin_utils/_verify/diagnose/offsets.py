# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""By how much a clock is off, and from whose: pure, a component and the rows that it explains in, a text out."""

from __future__ import annotations

from collections.abc import Iterable
from statistics import median

from ..._base.features import load_hooks
from ..._base.sentences import shorten_list
from ..checks.engine import Row
from ..checks.hooks import CheckHooks
from ..components.component import Component


def offset(component: Component, rows: Iterable[Row]) -> str:
    """Say by how much, such as "2.0 s ahead of dabo-gate and tibi-gate"; empty if nothing was measured."""
    found: dict[str, float] = {}
    for row in rows:
        seconds = _seconds(row)
        if seconds is not None and component.place in (row.observer, row.target):
            ahead, other = (seconds, row.observer) if row.target == component.place else (-seconds, row.target)
            found.setdefault("its source" if other == component.place else other, ahead)
    if not found:
        return ""
    middle, others = median(found.values()), sorted(found)
    whose = " and ".join(others) if len(others) < 3 else shorten_list(others)
    return f"{_amount(abs(middle))} {'ahead of' if middle > 0 else 'behind'} {whose}"


def _amount(seconds: float) -> str:
    """Write a duration as people say it: a clock that starts at 1970 is years behind."""
    for size, unit in ((86400 * 365, "years"), (86400, "days"), (3600, "hours")):
        if seconds >= 2 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.2f} s" if seconds < 1 else f"{seconds:.1f} s"


def _list_checks() -> tuple[str, ...]:
    """List the checks that find by how much a clock is off."""
    return "clock", *(check for hooks in load_hooks("checks", CheckHooks).values() for check in hooks.offset_checks)


def _seconds(row: Row) -> float | None:
    """Read the seconds that a check of clocks has found, such as "+2.0003 s"; None in another text."""
    number, _space, unit = row.found.partition(" ")
    try:
        return float(number) if row.check in _list_checks() and unit == "s" else None
    except ValueError:
        return None
