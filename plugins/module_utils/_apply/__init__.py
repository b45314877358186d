# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""All changes of a computer."""

__all__ = (
    "computer",
    "firewall",
    "hosts",
    "packages",
    "routes",
    "sysctl",
    "transaction",
)
