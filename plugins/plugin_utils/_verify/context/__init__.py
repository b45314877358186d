# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The input of a check."""

__all__ = (
    "actual_world",
    "advised_values",
    "announcements",
    "check_context",
    "errors",
    "hooks",
    "needs",
    "packet_filters",
    "pairs",
    "policy_routing",
    "registrations",
    "stages",
    "ways",
)
