# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Refusals and registrations for people: sentences for the log, entries of /diagnostics, metrics."""

from collections import Counter
from typing import Iterable, List, Mapping, Sequence, Tuple

from ...protocol import metrics
from ...protocol.messages import KINDS, DiagnosticEntry, Registration, warning
from ...protocol.plain_text import quote
from .limits import sentence
from .sync import RegistrationConflict

NOUNS = {"node": "node", "service": "service", "type": "topic", "place": "node or service", "parameter": "parameter"}
_TAKEN = "at {there} is refused: here it is {here}. Give one of them another name, or ignore it"
_OTHER = (
    "is refused: there it is {there}, here {here}. Use one definition on both robots, another topic, or ignore_topics"
)
_PLACE = "at {there} is refused: {here}. Its nodes belong on computers of its robot, or in multimaster_allow"
_PARAMETER = "is not copied: {here}"
_HERE = {**dict.fromkeys(NOUNS, ", here it is "), "place": ": "}
_SENTENCES = {"type": _OTHER, "place": _PLACE, "parameter": _PARAMETER}


def describe_refusal(item: RegistrationConflict) -> str:
    """The line of the log about a new refusal."""
    if item.kind == "limit":
        return sentence(item)
    there, here = _sides(item)
    text = _SENTENCES.get(item.kind, _TAKEN).format(there=there, here=here)
    return f"{item.master}: the {NOUNS[item.kind]} {quote(item.name)} {text}"


def _sides(item: RegistrationConflict) -> Tuple[str, str]:
    """The two sides of a conflict, there and here. Sentences about types, places and parameters have their names quoted already."""
    there = item.uri if item.kind == "type" else quote(item.uri)
    return there, item.holder if item.kind in ("type", "place", "parameter") else quote(item.holder)


def describe_refusal_end(item: RegistrationConflict) -> str:
    """The line of the log about a refusal that has ended."""
    if item.kind == "limit":
        return f"{item.master} offers {item.holder} registrations or fewer again"
    return f"{item.master}: the {NOUNS[item.kind]} {quote(item.name)} is no longer refused"


def describe_status(items: Iterable[RegistrationConflict], room: int) -> str:
    """The part of the line for systemd about all refusals, of about `room` characters; empty without one.

    `multimaster_verify` reads it (read_refusals): each has its name, its kind, the value there and its master, and the value
    here, or the refusal. Each of these is one word, or is in quotes. If there are many, the last ones have names only.
    """
    rows = sorted({item for item in items if item.kind != "limit"}, key=lambda item: item.name)
    limited = sorted({item.master for item in items if item.kind == "limit"})
    end = f"; not all of {', '.join(limited)}: too many" if limited else ""
    texts: List[str] = []
    used = len(end)
    for item in rows:
        text = _describe_item(item) if used < room // 2 else quote(item.name)
        used += len(text) + 2
        if used > room - 40:
            break
        texts.append(text)
    if len(rows) > len(texts):
        texts.append(f"and {len(rows) - len(texts)} more")
    return (f"; refused: {', '.join(texts)}" if texts else "") + end


def _describe_item(item: RegistrationConflict) -> str:
    name, there, master, here = (quote(text) or '""' for text in (item.name, item.uri, item.master, item.holder))
    return f"{name} ({item.kind} {there} of {master}: {here})"


def diagnoses(items: Sequence[RegistrationConflict]) -> List[DiagnosticEntry]:
    """The entries about all refusals: of too many, of names, types, places and parameters."""
    kinds = {
        "names": (("node", "service"), "refused, since the name is taken here"),
        "types": (("type",), "refused, since the topic has another type here"),
        "places": (("place",), "refused, since no node of that robot can be there"),
        "parameters": (("parameter",), "not copied"),
    }
    limits = [(item.master, sentence(item)) for item in items if item.kind == "limit"]
    return [
        warning("limits", f"masters that offer more registrations than are taken: {len(limits)}", limits),
        *(_refusals(name, why, [item for item in items if item.kind in group]) for name, (group, why) in kinds.items()),
    ]


def _refusals(name: str, why: str, items: Sequence[RegistrationConflict]) -> DiagnosticEntry:
    values = []
    for item in items:
        there, here = _sides(item)
        text = f"{there} of {item.master} is refused{_HERE[item.kind]}{here}"
        if item.kind == "parameter":
            text = f"of {item.master}: {here}"
        values.append((f"{NOUNS[item.kind]} {quote(item.name)}", text))
    return warning(name, f"{why}: {len(items)}", values)


# Metrics


def refusal_samples(refused: Iterable[RegistrationConflict], total: Mapping[str, int]) -> metrics.Samples:
    """The samples about refusals. `refused`: those in force; `total`: kind -> the number since the start."""
    now = Counter(item.kind for item in refused)
    return {
        "refusals": {(reason,): now[reason] for reason in metrics.REASONS},
        "refusals_total": {(reason,): total.get(reason, 0) for reason in metrics.REASONS},
    }


def parameter_samples(masters: Iterable[str], copied: Iterable[str]) -> metrics.Samples:
    """The samples about parameters. `masters`: those that may give some; `copied`: the master of each one that is here."""
    counts = Counter(copied)
    return {"parameters": {(name,): counts[name] for name in sorted(masters)[: metrics.MOST]}}


def registration_samples(names: Mapping[str, str], held: Mapping[Registration, str]) -> metrics.Samples:
    """The samples about registrations. `names`: URI of a master -> its name."""
    counts = Counter((names.get(uri, ""), item.kind) for item, uri in held.items())
    known = sorted({*names.values(), *(name for name, _kind in counts)} - {""})[: metrics.MOST // len(KINDS)]
    return {"registrations": {(name, kind): counts[name, kind] for name in known for kind in KINDS}}
