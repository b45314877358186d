# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The run of a module on a robot, whose answer is read by the contract, or by the documentation of its module."""

__all__ = (
    "concerns",
    "confirmation",
    "refusal",
    "removal",
    "robot_action",
    "ssh",
    "summary",
    "trees",
)
