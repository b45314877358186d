# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences about refusals: for the log and for /diagnostics."""

from typing import Iterable, List, NamedTuple, Tuple

from .sync import Refusal

VALUES = 200  # of an entry of /diagnostics
NOUNS = {"node": "node", "service": "service", "type": "topic"}
_TAKEN = "at {there} is refused: here it is {here}. Give one of them another name, or ignore it"
_OTHER = (
    "is refused: there it is {there}, here {here}. Use one definition on both robots, another topic, or ignore_topics"
)


class Diagnosis(NamedTuple):
    """An entry of /diagnostics: fine without values."""

    name: str
    message: str
    values: List[Tuple[str, str]]


def refused(item: Refusal) -> str:
    """The line of the log about a new refusal."""
    text = (_OTHER if item.kind == "type" else _TAKEN).format(there=item.uri, here=item.holder)
    return f"{item.master}: the {NOUNS[item.kind]} {item.name} {text}"


def no_longer_refused(item: Refusal) -> str:
    """The line of the log about a refusal that has ended."""
    return f"{item.master}: the {NOUNS[item.kind]} {item.name} is no longer refused"


def diagnoses(node: str, items: Iterable[Refusal]) -> List[Diagnosis]:
    """The two entries of /diagnostics about all refusals: of names, and of types. `node` is that of master_sync."""
    all_of_them = list(items)
    return [
        _diagnosis(
            f"{node.lstrip('/')}: names",
            "refused, since the name is taken here",
            [item for item in all_of_them if item.kind != "type"],
        ),
        _diagnosis(
            f"{node.lstrip('/')}: types",
            "refused, since the topic has another type here",
            [item for item in all_of_them if item.kind == "type"],
        ),
    ]


def _diagnosis(name: str, why: str, items: List[Refusal]) -> Diagnosis:
    values = [
        (f"{NOUNS[item.kind]} {item.name}", f"{item.uri} of {item.master} is refused, here it is {item.holder}")
        for item in items[:VALUES]
    ]
    if len(items) > VALUES:
        values.append(("more", f"{len(items) - VALUES} are not listed here"))
    return Diagnosis(name, f"{why}: {len(items)}" if items else "OK", values)
