# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The robots' answers to findings, and what people are shown of them."""

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
