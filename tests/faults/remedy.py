# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The commands that a person would paste of a finding, and what came of them. Pure.

`do` of a finding has the steps: a command for a computer, site.yml for the controller, or words for hands.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from catalogue import Step

CONTROLLER, SITE = "controller", "site.yml"
MENDS, FAILS, STAYS, OTHER, WORDS = "yes", "the command fails", "no", "no, another is named", "words"
BY_HAND = "by hand"  # after MENDS, STAYS or OTHER: words were told, and done as the catalogue has them
WRONG = (FAILS, STAYS, OTHER)
PART = ("kind", "mode", "place")
COMPUTER = re.compile(r"[a-z0-9-]+")
GAP = re.compile(r"<\w[^>]*>")  # what a person fills in


def steps(do: Iterable[Mapping[str, str]]) -> tuple[Step, ...]:
    """Read the commands of what is to be done, up to the first step that is none: what follows needs it."""
    steps_read = []
    for step in map(_read_step, do):
        if step is None:
            break
        steps_read.append(step)
    return tuple(steps_read)


def _read_step(one: Mapping[str, str]) -> Step | None:
    if "rosfleet.multimaster.site" in one["text"]:
        return Step(CONTROLLER, SITE)
    is_command = COMPUTER.fullmatch(one["where"]) and not GAP.search(one["text"])
    return Step(one["where"], one["text"]) if is_command else None


def result(before: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    """Compare the reports before and after it: is what was named first still named, or something that was not?"""
    old, new = ([tuple(entry[word] for word in PART) for entry in report["findings"]] for report in (before, after))
    if old[0] in new:
        return STAYS
    return OTHER if set(new) - set(old) else MENDS
