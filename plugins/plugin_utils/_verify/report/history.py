# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The earlier runs: names of their files, the runs that are kept, differences from the last one. Pure: names and data in."""

from __future__ import annotations

import fnmatch
import hashlib
import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import PurePosixPath
from typing import Any

from ..._base.plain_text import plain_data
from ..._base.sentences import shorten_list

NAME = "%Y-%m-%dT%H%M%S"  # of the files of a run
TIME = "%Y-%m-%d %H:%M:%S %z"  # of a run, in its document
PATTERN = "[0-9][0-9][0-9][0-9]-[0-9][0-9]-[0-9][0-9]T[0-9][0-9][0-9][0-9][0-9][0-9].*"
KEPT = 20  # runs; each has two files
NAMED = 6  # names in a sentence


def name_folder(inventory: str, sources: Sequence[str] = ()) -> str:
    """Name the folder for the reports of a fleet, by the folder of its inventory and by what a command has after -i.

    Two inventories with one name have two folders, and so have two files of one folder.
    """
    name = re.sub(r"[^A-Za-z0-9._-]+", "_", PurePosixPath(inventory).name).strip(".") or "fleet"
    whole = inventory if list(sources) in ([], [inventory]) else "\n".join([inventory, *sources])
    return f"{name}-{hashlib.sha256(whole.encode()).hexdigest()[:8]}"


def list_latest(names: Iterable[str]) -> list[str]:
    """List the data files of the last runs, the latest first, from the names in a folder."""
    return sorted((name for name in fnmatch.filter(names, PATTERN) if name.endswith(".json")), reverse=True)[:KEPT]


def find_expired(names: Iterable[str]) -> list[str]:
    """List the files of runs that are too old."""
    return sorted(fnmatch.filter(names, PATTERN))[: -2 * KEPT]


def read_data(text: str, fleet: str, computers: Collection[str]) -> dict[str, Any]:
    """Read the data of a run of a fleet with these computers; empty if the text is something else, or of another fleet."""
    try:
        data = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    if not isinstance(data, dict):
        return {}
    # Version 1.0.0 wrote no fleet.
    is_same = data["fleet"] == fleet if "fleet" in data else _shares(data.get("computers"), computers)
    return plain_data(data) if is_same else {}


def _shares(found: Any, computers: Collection[str]) -> bool:
    return isinstance(found, list) and any(isinstance(name, str) and name in computers for name in found)


def count_seconds(before: Mapping[str, Any], now: float) -> int:
    """Count the seconds from the run of a document until now, both by the clock of the controller; 0 if it has no time before now."""
    try:
        return max(0, int(now - datetime.strptime(before["time"], TIME).timestamp()))
    except (KeyError, OverflowError, TypeError, ValueError):  # written by another version, or by hand
        return 0


def compare(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Compare two documents. Return sentences: new failures, failures that are gone, and findings that are gone."""
    try:
        return list(_compare(before, now))
    except (AttributeError, KeyError, TypeError) as _other_shape:  # written by another version, or by hand
        return []


def _compare(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    planned = {word: _list_planned(document) for word, document in (("before", before), ("now", now))}
    # With --limit a run looks at some computers alone: the others are not gone.
    yield from _compare_names("", before["computers"], [*now["computers"], *planned["now"]], "gone")
    yield from _compare_names("", [*before["computers"], *planned["before"]], now["computers"], "new")
    yield from _compare_robots(before, now)
    if len({frozenset(document["computers"]) & planned["before"] & planned["now"] for document in (before, now)}) > 1:
        return  # what one run has found at a computer, the other did not look for
    old_findings, findings = ([entry["sentence"] for entry in document["findings"]] for document in (before, now))
    yield from (f"new: {sentence}" for sentence in findings if sentence not in old_findings)
    yield from (f"no longer: {sentence}" for sentence in old_findings if sentence not in findings)


def _compare_robots(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Yield what is new and gone of each robot that both runs have read."""
    old = {entry["robot"]: entry for entry in before["robots"]}
    for entry in now["robots"]:
        other = old.get(entry["robot"])
        if other and other["read"] and entry["read"]:
            for kind in ("topics", "services"):
                yield from _compare_names(f"{kind} of {entry['robot']}: ", other[kind], entry[kind])


def _list_planned(document: Mapping[str, Any]) -> frozenset[str]:
    """List the computers of the fleet; an earlier version has only those of robots, and those that were looked at."""
    known = [name for entry in document["robots"] for name in entry["computers"]]
    return frozenset(document.get("planned") or [*document["computers"], *known])


def _compare_names(kind: str, before: Sequence[str], now: Sequence[str], *words: str) -> Iterator[str]:
    for names, word in ((set(now) - set(before), "new"), (set(before) - set(now), "gone")):
        if names and (not words or word in words):
            yield f"{kind}{shorten_list(sorted(names), NAMED)} {'is' if len(names) == 1 else 'are'} {word}"
