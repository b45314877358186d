# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A run to its judgement, and to the terminal, the page, pictures and JUnit XML."""

__all__ = (
    "history",
    "judgement",
    "junit",
    "matrices",
    "page",
    "run",
    "terminal",
)
