# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""From machines that people set up by hand to an inventory for them."""

__all__ = (
    "facts",
    "infer",
    "proposal",
    "write",
)
