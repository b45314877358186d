# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The packet trace."""

__all__ = (
    "findings",
    "place",
    "probes",
    "steps",
    "suspects",
)
