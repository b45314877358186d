# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences about refusals: for the log and for /diagnostics."""

from typing import List, NamedTuple, Sequence, Tuple

from .limits import sentence
from .outsiders import Outsider
from .sync import Refusal

VALUES = 200  # of an entry of /diagnostics
NOUNS = {"node": "node", "service": "service", "type": "topic", "place": "node or service"}
_TAKEN = "at {there} is refused: here it is {here}. Give one of them another name, or ignore it"
_OTHER = (
    "is refused: there it is {there}, here {here}. Use one definition on both robots, another topic, or ignore_topics"
)


_PLACE = "at {there} is refused: {here}. Its nodes belong on computers of its robot, or in multimaster_allow"
_HERE = {**dict.fromkeys(NOUNS, ", here it is "), "place": ": "}
_SENTENCES = {"type": _OTHER, "place": _PLACE}


class Diagnosis(NamedTuple):
    """An entry of /diagnostics: fine without values."""

    name: str
    message: str
    values: List[Tuple[str, str]]


def refused(item: Refusal) -> str:
    """The line of the log about a new refusal."""
    if item.kind == "limit":
        return sentence(item)
    text = _SENTENCES.get(item.kind, _TAKEN).format(there=item.uri, here=item.holder)
    return f"{item.master}: the {NOUNS[item.kind]} {item.name} {text}"


def no_longer_refused(item: Refusal) -> str:
    """The line of the log about a refusal that has ended."""
    if item.kind == "limit":
        return f"{item.master} offers {item.holder} registrations or fewer again"
    return f"{item.master}: the {NOUNS[item.kind]} {item.name} is no longer refused"


def diagnoses(node: str, items: Sequence[Refusal]) -> List[Diagnosis]:
    """The entries of /diagnostics about all refusals: of too many, of names, types and places. `node` is that of master_sync."""
    all_of_them = [item for item in items if item.kind != "limit"]
    return [
        _limits(node, [item for item in items if item.kind == "limit"]),
        _diagnosis(
            f"{node.lstrip('/')}: names",
            "refused, since the name is taken here",
            [item for item in all_of_them if item.kind in ("node", "service")],
        ),
        _diagnosis(
            f"{node.lstrip('/')}: types",
            "refused, since the topic has another type here",
            [item for item in all_of_them if item.kind == "type"],
        ),
        _diagnosis(
            f"{node.lstrip('/')}: places",
            "refused, since no node of that robot can be there",
            [item for item in all_of_them if item.kind == "place"],
        ),
    ]


def _limits(node: str, items: List[Refusal]) -> Diagnosis:
    text = f"masters that offer more registrations than are taken: {len(items)}" if items else "OK"
    return Diagnosis(f"{node.lstrip('/')}: limits", text, [(item.master, sentence(item)) for item in items[:VALUES]])


def ignored(node: str, outsiders: Sequence[Outsider]) -> Diagnosis:
    """The entry of /diagnostics about senders that are ignored. `node` is that of master_discovery."""
    everybody = list(outsiders)
    values = [(item.address, str(item)) for item in everybody[:VALUES]]
    if len(everybody) > VALUES:
        values.append(("more", f"{len(everybody) - VALUES} are not listed here"))
    text = f"ignored, since they do not belong to the fleet: {len(everybody)}" if everybody else "OK"
    return Diagnosis(f"{node.lstrip('/')}: strangers", text, values)


def _diagnosis(name: str, why: str, items: List[Refusal]) -> Diagnosis:
    values = [
        (f"{NOUNS[item.kind]} {item.name}", f"{item.uri} of {item.master} is refused{_HERE[item.kind]}{item.holder}")
        for item in items[:VALUES]
    ]
    if len(items) > VALUES:
        values.append(("more", f"{len(items) - VALUES} are not listed here"))
    return Diagnosis(name, f"{why}: {len(items)}" if items else "OK", values)
