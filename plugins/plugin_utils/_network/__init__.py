# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""From machines and links to the fate of packets."""

__all__ = (
    "facts",
    "model",
    "packets",
    "plan_world",
    "policy",
)
