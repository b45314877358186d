# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Topics and services that cross by other names, at a rate, once for each link."""

__all__ = (
    "account",
    "board",
    "diagnostics",
    "dial",
    "entrance",
    "feed",
    "given",
    "node",
    "overview",
    "parties",
    "peers",
    "taken",
    "wire",
)
