# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The pairs of computers that a verification tries.

Pure: the members in, names out. 400 computers have 159,600 pairs, and most of them say nothing new: the computers of one
network share the way to another network. So a large fleet is sampled by a rule that needs no search:

* on its own network, a computer tries the next two in the order of the inventory, as on a ring;
* on every other network it tries one computer, and its neighbours try others.

So every way between networks is tried in both directions. Every computer tries two others at least, and two others at least
try it, if there are so many.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence

AUTO, ALL = "auto", "all"
ALL_UP_TO = 30  # computers: so many are tried in all pairs
AT_LEAST = 2  # times that each computer is looked at
STREAMS = 300.0  # seconds of all streams that measure throughput
SHORTEST, LONGEST = 0.1, 2.0  # seconds of one
START = 3.0  # seconds until a computer begins with its streams, if it is slow

Targets = Mapping[str, Collection[str]]  # observer -> targets


def choose_pairs(networks: Mapping[str, str], observers: Iterable[str], pairs: str = AUTO) -> Targets:
    """Choose the targets of each observer.

    `networks` has the network of each computer, in the order of the inventory. An observer without a network (a router)
    tries one computer of each network. `pairs` is `auto` or `all`.
    """
    names = list(observers)
    if pairs == ALL or len(networks) <= ALL_UP_TO:
        return {name: networks.keys() - {name} for name in names}
    rings: dict[str, list[str]] = {}
    for name, network in networks.items():
        rings.setdefault(network, []).append(name)
    places = {name: place for ring in rings.values() for place, name in enumerate(ring)}
    chosen = {name: _targets(name, networks.get(name, ""), places.get(name, 0), rings) for name in names}
    return _add_rare_targets(chosen, [name for name in names if name in networks])


def _targets(name: str, own: str, place: int, rings: Mapping[str, Sequence[str]]) -> set[str]:
    """Return the next two on the own ring, and one of each other ring; neighbours get different ones."""
    start = place + list(rings).index(own) if own else 0
    others = {ring[(start + number) % len(ring)] for number, (key, ring) in enumerate(rings.items()) if key != own}
    ring = rings.get(own, ())
    neighbours = {ring[(place + step) % len(ring)] for step in range(1, AT_LEAST + 1) if ring}
    return (others | neighbours) - {name}


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

    Beyond it each observer takes every second or third of its targets, and the next observer takes others.
    """
    most = max(1, int(STREAMS / (seconds * max(1, len(chosen)))))
    targets_of = {name: [target for target in order if target in targets] for name, targets in chosen.items()}
    steps = {name: max(1, -(-len(targets) // most)) for name, targets in targets_of.items()}
    return {
        name: targets[place % steps[name] :: steps[name]] for place, (name, targets) in enumerate(targets_of.items())
    }


def number(chosen: Targets) -> int:
    """Count the pairs."""
    return sum(len(targets) for targets in chosen.values())
