# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Observations to rows."""

__all__ = (
    "discovery_nodes",
    "engine",
    "hooks",
    "programs",
    "table",
)
