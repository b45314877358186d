# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A file for those who are asked for help."""

__all__ = (
    "archive",
    "bundle",
    "reading",
    "secrets",
)
