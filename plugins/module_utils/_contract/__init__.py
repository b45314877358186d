# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""What the modules that measure answer. The controller reads it, too."""

__all__ = (
    "answers",
    "clock",
    "computer",
    "fields",
    "machine",
    "multicast",
    "network",
    "outcomes",
    "ros",
    "trace",
    "tunnel",
    "verify",
)
