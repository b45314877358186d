# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The process: log, end, watchdog, children, memory, its share of the processor."""

__all__ = (
    "children",
    "liveness",
    "memory",
    "program",
    "room",
    "systemd",
    "textfile",
    "throttle",
)
