# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""The probes of the verification."""

__all__ = (
    "changes",
    "claims",
    "exchange",
    "logs",
    "masters",
    "network",
    "parameters",
    "resources",
    "services",
    "sources",
    "streams",
    "talker",
    "topics",
    "traffic",
)
