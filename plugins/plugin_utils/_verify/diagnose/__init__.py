# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Failed rows to findings."""

__all__ = ("diagnosis", "explanation")
