# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The connections of TCPROS: hosts and ports in URIs, the header, and the messages after it."""

__all__ = (
    "header",
    "hosts",
    "messages",
)
