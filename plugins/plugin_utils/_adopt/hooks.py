# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The findings of an optional feature on machines that people set up by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .proposal import Choices

if TYPE_CHECKING:
    from .scene import AdoptionScene


@dataclass(frozen=True)
class AdoptHooks:
    """The functions of a feature: its facts of a machine, and the variables that it proposes for the fleet."""

    #: by the answer of multimaster_info, which may have any values; it raises LookupError, TypeError or ValueError
    read: Callable[[Mapping[str, Any]], Any]
    choose: Callable[[AdoptionScene], Choices]
