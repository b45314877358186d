# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""The answers of the modules that measure. The controller reads these classes, too."""

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
