# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The words between robots, nodes and roscore, and their forms for others. No I/O."""

__all__ = (
    "differences",
    "filters",
    "graph",
    "heartbeat",
    "imports",
    "json_text",
    "members",
    "messages",
    "metrics",
    "mirror",
    "parameters",
    "plain_text",
    "tcpros",
    "wire_filters",
    "xml_rpc",
)
