# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The pairs of computers that a verification tries.

Pure: the members in, names out. 400 computers have 159,600 pairs, and most of them say nothing new: the computers of one
network share the way to another network. So a large fleet is sampled by a rule that needs no search:

* on its own network, a computer tries the next two in the order of the inventory, as on a ring;
* on every other network it tries one computer, and its neighbours try others;
* if there are more than thirty other networks, each computer of a network tries only a part of them: two of its computers
  each every second network, three each every third.

So every way between networks is tried in both directions. Every computer tries two others at least, and two others at least
try it, if there are so many. The pairs grow with the computers as long as a network has a computer for each thirty others.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence

AUTO, ALL = "auto", "all"
ALL_UP_TO = 30  # computers: so many are tried in all pairs
AT_LEAST = 2  # times that each computer is looked at
NETWORKS = 30  # other networks that one computer tries, if its network has enough computers for the rest
STREAMS = 300.0  # seconds of all streams that measure throughput
SHORTEST, LONGEST = 0.1, 2.0  # seconds of one
START = 3.0  # seconds until a computer begins with its streams, if it is slow

Targets = Mapping[str, Collection[str]]  # observer -> targets


def choose_pairs(networks: Mapping[str, str], observers: Iterable[str], pairs: str = AUTO) -> Targets:
    """Choose the targets of each observer.

    `networks` has the network of each computer, in the order of the inventory. An observer without a network (a router)
    tries one computer of each network. `observers` are the computers of a run that look. `pairs` is `auto` or `all`.
    """
    names = list(observers)
    if pairs == ALL or len(networks) <= ALL_UP_TO:
        return {name: networks.keys() - {name} for name in names}
    rings: dict[str, list[str]] = {}
    for name, network in networks.items():
        rings.setdefault(network, []).append(name)
    sharing: dict[str, list[str]] = {}
    for name in names:
        sharing.setdefault(networks.get(name, name), []).append(name)  # a router shares with nobody
    chosen = {name: _targets(name, networks.get(name, ""), sharing[networks.get(name, name)], rings) for name in names}
    return _add_rare_targets(chosen, [name for name in names if name in networks])


def _targets(name: str, own: str, sharing: Sequence[str], rings: Mapping[str, Sequence[str]]) -> set[str]:
    """Return the next two on the own ring, and one of each other ring that is this computer's; neighbours get different ones.

    `sharing` has the computers of the ring that look at others, this one among them.
    """
    ring = rings.get(own, ())
    others = [other for key, other in rings.items() if key != own]
    share = max(1, min(len(sharing), -(-len(others) // NETWORKS)))  # each takes every so many
    place = sharing.index(name)
    start = place // share + (list(rings).index(own) if own else 0)  # those that take the same ring differ in it by one
    theirs = {
        other[(start + number) % len(other)] for number, other in enumerate(others) if (number + place) % share == 0
    }
    on_ring = ring.index(name) if ring else 0
    neighbours = {ring[(on_ring + step) % len(ring)] for step in range(1, AT_LEAST + 1) if ring}
    return (theirs | neighbours) - {name}


def _add_rare_targets(chosen: dict[str, set[str]], computers: Sequence[str]) -> Targets:
    """Add pairs if a computer tries fewer than two, or is tried by fewer: in a ring of two, or as the only one."""
    counts = Counter(target for targets in chosen.values() for target in targets)
    for place, name in enumerate(computers):
        for other in [*computers[place + 1 :], *computers[:place]]:
            for observer, target, due in (
                (name, other, len(chosen[name]) < AT_LEAST),
                (other, name, counts[name] < AT_LEAST),
            ):
                if due and target not in chosen[observer]:
                    chosen[observer].add(target)
                    counts[target] += 1
            if len(chosen[name]) >= AT_LEAST <= counts[name]:
                break
    return chosen


def streams(chosen: Targets, order: Sequence[str], seconds: float) -> dict[str, list[str]]:
    """Choose the targets of each observer's streams. One stream is sent at a time, so their time together has a limit.

    Beyond it each observer takes some of its targets, those that have got the fewest streams until then.
    """
    most = max(1, int(STREAMS / (seconds * max(1, len(chosen)))))
    got: Counter[str] = Counter()
    found = {}
    for name, targets in chosen.items():
        few = set(sorted((target for target in order if target in targets), key=got.__getitem__)[:most])
        got.update(few)
        found[name] = [target for target in order if target in few]
    return found


def number(chosen: Targets) -> int:
    """Count the pairs."""
    return sum(len(targets) for targets in chosen.values())
