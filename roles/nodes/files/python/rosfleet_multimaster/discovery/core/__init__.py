# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What master_discovery decides. No I/O."""

__all__ = (
    "actions",
    "discovery",
    "health",
    "outsiders",
    "peer",
    "report",
)
