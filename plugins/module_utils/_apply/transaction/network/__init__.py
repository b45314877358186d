# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""Addresses, routes and rules of this computer, before and after a change."""

__all__ = ("state",)
