# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""What is there."""

__all__ = (
    "clock",
    "filters",
    "fkie",
    "network",
    "outcomes",
    "ports",
    "ros",
    "shells",
    "system",
    "systemd",
    "time_sources",
    "unit_ends",
)
