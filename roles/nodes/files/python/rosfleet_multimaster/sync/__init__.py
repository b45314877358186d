# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The jobs of master_sync and of end_connections."""

__all__ = (
    "connection_ender",
    "copies",
    "core",
    "disconnector",
    "fetcher",
    "finder",
    "rounds",
    "type_questions",
)
