# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The part of an optional feature in the needs of an observation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from ..components.parts import Component
from .case import Case


@dataclass(frozen=True)
class ContextHooks:
    """The parts of a feature that packets need."""

    #: on the way between these places on the common network
    list_way_parts: Callable[[Case, Sequence[str]], frozenset[Component]] = lambda case, places: frozenset()
    #: for large packets at this place on the common network
    list_large_parts: Callable[[Case, str], frozenset[Component]] = lambda case, place: frozenset()
    #: for the planned routes of this computer to come first
    list_route_parts: Callable[[str], frozenset[Component]] = lambda computer: frozenset()
    #: its service -> the kind and mode of what is broken while that is down
    services: Mapping[str, tuple[str, str]] = field(default_factory=dict)
