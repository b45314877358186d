# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The decisions of the bounds on the outside. No I/O."""

__all__ = (
    "efforts",
    "shares",
)
