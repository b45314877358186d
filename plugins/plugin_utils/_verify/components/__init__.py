# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be broken, and what follows from what."""

__all__ = ("component",)
