# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""Debian packages, and which of them the collection has installed."""

__all__ = ("run",)
