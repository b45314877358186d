# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The one table of faults: all that verify, predict and watch can find, with an id for each."""

__all__ = (
    "fault",
    "filters",
    "foreseen",
    "table",
)
