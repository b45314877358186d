# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What any room needs."""

__all__ = (
    "advice",
    "features",
    "hosts",
    "plain",
    "plain_text",
    "sentences",
)
