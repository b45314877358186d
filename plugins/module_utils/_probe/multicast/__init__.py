# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""Multicast measured between computers."""

__all__ = (
    "helper",
    "memberships",
    "multicast",
    "packets",
)
