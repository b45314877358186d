# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The components that can be broken, and which of them bring others down."""

__all__ = ("component",)
