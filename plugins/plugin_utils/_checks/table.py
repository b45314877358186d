# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The checks of the verification, one table: the rows of each file beside this one, in the order of CHECKS.

In each file a row stands below its functions.
"""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._checks import (
    computer,
    discovery_nodes,
    exchange,
    manual_setup,
    network,
    next_boot,
    programs,
    ros,
    strangers,
)

CHECKS = (
    *computer.CHECKS,
    *manual_setup.CHECKS,
    *next_boot.CHECKS,
    *programs.CHECKS,
    *network.CHECKS,
    *discovery_nodes.CHECKS,
    *ros.CHECKS,
    *exchange.CHECKS,
    *strangers.CHECKS,
)
TITLES = {check.id: check.title for check in CHECKS}


def markdown_table() -> str:
    """Return the table of checks for docs/operate/verification.md."""
    lines = ["| check | for | expected | report |", "|---|---|---|---|"]
    for check in CHECKS:
        scope, expected, report = check.documented
        lines.append(f"| `{check.id}` | {scope} | {expected} | {report + ' ' if report else ''}|")
    return "\n".join(lines) + "\n"
