# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The part that a report names first, compared with the part of the fault. Pure.

A report has findings, which are parts (kind, mode, place), or, before there were parts, checks with a cause.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from catalogue import Fault

FIRST, RIVAL, OTHER, NOTHING = "first", "one of several", "another part first", "nothing was named"
UNMADE = "the lab could not make it"  # so nothing was judged
WRONG = ("failed", "warning")
FEW = 4  # findings in which both of two faults are to be


@dataclass(frozen=True)
class Named:
    """The part that was named first."""

    part: tuple[str, str] = ("", "")
    place: str = ""
    text: str = ""
    rivals: tuple[tuple[str, str, str], ...] = ()  # (kind, mode, place) of what may be instead
    findings: int = 0
    first: tuple[tuple[str, str, str], ...] = ()  # (kind, mode, place) of the first few findings
    unexplained: tuple[str, ...] = ()  # check, observer and target of each row that no finding explains


def named(document: Mapping[str, Any]) -> Named:
    """Read the file of `verify_report`."""
    findings = document.get("findings", [])
    open_rows = tuple(
        " ".join((row["check"], row["observer"], row["target"])) for row in document.get("unexplained", ())
    )
    if findings and "kind" in findings[0]:
        first = findings[0]
        rivals = tuple((entry["kind"], entry["mode"], entry["place"]) for entry in first.get("rivals", ()))
        text = first.get("sentence") or f"{first['kind']} {first['mode']} of {first['place']}"
        few = tuple((entry["kind"], entry["mode"], entry["place"]) for entry in findings[:FEW])
        return Named((first["kind"], first["mode"]), first["place"], text, rivals, len(findings), few, open_rows)
    wrong = [entry for entry in findings if entry["verdict"] in WRONG and not entry["because"]]
    wrong.sort(key=lambda entry: WRONG.index(entry["verdict"]))  # failures before warnings
    if not wrong:
        return Named()
    first = wrong[0]
    text = f"{first['check']} {first['observer']} -> {first['target']}: {first['cause'] or first['found']}"
    return Named(text=text, findings=len(wrong))


def verdict(fault: Fault, found: Named) -> str:
    """Compare what was named first with what is expected."""
    if not found.findings:
        return NOTHING
    if found.part in fault.parts and is_at(found.place, fault.at) and not found.rivals:
        return FIRST
    candidates = ((*found.part, found.place), *found.rivals)
    if any((kind, mode) in fault.parts and is_at(place, fault.at) for kind, mode, place in candidates):
        return RIVAL
    return OTHER


def is_at(place: str, places: tuple[str, ...]) -> bool:
    """Return True if one of these places is meant; a part may be of two computers."""
    return any(one in places for one in (place, *place.split(" and ")))
