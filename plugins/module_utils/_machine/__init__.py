# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""All that is there."""

__all__ = (
    "filters",
    "fkie",
    "network",
    "outcomes",
    "ports",
    "ros",
    "shells",
    "system",
    "systemd",
    "unit_ends",
)
