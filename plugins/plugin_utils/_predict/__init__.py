# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The computers that would reach each other after a change, and the first hop that would not."""

__all__ = ("prediction",)
