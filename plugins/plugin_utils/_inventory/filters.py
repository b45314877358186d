# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The options of the nodes, in their own words: filters of the exchange, parameters of master_sync, and those that never cross.

The controller has the files of the nodes on its disk, since it brings them to the robots.
"""

from __future__ import annotations

from ....roles.nodes.files.python.rosfleet_multimaster.protocol.filters import (
    BUILT_IN,
    HOSTS,
    NAMES,
    NO_NAME,
    SUCCESSOR,
    UNKNOWN_TYPES,
    WHITE_LISTS,
    Filters,
    InvalidPattern,
    Pattern,
    Rules,
    matches,
    usable,
)
from ....roles.nodes.files.python.rosfleet_multimaster.protocol.parameters import CROSSING, NEVER_CROSSING, SYNC

__all__ = (
    "BUILT_IN",
    "CROSSING",
    "HOSTS",
    "NAMES",
    "NEVER_CROSSING",
    "NO_NAME",
    "SUCCESSOR",
    "SYNC",
    "UNKNOWN_TYPES",
    "WHITE_LISTS",
    "Filters",
    "InvalidPattern",
    "Pattern",
    "Rules",
    "matches",
    "usable",
)
