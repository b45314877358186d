# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The decisions of master_discovery. No I/O."""

__all__ = (
    "actions",
    "discovery",
    "health",
    "outsiders",
    "peer",
    "report",
)
