# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The checks of the verification, one table: the rows of each file beside this one, in the order of FILES.

In each file a row stands below its functions, and above its judge.
"""

from __future__ import annotations

from . import (
    border,
    computer,
    discovery_nodes,
    exchange,
    manual_setup,
    network,
    next_boot,
    programs,
    ros,
    strangers,
    time_sources,
    tunnel,
)
from .engine import Check

FILES = (
    computer,
    manual_setup,
    next_boot,
    programs,
    tunnel,
    network,
    time_sources,
    discovery_nodes,
    ros,
    exchange,
    border,
    strangers,
)
CHECKS = tuple(row for file in FILES for row in vars(file).values() if isinstance(row, Check))
TITLES = {check.id: check.title for check in CHECKS}
