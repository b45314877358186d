# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""From the model to the plan of each computer."""

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
