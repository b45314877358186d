# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What master_sync decides. No I/O."""

__all__ = (
    "limits",
    "permission",
    "report",
    "sync",
)
