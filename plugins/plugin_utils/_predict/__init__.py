# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Who would reach whom after a change, and the first hop that would not."""

__all__ = ("prediction",)
