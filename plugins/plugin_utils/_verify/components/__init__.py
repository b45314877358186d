# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of what can be broken, and how."""

__all__ = (
    "fault",
    "parts",
)
