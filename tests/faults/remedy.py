# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The commands that a person would paste of a finding, and what came of them. Pure.

A remedy is words, and what can be pasted is `run site.yml`, or `on COMPUTER: COMMAND`, which `then run site.yml` may follow.
What stands behind `; see` only shows, and what stands behind `; if it does not last` is for later.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from catalogue import Step

CONTROLLER, SITE = "controller", "site.yml"
MENDS, FAILS, STAYS, OTHER, WORDS = "yes", "the command fails", "no", "no, another is named", "words"
WRONG = (FAILS, STAYS, OTHER)
PART = ("kind", "mode", "place")
LATER = re.compile("; (?:see|if it does not last,) ")
COMMAND = re.compile(r"(?:^|; )on (?P<where>[a-z0-9-]+): (?P<what>.+)$")


def steps(remedy: str) -> tuple[Step, ...]:
    """Read the commands of a remedy; none where it is words alone."""
    text = remedy if not remedy.startswith("see ") else ""
    text = LATER.split(text)[0]
    text, then, _what_for = text.partition("; then run site.yml")
    found = COMMAND.search(text)
    site = (Step(CONTROLLER, SITE),) if then or text.startswith("run site.yml") else ()
    return ((Step(found["where"], found["what"]),) if found else ()) + site


def result(before: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    """Compare the reports before and after it: is what was named first still named, or something that was not?"""
    old, new = ([tuple(entry[word] for word in PART) for entry in report["findings"]] for report in (before, after))
    if old[0] in new:
        return STAYS
    return OTHER if set(new) - set(old) else MENDS
