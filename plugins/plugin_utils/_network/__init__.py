# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Machines and links to what becomes of packets."""

__all__ = (
    "facts",
    "model",
    "packets",
    "plan_world",
    "policy",
)
