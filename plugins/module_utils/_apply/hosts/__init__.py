# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""Bindings in /etc/hosts."""

__all__ = (
    "cloud_init",
    "run",
)
