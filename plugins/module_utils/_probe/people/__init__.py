# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""The processes of people's nodes."""

__all__ = (
    "node_processes",
    "unregistered",
)
