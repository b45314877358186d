# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The jobs of master_discovery."""

__all__ = (
    "contacts",
    "core",
    "datagrams",
    "poller",
    "rpc_methods",
    "source",
    "state_feed",
    "udp",
)
