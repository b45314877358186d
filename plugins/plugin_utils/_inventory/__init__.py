# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Variables to model."""

__all__ = (
    "exports",
    "filters",
    "flows",
    "kinds",
    "model",
    "places",
    "read",
    "roles",
    "rows",
    "variables",
)
