# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The connections of TCPROS: the header, and the messages after it."""

__all__ = (
    "header",
    "messages",
)
