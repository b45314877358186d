# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The component of an optional feature in the needs of an observation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from ..components.component import Component
from .check_context import CheckContext


@dataclass(frozen=True)
class ContextHooks:
    """The components of a feature that packets need."""

    #: on the way between these places on the common network
    list_way_components: Callable[[CheckContext, Sequence[str]], frozenset[Component]] = lambda context, places: (
        frozenset()
    )
    #: for large packets at this place on the common network
    list_large_components: Callable[[CheckContext, str], frozenset[Component]] = lambda context, place: frozenset()
    #: for the planned routes of this computer to come first
    list_route_components: Callable[[str], frozenset[Component]] = lambda computer: frozenset()
    #: its service -> the kind and mode of the component that is broken while that is down
    services: Mapping[str, tuple[str, str]] = field(default_factory=dict)
