# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What a check is given."""

__all__ = (
    "actual_world",
    "announcements",
    "case",
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
