# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""What any module needs."""

__all__ = (
    "actions",
    "background",
    "commands",
    "deadlines",
    "difference",
    "ends",
    "foreign",
    "module",
    "plain_text",
    "problem",
    "processes",
    "regular_files",
    "rights",
    "trust",
)
