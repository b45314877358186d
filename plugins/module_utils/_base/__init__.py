# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""The needs of any module: commands, files, problems, processes."""

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
