# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The summary of a run, by computer: what changed there. Pure, and without a word of any robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

#: the concerns of a computer, as people call them, in the order of a run
CONCERNS = {
    "sysctl": "kernel settings",
    "routes": "routes",
    "firewall": "packet filter",
    "tunnel": "tunnel",
    "hosts_entries": "/etc/hosts",
    "multimaster_packages": "packages",
    "managed_files": "files",
    "managed_services": "services",
}

Result = Mapping[str, Any]


def summarize(results: Mapping[str, Sequence[Result]], check: bool) -> list[str]:
    """Return a line for the fleet and one for each computer that changed or failed; `results` by the computer's name.

    For example "kobuki: kernel settings, files" for two concerns that changed there.
    """
    lines = {computer: describe(tasks) for computer, tasks in results.items()}
    notes = [f"  {computer}: {line}" for computer, line in lines.items() if line]
    deed = "would change" if check else "changed"
    count = sum(any(result.get("changed") is True for result in tasks) for tasks in results.values())
    failed = sum(any(is_failure(result) for result in tasks) for tasks in results.values())
    more = f", and {failed} failed" if failed else ""
    return [f"SUMMARY: {count} of {len(results)} computers {deed}{more}.", *notes]


def describe(results: Sequence[Result]) -> str:
    """Return in words what changed on one computer, and if it failed; empty for no change."""
    changed = [word for concern, word in CONCERNS.items() if any(has_changed(result, concern) for result in results)]
    failed = ["FAILED"] if any(is_failure(result) for result in results) else []
    return ", ".join(changed + failed)


def has_changed(result: Result, concern: str) -> bool:
    """Tell if a run of `multimaster_computer` changed this concern."""
    concerns = result.get("concerns")
    entries = concerns.get(concern) if isinstance(concerns, Mapping) else None
    return isinstance(entries, Sequence) and any(
        isinstance(one, Mapping) and one.get("changed") is True and not one.get("failed") for one in entries
    )


def is_failure(result: Result) -> bool:
    """Tell if a task failed on the computer, or did not reach it."""
    return bool(result.get("failed") or result.get("unreachable"))
