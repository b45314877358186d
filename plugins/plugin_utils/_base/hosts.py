# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The hosts and ports in URIs of nodes, each in its only spelling, by the file of the nodes."""

from __future__ import annotations

from ....roles.nodes.files.python.rosfleet_multimaster.protocol.tcpros.hosts import (
    host_of,
    is_address,
    is_host_name,
    place_of,
)

__all__ = ("host_of", "is_address", "is_host_name", "place_of")
