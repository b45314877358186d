# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The view of discovery for people: entries of /diagnostics about links, masters, clocks and strangers; metrics."""

from typing import Any, Callable, Dict, Iterable, List, Optional, Sequence, Tuple

from ...protocol import metrics
from ...protocol.messages import ERROR, OK, PREFIX, VALUES, WARN, DiagnosticEntry, warning
from .health import APART, LinkHealth, LinkList
from .outsiders import Outsider

FEW = 50.0  # per cent of the heartbeats: fewer are a bad link


def outsiders(ignored: Iterable[Outsider]) -> DiagnosticEntry:
    """The entry about senders that are ignored."""
    values = [(item.address, str(item)) for item in ignored]
    return warning("strangers", f"ignored, since they do not belong to the fleet: {len(values)}", values)


# Links


def roscore(uri: str, away: str, refused: Any = None) -> DiagnosticEntry:
    """The entry about the own roscore. `away`: why there is no state of it, "" if there is one.

    `refused`: bound -> how many requests were beyond it since its start.
    """
    counts = refused if isinstance(refused, dict) else {}
    values = [(f"refused requests, {bound}", f"{count}") for bound, count in sorted(counts.items())[:VALUES]]
    return DiagnosticEntry(f"{PREFIX}roscore", away or "it answers", [("uri", uri), *values], ERROR if away else OK)


def links(shown: LinkList) -> List[DiagnosticEntry]:
    """The entries about the masters of other robots: one for all, one for each link, and one for the clocks."""
    online = sum(link.online for link in shown.links)
    more = [("more", f"{shown.left_out} are not listed here")] if shown.left_out else []
    level = OK if online == len(shown.links) else WARN
    masters = DiagnosticEntry(
        f"{PREFIX}masters",
        f"{online} of {len(shown.links)} are there",
        [(link.name, "online" if link.online else "not there") for link in shown.links] + more,
        level,
    )
    return [masters, *map(_link, shown.links), _clocks(shown.links)]


def _link(link: LinkHealth) -> DiagnosticEntry:
    level, message = _verdict(link)
    values = [("uri", link.uri), ("lost", f"{link.losses} times")]
    if link.silent is not None:
        values.append(("last heard", f"{link.silent:.1f} s ago"))
    if link.quality >= 0.0:
        values.append(("heartbeats", f"{link.quality:.0f} %"))
    if link.answer is not None:
        values.append(("answer", f"{link.answer.seconds * 1000:.1f} ms"))
    return DiagnosticEntry(f"{PREFIX}link to {link.name}", message, values, level)


def _verdict(link: LinkHealth) -> Tuple[int, str]:
    if not link.online:
        return (ERROR, "lost") if link.silent is not None else (WARN, "not there")
    if 0.0 <= link.quality < FEW:
        return WARN, f"only {link.quality:.0f} % of its heartbeats come"
    return OK, "online"


def _clocks(shown: Sequence[LinkHealth]) -> DiagnosticEntry:
    """The entry about clocks. A difference that the time of the answer can explain does not count."""
    answers = [(link.name, link.answer) for link in shown if link.answer is not None]
    values = [(name, f"{answer.offset:+.3f} s, give or take {answer.seconds / 2:.3f} s") for name, answer in answers]
    most = max((answer.surely_apart for _name, answer in answers), default=0.0)
    level = sum(most >= limit for limit in APART)
    apart = [name for name, answer in answers if answer.surely_apart >= APART[0]]
    message = f"set them by NTP, they differ: {', '.join(apart[:10])}" if apart else "they agree"
    return DiagnosticEntry(f"{PREFIX}clocks", message if answers else "not compared yet", values, level)


# Metrics

#: metric -> its value for a link; None for no sample
_LINK_SAMPLES: Dict[str, Callable[[LinkHealth], Optional[float]]] = {
    "link_up": lambda link: link.online,
    "link_lost_total": lambda link: link.losses,
    "link_silence_seconds": lambda link: link.silent,
    "link_heartbeats_ratio": lambda link: link.quality / 100 if link.quality >= 0 else None,
    "link_answer_seconds": lambda link: link.answer and link.answer.seconds,
    "clock_offset_seconds": lambda link: link.answer and link.answer.offset,
}


def link_samples(shown: LinkList) -> metrics.Samples:
    """The samples about the links."""
    online = sum(link.online for link in shown.links)
    samples: metrics.Samples = metrics.scalar_samples(masters_online=online, links_left_out=shown.left_out)
    for name, read in _LINK_SAMPLES.items():
        values = {(link.name,): read(link) for link in shown.links}
        samples[name] = {labels: value for labels, value in values.items() if value is not None}
    return samples
