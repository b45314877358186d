# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What bounds of the outside decide. No I/O."""

__all__ = (
    "efforts",
    "shares",
)
