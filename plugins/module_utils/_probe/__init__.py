# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""The verification of one computer."""

__all__ = (
    "facts",
    "measure",
    "multicast",
    "options",
    "run",
    "trace",
    "watch",
)
