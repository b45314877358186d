# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The runs before this one: the names of their files, which of them stay, and what differs from the last one. Pure: names and data in."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import PurePosixPath
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.plain_text import plain_data

NAME = "%Y-%m-%dT%H%M%S"  # of the files of a run
PATTERN = "[0-9][0-9][0-9][0-9]-[0-9][0-9]-[0-9][0-9]T[0-9][0-9][0-9][0-9][0-9][0-9].*"
KEPT = 20  # runs; each has two files
NAMED = 6  # names in a sentence


def folder_name(inventory: str) -> str:
    """Name the folder for the reports of an inventory: two inventories with one name have two folders."""
    name = re.sub(r"[^A-Za-z0-9._-]+", "_", PurePosixPath(inventory).name).strip(".") or "fleet"
    return f"{name}-{hashlib.sha256(inventory.encode()).hexdigest()[:8]}"


def latest(names: Iterable[str]) -> str:
    """Return the file with the data of the last run, of those in a folder; empty where there is none."""
    return max((name for name in _of_runs(names) if name.endswith(".json")), default="")


def expired(names: Iterable[str]) -> list[str]:
    """List the files of runs that are too old to be kept."""
    return sorted(_of_runs(names))[: -2 * KEPT]


def _of_runs(names: Iterable[str]) -> Iterator[str]:
    return (name for name in names if fnmatchcase(name, PATTERN))


def data_of(text: str) -> dict[str, Any]:
    """Read the data of a run; empty where it is something else."""
    try:
        found = json.loads(text)
        return plain_data(found) if isinstance(found, dict) else {}
    except (ValueError, RecursionError):
        return {}


def since(before: Mapping[str, Any], now: Mapping[str, Any]) -> dict[str, Any]:
    """Say when the run before was, and what differs from it."""
    return {"time": before.get("time", ""), "differences": differences(before, now)}


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Compare two documents: sentences about what is new, what is gone, and what is well again."""
    try:
        return list(_differences(before, now))
    except (AttributeError, KeyError, TypeError) as _other_shape:  # written by another version, or by hand
        return []


def _differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    yield from _compared("", before["computers"], now["computers"])
    old = {entry["robot"]: entry for entry in before["robots"]}
    for entry in now["robots"]:
        other = old.get(entry["robot"])
        if other and other["read"] and entry["read"]:
            for kind in ("topics", "services"):
                yield from _compared(f"{kind} of {entry['robot']}: ", other[kind], entry[kind])
    was, found = _sentences(before), _sentences(now)
    yield from (f"new: {sentence}" for sentence in found if sentence not in was)
    yield from (f"no longer: {sentence}" for sentence in was if sentence not in found)


def _compared(of: str, before: Sequence[str], now: Sequence[str]) -> Iterator[str]:
    for names, word in ((set(now) - set(before), "new"), (set(before) - set(now), "gone")):
        if names:
            yield f"{of}{_listed(sorted(names))} {'is' if len(names) == 1 else 'are'} {word}"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more


def _sentences(document: Mapping[str, Any]) -> list[str]:
    return [entry["sentence"] for entry in document["findings"]]
