# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The summary of a teardown, by computer: as before, or what is left there, and what a person does now. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from .._base.plain_text import quote
from .._base.sentences import shorten_list
from .summary import CONCERNS, Result, is_failure, list_removed, list_warnings

#: the beginnings of names of records, and the concern of each
RECORDS = {
    "services-": "managed_services",
    "files-firewall": "firewall",
    "files-tunnel": "tunnel",
    "files-packages": "multimaster_packages",
    "files-hosts_entries": "hosts_entries",
    "files-": "managed_files",
}
MOST = 20  # names in a line, and records that are read
ROSCORE = "multimaster-roscore.service"
AGAIN = "log in again, start your roscore and your nodes again (they ran at a roscore that is gone)."
AGAIN_AT_YOURS = "log in again, and start your nodes again (they have variables that are gone)."
PACKAGES = "Debian packages stay, but for those that the collection installed."


@dataclass(frozen=True)
class Removal:
    """The results of a teardown on one computer."""

    results: Sequence[Result]  # of the runs of multimaster_computer
    before: Result = field(default_factory=dict)  # of multimaster_info, which read the records
    after: Result = field(default_factory=dict)
    lost: bool = False  # it is no more in the run

    def describe(self) -> str:
        """Describe the state; empty if it is as before: each change succeeded without a warning, and no record of the collection is there."""
        if self.lost or any(map(is_failure, self.results)):
            left = _name_records(_list_owned(self.before), self.results)
            return f"FAILED, for the reason above; left: {left or 'see there'}; repair that, and run this again"
        if "owned" not in self.after or self.after.get("problems"):
            return "taken back, but whether something is left could not be read; run this again"
        left = _name_records(_list_owned(self.after))
        if left:
            return f"left: {left}; run this again"
        if any(list_warnings(result) for result in self.results):
            return "taken back, but not all is as before: see the warnings above"
        return ""


def summarize_removal(computers: Mapping[str, Removal]) -> list[str]:
    """Return a line for the fleet, one for the computers that are as before, one for each other, and what a person does now."""
    states = {name: removal.describe() for name, removal in computers.items()}
    clean = [name for name, state in states.items() if not state]
    lines = [f"TEARDOWN: {len(clean)} of {len(computers)} computers {'is' if len(clean) == 1 else 'are'} as before."]
    lines += [f"  {shorten_list(clean, MOST)}: as before."] if clean else []
    lines += [f"  {name}: {state}." for name, state in states.items() if state]
    ended = {unit for removal in computers.values() for unit in list_removed(removal.results)}
    lines += [f"On each robot: {AGAIN if ROSCORE in ended else AGAIN_AT_YOURS}"] if ended else []
    return [*lines, PACKAGES]


def _list_owned(info: Mapping[str, Any]) -> list[str]:
    owned = info.get("owned")
    return [str(name) for name in owned[:MOST]] if isinstance(owned, (list, tuple)) else []


def _name_records(records: Iterable[str], results: Sequence[Result] = ()) -> str:
    """Name what records are about, as people call it, without the concerns that these results have taken back."""
    concerns = {
        name: next((word for begin, word in RECORDS.items() if name.startswith(begin)), name) for name in records
    }
    left = [concern for concern in concerns.values() if not any(_is_taken_back(one, concern) for one in results)]
    return ", ".join(dict.fromkeys(CONCERNS.get(concern, quote(concern)) for concern in left))


def _is_taken_back(result: Result, concern: str) -> bool:
    """Return True if a run that did not fail was about the concern."""
    concerns = result.get("concerns")
    return not is_failure(result) and isinstance(concerns, Mapping) and concern in concerns
