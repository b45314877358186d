# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The needs of any room."""

__all__ = (
    "advice",
    "features",
    "hosts",
    "plain",
    "plain_text",
    "sentences",
)
