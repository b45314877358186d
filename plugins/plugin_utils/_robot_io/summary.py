# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The summary of a run, by computer: the changes there. Pure, and without a word of any robot."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from .._base.features import FEATURES
from .._plan.units import CONFIGURATION, LIBRARY, NODES, OTHERS, READS, reads

#: the concerns of a computer, as people call them, in the order of a run
CONCERNS = {
    "sysctl": "kernel settings",
    "routes": "routes",
    "firewall": "packet filter",
    **{feature.guarded: feature.name for feature in FEATURES if feature.guarded},
    "hosts_entries": "/etc/hosts",
    "multimaster_packages": "packages",
    "managed_files": "files",
    "managed_services": "services",
}

MOST_WARNINGS, LONGEST_WARNING = 10, 200  # that are repeated, and characters of one
#: Ansible's own warning about each computer, by default, whose Python the inventory does not name: nothing is wrong there
_DISCOVERED = re.compile(r"(?:Host '[^']*'|Platform \S+ on host \S+) is using the discovered Python interpreter at ")
#: the line of a computer that fell out of the run before its change
REFUSED = "FAILED before it was brought to its plan, for the reason above; the others went on"

Result = Mapping[str, Any]


def summarize(results: Mapping[str, Sequence[Result]], check: bool, lost: Collection[str] = ()) -> list[str]:
    """Return a line for the fleet and one for each computer that changed or failed; `results` by the computer's name.

    For example "kobuki: kernel settings, files" for two concerns that changed there, and behind a semicolon the services that were
    restarted, each with its changes. The `lost` computers are no more in the run: those without a failure among their results
    were refused before.
    """
    refused = {computer for computer in lost if not any(map(is_failure, results.get(computer, ())))}
    lines = {
        computer: REFUSED
        if computer in refused
        else "; ".join(
            filter(None, (describe(tasks), *_describe_restarts(tasks, check), *_describe_start(tasks, check)))
        )
        for computer, tasks in results.items()
    }
    notes = [f"  {computer}: {line}" for computer, line in lines.items() if line]
    action = "would change" if check else "changed"
    count = sum(any(result.get("changed") is True for result in tasks) for tasks in results.values())
    failed = len(refused) + sum(any(map(is_failure, tasks)) for tasks in results.values())
    more = f", and {failed} failed" if failed else ""
    return [f"SUMMARY: {count} of {len(results)} computers {action}{more}.", *notes]


def list_warnings(result: Result) -> list[str]:
    """List the warnings of a task, but for _DISCOVERED. Since ansible-core 2.19, those of a registered result may be objects with an event."""
    given = result.get("warnings")
    texts = (
        one if isinstance(one, str) else str(getattr(getattr(one, "event", None), "msg", one))
        for one in (given if isinstance(given, Sequence) and not isinstance(given, str) else ())
    )
    return [text for text in texts if text and not _DISCOVERED.match(text)]


def repeat_warnings(results: Mapping[str, Sequence[Result]]) -> list[str]:
    """Return the warnings of a run once more, short: pages of differences stand between them and the summary."""
    texts = dict.fromkeys(text for tasks in results.values() for one in tasks for text in list_warnings(one))
    if not texts:
        return []
    shown = [f"  - {_cut(text)}" for text in list(texts)[:MOST_WARNINGS]]
    more = len(texts) - MOST_WARNINGS
    return [
        "Warnings of this run (whole above, each with what to do):",
        *shown,
        *([f"  and {more} more"] if more > 0 else []),
    ]


def _cut(text: str) -> str:
    """Return what was found, without the expected value and the remedy behind it."""
    found = text.partition("; expected")[0]
    return found if len(found) <= LONGEST_WARNING else f"{found[: LONGEST_WARNING - 3].rstrip()}..."


def describe(results: Sequence[Result]) -> str:
    """Describe the changes on one computer, and if it failed; empty for no change."""
    changed = [word for concern, word in CONCERNS.items() if any(has_changed(result, concern) for result in results)]
    failed = ["FAILED"] if any(is_failure(result) for result in results) else []
    return ", ".join(changed + failed)


def _describe_restarts(results: Sequence[Result], check: bool) -> Iterator[str]:
    """Yield which services restart, for each reason."""
    written = {
        file["path"]
        for run in _list_runs(results, "managed_files")
        for file in _list_records(run, "files")
        if file.get("state") in ("written", "edited") and isinstance(file.get("path"), str)
    }
    reasons: dict[str, list[str]] = {}
    restarted = _name_units(results, "restarted")
    for name in ("multicast-routing", *OTHERS, *NODES):
        if f"multimaster-{name}.service" in restarted:
            reasons.setdefault(_find_reason(name, written), []).append(f"multimaster-{name}")
    action = "would restart" if check else "restarted"
    for reason, names in reasons.items():
        yield f"{action} {', '.join(names)}, since {reason}"


def list_removed(results: Sequence[Result]) -> set[str]:
    """List the services of ours that a run has taken back."""
    names = (run.get("removed") for run in _list_runs(results, "managed_services"))
    return {str(name) for some in names if isinstance(some, (list, tuple)) for name in some}


def _describe_start(results: Sequence[Result], check: bool) -> Iterator[str]:
    """Yield what a person does on a computer whose roscore this run has started: it knows no node of before."""
    if "multimaster-roscore.service" in _name_units(results, "started"):
        action = "would start" if check else "started"
        yield f"{action} the roscore: it knows none of your nodes that run already, so end them, and start them again in a new login"


def _name_units(results: Sequence[Result], state: str) -> set[str]:
    """Name the units that have this state now."""
    return {
        unit["name"]
        for run in _list_runs(results, "managed_services")
        for unit in _list_records(run, "units")
        if isinstance(unit.get("name"), str) and unit.get("state") == state
    }


def _find_reason(service: str, written: Collection[str]) -> str:
    """Return the changes for a service, in words of ours."""
    own = [path for path in written if service in READS and reads(service, path)]
    if any(path.startswith(f"{CONFIGURATION}/master_") for path in own):
        return "its parameters change"
    if any(path.startswith(f"{LIBRARY}/") for path in own):
        return "its code changes"
    if f"{CONFIGURATION}/environment" in written and service in ("roscore", *NODES):
        return "the environment changes"
    return "its unit changes, or it ran with something old"


def _list_runs(results: Sequence[Result], concern: str) -> Iterator[Result]:
    """Yield the results of a concern in each of its runs. All of it is the robot's answer."""
    for result in results:
        concerns = result.get("concerns")
        runs = concerns.get(concern) if isinstance(concerns, Mapping) else None
        yield from (run for run in (runs if isinstance(runs, (list, tuple)) else ()) if isinstance(run, Mapping))


def _list_records(run: Result, key: str) -> Iterator[Result]:
    found = run.get(key)
    yield from (one for one in (found if isinstance(found, (list, tuple)) else ()) if isinstance(one, Mapping))


def has_changed(result: Result, concern: str) -> bool:
    """Return True if a run of `multimaster_computer` changed this concern."""
    concerns = result.get("concerns")
    entries = concerns.get(concern) if isinstance(concerns, Mapping) else None
    return isinstance(entries, Sequence) and any(
        isinstance(one, Mapping) and one.get("changed") is True and not one.get("failed") for one in entries
    )


def is_failure(result: Result) -> bool:
    """Return True if a task failed on the computer, or did not reach it."""
    return bool(result.get("failed") or result.get("unreachable"))
