# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The robots' answers to findings, and their form for people."""

__all__ = (
    "checks",
    "components",
    "context",
    "diagnose",
    "observe",
    "report",
    "trace",
    "watch",
)
