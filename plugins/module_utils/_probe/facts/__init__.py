# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""A machine before it becomes a computer of the fleet."""

__all__ = (
    "machine",
    "next_boot",
    "part",
)
