# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The answers of the verification's modules, as records."""

__all__ = (
    "observations",
    "outcomes",
    "packed",
    "packet_trace",
    "task_results",
    "uris",
)
