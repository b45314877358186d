# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""Routes in the kernel, and at boot by a back end."""

__all__ = (
    "kernel",
    "run",
    "tables",
)
