# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The checks of the verification, one table: the rows of each file of this folder, in the order of FILES, and those of the optional features.

In each file a row is below its functions, and above its judge.
"""

from __future__ import annotations

from collections.abc import Iterator

from ..._base.features import load_hooks
from . import (
    computer,
    discovery_nodes,
    exchange,
    manual_setup,
    network,
    next_boot,
    programs,
    relay,
    ros,
    strangers,
)
from .engine import Check
from .hooks import CheckHooks

FILES = (
    computer,
    manual_setup,
    next_boot,
    programs,
    network,
    discovery_nodes,
    ros,
    exchange,
    relay,
    strangers,
)


def _list_checks() -> Iterator[Check]:
    """Yield the checks in their order: those of a file, then those that optional features add behind it."""
    features = load_hooks("checks", CheckHooks).values()
    for file in FILES:
        yield from (row for row in vars(file).values() if isinstance(row, Check))
        for hooks in features:
            if file.__name__.endswith(f".{hooks.after}"):
                yield from hooks.checks


CHECKS = tuple(_list_checks())
TITLES = {check.id: check.title for check in CHECKS}
