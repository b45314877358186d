# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The checks of an optional feature."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..context.check_context import CheckContext
from ..context.needs import Components
from .engine import Check


@dataclass(frozen=True)
class CheckHooks:
    """The checks of a feature. Only an earlier check can explain a later one: theirs come behind those of a file of the core."""

    checks: tuple[Check, ...]
    after: str  # the name of that file
    #: those of them that find by how many seconds a clock is off
    offset_checks: tuple[str, ...] = ()
    #: the components on which the clock of a computer depends, if the feature keeps it right
    list_clock_components: Callable[[CheckContext, str], Components] = lambda context, computer: frozenset()
