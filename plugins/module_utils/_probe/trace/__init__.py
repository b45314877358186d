# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""The packet trace at one computer."""

__all__ = ("run",)
