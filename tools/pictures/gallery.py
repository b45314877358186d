# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The pictures of the pages: the name of each file in docs/images, and the function that draws it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from .alone import draw_alone
from .data_flow import draw_data_flow
from .fleets import draw_multi_computer, draw_programs, draw_single_computer
from .relay import draw_relay
from .sequences import draw_exchange, draw_protocol
from .shipped import ROOT
from .verification import draw_verification

FOLDER = ROOT / "docs/images"
PICTURES: Mapping[str, Callable[[], str]] = {
    "single_computer": draw_single_computer,
    "multi_computer": draw_multi_computer,
    "programs": draw_programs,
    "exchange": draw_exchange,
    "protocol": draw_protocol,
    "verification": draw_verification,
    "data_flow": draw_data_flow,
    "relay": draw_relay,
    "alone": draw_alone,
}
