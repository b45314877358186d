# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""An entry of /diagnostics (REP 107)."""

from typing import List, NamedTuple, Tuple

OK, WARN, ERROR = range(3)  # levels of diagnostic_msgs/DiagnosticStatus
PREFIX = "multimaster: "  # of all names: an analyzer of diagnostic_aggregator finds them by it
VALUES = 200  # of an entry of /diagnostics


class Diagnosis(NamedTuple):
    """An entry of /diagnostics."""

    name: str
    message: str
    values: List[Tuple[str, str]]
    level: int = OK


def warning(name: str, why: str, values: List[Tuple[str, str]]) -> Diagnosis:
    """An entry that is a warning where it has values, of which not too many are shown."""
    if not values:
        return Diagnosis(PREFIX + name, "OK", [])
    more = [("more", f"{len(values) - VALUES} are not listed here")] if len(values) > VALUES else []
    return Diagnosis(PREFIX + name, why, values[:VALUES] + more, WARN)
