# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""All concerns of a computer in one run, each with the code of its own module."""

__all__ = (
    "concerns",
    "run",
)
