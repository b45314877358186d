# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences for the log, and the entries of /diagnostics (REP 107): links, masters, clocks and refusals."""

from typing import Any, Iterable, List, NamedTuple, Sequence, Tuple

from .health import APART, Seen, Shown
from .limits import sentence
from .outsiders import Outsider
from .plain_text import quoted
from .sync import Refusal

OK, WARN, ERROR = range(3)  # levels of diagnostic_msgs/DiagnosticStatus
PREFIX = "multimaster: "  # of all names: an analyzer of diagnostic_aggregator finds them by it
FEW = 50.0  # per cent of the heartbeats: fewer are a bad link
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
    """An entry of /diagnostics."""

    name: str
    message: str
    values: List[Tuple[str, str]]
    level: int = OK


def refused(item: Refusal) -> str:
    """The line of the log about a new refusal."""
    if item.kind == "limit":
        return sentence(item)
    there, here = _sides(item)
    text = _SENTENCES.get(item.kind, _TAKEN).format(there=there, here=here)
    return f"{item.master}: the {NOUNS[item.kind]} {quoted(item.name)} {text}"


def _sides(item: Refusal) -> Tuple[str, str]:
    """What is there and what is here. Types and places are told in sentences, which have quoted the names in them."""
    there = item.uri if item.kind == "type" else quoted(item.uri)
    return there, item.holder if item.kind in ("type", "place") else quoted(item.holder)


def no_longer_refused(item: Refusal) -> str:
    """The line of the log about a refusal that has ended."""
    if item.kind == "limit":
        return f"{item.master} offers {item.holder} registrations or fewer again"
    return f"{item.master}: the {NOUNS[item.kind]} {quoted(item.name)} is no longer refused"


def diagnoses(items: Sequence[Refusal]) -> List[Diagnosis]:
    """The entries about all refusals: of too many, of names, types and places."""
    kinds = {
        "names": (("node", "service"), "refused, since the name is taken here"),
        "types": (("type",), "refused, since the topic has another type here"),
        "places": (("place",), "refused, since no node of that robot can be there"),
    }
    return [
        _limits([item for item in items if item.kind == "limit"]),
        *(_refusals(name, why, [item for item in items if item.kind in of]) for name, (of, why) in kinds.items()),
    ]


def _limits(items: Sequence[Refusal]) -> Diagnosis:
    values = [(item.master, sentence(item)) for item in items]
    return _wrong("limits", f"masters that offer more registrations than are taken: {len(items)}", values)


def _refusals(name: str, why: str, items: Sequence[Refusal]) -> Diagnosis:
    values = []
    for item in items:
        there, here = _sides(item)
        told = f"{there} of {item.master} is refused{_HERE[item.kind]}{here}"
        values.append((f"{NOUNS[item.kind]} {quoted(item.name)}", told))
    return _wrong(name, f"{why}: {len(items)}", values)


def ignored(outsiders: Iterable[Outsider]) -> Diagnosis:
    """The entry about senders that are ignored."""
    values = [(item.address, str(item)) for item in outsiders]
    return _wrong("strangers", f"ignored, since they do not belong to the fleet: {len(values)}", values)


def _wrong(name: str, why: str, values: List[Tuple[str, str]]) -> Diagnosis:
    """An entry that is a warning where it has values, of which not too many are shown."""
    if not values:
        return Diagnosis(PREFIX + name, "OK", [])
    more = [("more", f"{len(values) - VALUES} are not listed here")] if len(values) > VALUES else []
    return Diagnosis(PREFIX + name, why, values[:VALUES] + more, WARN)


# Links


def roscore(uri: str, away: str, refused: Any = None) -> Diagnosis:
    """The entry about the own roscore. `away`: why there is no state of it, "" where there is one.

    `refused`: bound -> how many requests were beyond it since its start.
    """
    counts = refused if isinstance(refused, dict) else {}
    values = [(f"refused requests, {bound}", f"{count}") for bound, count in sorted(counts.items())[:VALUES]]
    return Diagnosis(f"{PREFIX}roscore", away or "it answers", [("uri", uri), *values], ERROR if away else OK)


def links(shown: Shown) -> List[Diagnosis]:
    """The entries about the masters of other robots: one for all, one for each link, and one for the clocks."""
    online = sum(link.online for link in shown.links)
    more = [("more", f"{shown.left_out} are not listed here")] if shown.left_out else []
    level = OK if online == len(shown.links) else WARN
    masters = Diagnosis(
        f"{PREFIX}masters",
        f"{online} of {len(shown.links)} are there",
        [(link.name, "online" if link.online else "not there") for link in shown.links][:VALUES] + more,
        level,
    )
    return [masters, *map(_link, shown.links), _clocks(shown.links)]


def _link(link: Seen) -> Diagnosis:
    level, message = _verdict(link)
    values = [("uri", link.uri), ("lost", f"{link.losses} times")]
    if link.silent is not None:
        values.append(("last heard", f"{link.silent:.1f} s ago"))
    if link.quality >= 0.0:
        values.append(("heartbeats", f"{link.quality:.0f} %"))
    if link.answer is not None:
        values.append(("answer", f"{link.answer.seconds * 1000:.1f} ms"))
    return Diagnosis(f"{PREFIX}link to {link.name}", message, values, level)


def _verdict(link: Seen) -> Tuple[int, str]:
    if not link.online:
        return (ERROR, "lost") if link.silent is not None else (WARN, "not there")
    if 0.0 <= link.quality < FEW:
        return WARN, f"only {link.quality:.0f} % of its heartbeats come"
    return OK, "online"


def _clocks(shown: Sequence[Seen]) -> Diagnosis:
    """The entry about clocks: a difference of which the time of the answer may be the reason is none."""
    answers = [(link.name, link.answer) for link in shown if link.answer is not None]
    values = [(name, f"{answer.offset:+.3f} s, give or take {answer.seconds / 2:.3f} s") for name, answer in answers]
    most = max((answer.surely_apart for _name, answer in answers), default=0.0)
    level = sum(most >= limit for limit in APART)
    apart = [name for name, answer in answers if answer.surely_apart >= APART[0]]
    message = f"set them by NTP, they differ: {', '.join(apart[:10])}" if apart else "they agree"
    return Diagnosis(f"{PREFIX}clocks", message if answers else "not compared yet", values[:VALUES], level)
