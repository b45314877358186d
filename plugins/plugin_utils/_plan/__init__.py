# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Model to what each computer needs."""

__all__ = (
    "dialects",
    "environment",
    "model",
    "parameters",
    "plan",
    "preflight",
    "quotes",
    "router_config",
    "units",
)
